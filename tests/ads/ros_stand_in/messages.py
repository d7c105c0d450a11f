"""ROS 2 messages, with the fields that they have there; unknown fields are refused, as there."""

from dataclasses import field, make_dataclass


def message(name, **kinds):
    """The class of a message, from the kind of each field."""
    fields = [(it, kind, field(default_factory=kind)) for it, kind in kinds.items()]
    return make_dataclass(name, fields, slots=True)


Time = message("Time", sec=int, nanosec=int)
Header = message("Header", stamp=Time, frame_id=str)
Point = message("Point", x=float, y=float, z=float)
Quaternion = message("Quaternion", x=float, y=float, z=float, w=lambda: 1.0)
Color = message("Color", r=float, g=float, b=float, a=float)
Pose = message("Pose", position=Point, orientation=Quaternion)
PoseWithCovariance = message("PoseWithCovariance", pose=Pose)
PoseStamped = message("PoseStamped", header=Header, pose=Pose)
Twist = message("Twist", linear=Point, angular=Point)
TwistWithCovariance = message("TwistWithCovariance", twist=Twist)
Odometry = message(
    "Odometry",
    header=Header,
    child_frame_id=str,
    pose=PoseWithCovariance,
    twist=TwistWithCovariance,
)
Path = message("Path", header=Header, poses=list)
Clock = message("Clock", clock=Time)
String = message("String", data=str)
Marker = message(
    "Marker", header=Header, ns=str, id=int, type=int, pose=Pose, scale=Point, color=Color
)
Marker.CUBE = 1
MarkerArray = message("MarkerArray", markers=list)
AckermannDrive = message(
    "AckermannDrive",
    **dict.fromkeys(
        ("steering_angle", "steering_angle_velocity", "speed", "acceleration", "jerk"), float
    ),
)
AckermannDriveStamped = message("AckermannDriveStamped", header=Header, drive=AckermannDrive)
