from messages import Clock  # noqa: F401
