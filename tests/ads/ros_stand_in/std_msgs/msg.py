from messages import String  # noqa: F401
