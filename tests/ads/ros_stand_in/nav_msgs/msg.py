from messages import Odometry, Path  # noqa: F401
