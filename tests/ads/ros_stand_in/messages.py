"""ROS 2 messages, with the fields that they have there; unknown fields are refused, as there."""

from dataclasses import dataclass, field


@dataclass(slots=True)
class Time:
    sec: int = 0
    nanosec: int = 0


@dataclass(slots=True)
class Header:
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass(slots=True)
class Point:
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass(slots=True)
class Quaternion(Point):
    w: float = 1.0


@dataclass(slots=True)
class Color:
    r: float = 0.0
    g: float = 0.0
    b: float = 0.0
    a: float = 0.0


@dataclass(slots=True)
class Pose:
    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass(slots=True)
class PoseWithCovariance:
    pose: Pose = field(default_factory=Pose)


@dataclass(slots=True)
class PoseStamped:
    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@dataclass(slots=True)
class Twist:
    linear: Point = field(default_factory=Point)
    angular: Point = field(default_factory=Point)


@dataclass(slots=True)
class TwistWithCovariance:
    twist: Twist = field(default_factory=Twist)


@dataclass(slots=True)
class Odometry:
    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass(slots=True)
class Path:
    header: Header = field(default_factory=Header)
    poses: list = field(default_factory=list)


@dataclass(slots=True)
class Clock:
    clock: Time = field(default_factory=Time)


@dataclass(slots=True)
class String:
    data: str = ""


@dataclass
class Marker:
    CUBE = 1
    header: Header = field(default_factory=Header)
    ns: str = ""
    id: int = 0
    type: int = 0
    pose: Pose = field(default_factory=Pose)
    scale: Point = field(default_factory=Point)
    color: Color = field(default_factory=Color)


@dataclass(slots=True)
class MarkerArray:
    markers: list = field(default_factory=list)


@dataclass(slots=True)
class AckermannDrive:
    steering_angle: float = 0.0
    steering_angle_velocity: float = 0.0
    speed: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0


@dataclass(slots=True)
class AckermannDriveStamped:
    header: Header = field(default_factory=Header)
    drive: AckermannDrive = field(default_factory=AckermannDrive)
