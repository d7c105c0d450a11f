"""Commands and doors that no evaluation, user's ADS or nightly run needs, one room each.

Entry points of `pyproject.toml` find them, so that the core never imports this package.
"""
