from messages import Marker, MarkerArray  # noqa: F401
