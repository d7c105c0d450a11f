"""What of OpenSCENARIO plays, what is ignored because it means nothing here, and what is refused:
one list.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

Treatment = Literal["played", "ignored", "refused"]


class Support(NamedTuple):
    """An element of the standard.

    words: how it is played, why it is ignored, or with what it is refused.

    used: how often the files of UN R157 (asam-oss/OSC-ALKS-scenarios) and of Euro NCAP 2026,
        frontal, standard range
    (vectorgrp/OSC-NCAP-scenarios) have it, with the scenario files and catalogs that they name.
    """

    kind: str
    treatment: Treatment
    element: str
    words: str
    used: tuple[int, ...]


def _rows(kind: str, treatment: Treatment, *elements: tuple[Any, ...]) -> list[Support]:
    """Elements of a kind.

    elements: each with its words and how often it is used, where there are any.
    """
    return [
        Support(kind, treatment, name, (*rest, "")[0], tuple(rest[1:]) or (0, 0))
        for name, *rest in elements
    ]


ROWS = (
    *_rows(
        "file", "played",
        (
            "ParameterDeclarations",
            "of the file, a story, a manoeuvre; with ConstraintGroup: of several groups one must "
            "hold", 15, 20,
        ),
        ("CatalogLocations", "every .xosc of a folder; entries with their parameters", 15, 10),
        (
            "RoadNetwork",
            "OpenDRIVE: lines, arcs, spirals, parametric cubics, one lane section, constant "
            "widths and offset, flattened; "
            "other roads of the file may be of any kind", 15, 10,
        ),
        ("ParameterValueDistribution", "ranges, sets, sets of several; uniform, normal with a "
                                       "range", 14, 22),
    ),
    *_rows(
        "file", "ignored",
        ("VariableDeclarations", "variables are read by stops alone", 0, 10),
        ("MonitorDeclarations", "checks of a scenario file say what must hold"),
    ),
    *_rows(
        "entity", "played",
        ("Vehicle", "its bounding box; its category is its class in SUMO", 6, 7),
        ("Pedestrian", "its bounding box", 1, 2),
        ("MiscObject", "as a standing car of its size", 1, 0),
    ),
    *_rows(
        "entity", "ignored",
        ("ObjectController", "the ADS drives the ego, scripts the others", 15, 0),
    ),
    *_rows(
        "entity", "refused",
        ("EntitySelection",),
    ),
    *_rows(
        "position", "played",
        ("LanePosition", "", 26, 24),
        ("RelativeLanePosition", "`dsLane` on straight roads only", 9, 3),
        ("RoadPosition", "", 0, 10),
        ("RelativeRoadPosition", "", 0, 1),
        ("RelativeObjectPosition", "", 0, 5),
        ("RoutePosition", "FromLaneCoordinates, FromRoadCoordinates; straight routes", 0, 15),
        ("TrajectoryPosition", "", 0, 8),
        ("WorldPosition", "in the driving lane where it lies"),
    ),
    *_rows(
        "position", "refused",
        ("RelativeWorldPosition",),
        ("GeoPosition",),
    ),
    *_rows(
        "shape", "played",
        ("Polyline", "straight; others only as places on them", 1, 10),
        ("ClothoidSpline", "the way of an ego that turns; of others as places on it", 0, 3),
    ),
    *_rows(
        "shape", "refused",
        ("Nurbs",),
    ),
    *_rows(
        "action", "played",
        ("TeleportAction", "before the start", 33, 25),
        (
            "SpeedAction",
            "every shape; by rate, time, distance; absolute, relative to how the ego or "
            "another starts, or `continuous`", 29, 14,
        ),
        ("LaneChangeAction", "but step; by rate (peak speed), time, distance at one speed", 4, 0),
        ("LaneOffsetAction", "sinusoidal, cubic, by maxLateralAcc", 5, 0),
        ("LongitudinalDistanceAction", "once at the start, or `continuous`; without limits", 5, 1),
        ("FollowTrajectoryAction", "straight on the map, with times or without; the ego's may "
                                   "bend", 1, 6),
        ("AssignRouteAction", "a route that goes straight", 0, 6),
        ("SynchronizeAction", "planned once; master the ego; a final speed with a steady "
                              "part", 0, 7),
        ("EntityAction", "at the start", 0, 3),
    ),
    *_rows(
        "action", "ignored",
        ("EnvironmentAction", "no weather and no light without a model of sensors", 0, 10),
        ("AppearanceAction", "lights and animations move nothing", 0, 5),
        ("VisibilityAction", "what an ADS sees is a setting of the simulation"),
        ("ControllerAction", "the ADS drives the ego from the start", 15, 0),
        ("ActivateControllerAction", "the ADS drives the ego from the start", 15, 0),
        ("VariableAction", "variables are read by stops alone", 0, 2),
        ("ParameterAction", "parameters are read before the drive"),
        ("InfrastructureAction", "there are no signals"),
        ("UserDefinedAction", "nobody else knows what it means"),
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
        ("SimulationTimeCondition", "as a stop it is the case's longest time", 54, 3),
        ("StoryboardElementStateCondition", "complete, end, start and running", 8, 2),
        ("ParameterCondition", "before the drive", 0, 6),
        ("RelativeDistanceCondition", "every type", 4, 2),
        ("DistanceCondition", "to an entity or a fixed place"),
        ("ReachPositionCondition", "a fixed place"),
        ("TimeHeadwayCondition", "along the road", 1, 0),
        ("TimeToCollisionCondition", "along the road"),
        ("SpeedCondition", "along the road", 0, 1),
        ("RelativeSpeedCondition", "along the road", 0, 2),
        ("TraveledDistanceCondition", "along the road", 0, 13),
    ),
    *_rows(
        "condition", "refused",
        ("VariableCondition", "as a start; in stops ignored", 0, 21),
        ("CollisionCondition", "as a start; in stops ignored: contact ends every case", 0, 1),
        ("StandStillCondition", "as a start; in stops ignored: standstill ends every case", 0, 11),
        ("AngleCondition", "as a start; in stops ignored", 0, 1),
        ("AccelerationCondition",),
        ("OffroadCondition", "as a start; in stops ignored: leaving the road ends every case"),
    ),
    *_rows(
        "trigger", "played",
        ("ConditionGroup", "and within a group, or between groups; delay; edges", 67, 50),
        ("priority", "all that end or leave out nothing half-way; else refused"),
    ),
    *_rows(
        "trigger", "ignored",
        ("StopTrigger", "but by time; of an act: by a condition, over changes of speed", 15, 11),
    ),
)  # fmt: skip


def table() -> str:
    """The list as a table of Markdown."""
    lines = ["| kind | element | | how | UN R157 | Euro NCAP |", "|---|---|---|---|---|---|"]
    for row in ROWS:
        counts = " | ".join(str(count) if count else "" for count in row.used)
        lines.append(
            f"| {row.kind} | `{row.element}` | {row.treatment} | "
            f"{row.words or 'named with its line'} | {counts} |"
        )
    return "\n".join(lines)
