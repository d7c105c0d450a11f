from messages import AckermannDriveStamped  # noqa: F401
