"""The elements of OpenSCENARIO that are played, ignored or refused: one list."""

from __future__ import annotations

from typing import Literal, NamedTuple

Treatment = Literal["played", "ignored", "refused"]


class Support(NamedTuple):
    """An element of the standard.

    words: how it is played, why it is ignored, or with what it is refused.
    """

    kind: str
    treatment: Treatment
    element: str
    words: str = "named with its line"


def _rows(kind: str, treatment: Treatment, *elements: tuple[str, ...]) -> list[Support]:
    """Elements of a kind.

    elements: each with its words, where there are any.
    """
    return [Support(kind, treatment, *element) for element in elements]


ROWS = (
    *_rows(
        "file", "played",
        (
            "ParameterDeclarations",
            "of the file, a story, a manoeuvre; with ConstraintGroup: of several groups one must "
            "hold"
        ),
        ("CatalogLocations", "every .xosc of a folder; entries with their parameters"),
        (
            "RoadNetwork",
            "OpenDRIVE: lines, arcs, spirals, parametric cubics, one lane section, constant "
            "widths and offset, flattened; "
            "other roads of the file may be of any kind"
        ),
        ("ParameterValueDistribution", "ranges, sets, sets of several; uniform, normal with a "
                                       "range"),
    ),
    *_rows(
        "file", "ignored",
        ("VariableDeclarations", "variables are read by stops alone"),
        ("MonitorDeclarations", "checks of a scenario file say what must hold"),
    ),
    *_rows(
        "entity", "played",
        ("Vehicle", "its bounding box; its category is its class in SUMO"),
        ("Pedestrian", "its bounding box"),
        ("MiscObject", "as a standing car of its size"),
    ),
    *_rows(
        "entity", "ignored",
        ("ObjectController", "the ADS drives the ego, scripts the actors"),
    ),
    *_rows(
        "entity", "refused",
        ("EntitySelection",),
    ),
    *_rows(
        "position", "played",
        ("LanePosition", ""),
        ("RelativeLanePosition", ""),
        ("RoadPosition", ""),
        ("RelativeRoadPosition", ""),
        ("RelativeObjectPosition", ""),
        ("RoutePosition", "FromLaneCoordinates, FromRoadCoordinates; one road, or straight"),
        ("TrajectoryPosition", ""),
        ("WorldPosition", "in the driving lane where it lies"),
        ("RelativeWorldPosition", ""),
        ("GeoPosition", "on a map of `+proj=tmerc` or `+proj=utm`"),
    ),
    *_rows(
        "shape", "played",
        ("Polyline", "straight of an ego, any of an actor"),
        ("ClothoidSpline", "of an ego that turns, or of an actor"),
    ),
    *_rows(
        "shape", "refused",
        ("Nurbs",),
    ),
    *_rows(
        "action", "played",
        ("TeleportAction", "before the start"),
        (
            "SpeedAction",
            "every shape; by rate, time, distance; absolute, relative to how the ego or "
            "another starts, or `continuous`"
        ),
        ("LaneChangeAction", "but step; by rate (peak speed), time, distance at one speed"),
        ("LaneOffsetAction", "sinusoidal, cubic, by maxLateralAcc"),
        ("LongitudinalDistanceAction", "`continuous`, or once: at the start, or within limits"),
        ("FollowTrajectoryAction", "of an actor, also with times; of the ego at the start"),
        ("AssignRouteAction", "along one road, or straight"),
        ("SynchronizeAction", "planned once; master the ego; a final speed with a steady "
                              "part"),
        ("EntityAction", "at the start"),
    ),
    *_rows(
        "action", "ignored",
        ("EnvironmentAction", "no weather and no light without a model of sensors"),
        ("AppearanceAction", "lights and animations move nothing"),
        ("VisibilityAction", "what an ADS sees is a setting of the simulation"),
        ("ControllerAction", "the ADS drives the ego from the start"),
        ("ActivateControllerAction", "the ADS drives the ego from the start"),
        ("VariableAction", "variables are read by stops alone"),
        ("ParameterAction", "parameters are read before the drive"),
        ("InfrastructureAction", "there are no signals"),
        ("UserDefinedAction", "its meaning is another tool's"),
    ),
    *_rows(
        "action", "refused",
        ("LateralDistanceAction",),
        ("SpeedProfileAction",),
        ("AcquirePositionAction",),
        ("TrafficAction",),
        ("TrailerAction",),
    ),
    *_rows(
        "condition", "played",
        ("SimulationTimeCondition", "as a stop it is the case's longest time"),
        ("StoryboardElementStateCondition", "complete, end, start and running"),
        ("ParameterCondition", "before the drive"),
        ("RelativeDistanceCondition", "every type"),
        ("DistanceCondition", "to an entity or a fixed place"),
        ("ReachPositionCondition", "a fixed place"),
        ("TimeHeadwayCondition", "along the road"),
        ("TimeToCollisionCondition", "along the road"),
        ("SpeedCondition", "along the road"),
        ("RelativeSpeedCondition", "along the road"),
        ("TraveledDistanceCondition", "along the road"),
    ),
    *_rows(
        "condition", "refused",
        ("VariableCondition", "as a start; in stops ignored"),
        ("CollisionCondition", "as a start; in stops ignored: contact ends every case"),
        ("StandStillCondition", "as a start; in stops ignored: standstill ends every case"),
        ("AngleCondition", "as a start; in stops ignored"),
        ("AccelerationCondition",),
        ("OffroadCondition", "as a start; in stops ignored: leaving the road ends every case"),
    ),
    *_rows(
        "trigger", "played",
        ("ConditionGroup", "and within a group, or between groups; delay; edges"),
        ("priority", "all that end or leave out nothing half-way; else refused"),
    ),
    *_rows(
        "trigger", "ignored",
        ("StopTrigger", "but by time; of an act: by a condition, over changes of speed"),
    ),
)  # fmt: skip


def table() -> str:
    """The list as a table of Markdown."""
    lines = ["| kind | element | | how |", "|---|---|---|---|"]
    lines += [f"| {it.kind} | `{it.element}` | {it.treatment} | {it.words} |" for it in ROWS]
    return "\n".join(lines)
