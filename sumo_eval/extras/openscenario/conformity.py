"""What of OpenSCENARIO plays, what is ignored because it means nothing here, and what is refused: one list."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

Treatment = Literal["played", "ignored", "refused"]


class Row(NamedTuple):
    """An element of the standard. words: how it is played, why it is ignored, or with what it is refused."""

    kind: str
    element: str
    treatment: Treatment
    words: str


ROWS = (
    Row(
        "file",
        "ParameterDeclarations",
        "played",
        "of the file, a story, a manoeuvre; with ConstraintGroup: of several groups one must hold",
    ),
    Row("file", "VariableDeclarations", "ignored", "variables are read by stops alone"),
    Row("file", "CatalogLocations", "played", "every .xosc of a folder; entries with their parameters"),
    Row(
        "file",
        "RoadNetwork",
        "played",
        "OpenDRIVE: lines, arcs, spirals, parametric cubics, one lane section, constant widths and offset, level; "
        "other roads of the file may be of any kind",
    ),
    Row("file", "ParameterValueDistribution", "played", "ranges, sets, sets of several; uniform, normal with a range"),
    Row("file", "MonitorDeclarations", "ignored", "checks of a scenario file say what must hold"),
    Row("entity", "Vehicle", "played", "its bounding box; its category is its class in SUMO"),
    Row("entity", "Pedestrian", "played", "its bounding box"),
    Row("entity", "MiscObject", "played", "as a standing car of its size"),
    Row("entity", "ObjectController", "ignored", "the ADS drives the ego, scripts the others"),
    Row("entity", "EntitySelection", "refused", ""),
    Row("position", "LanePosition", "played", ""),
    Row("position", "RelativeLanePosition", "played", "`dsLane` on straight roads only"),
    Row("position", "RoadPosition", "played", ""),
    Row("position", "RelativeRoadPosition", "played", ""),
    Row("position", "RelativeObjectPosition", "played", ""),
    Row("position", "RoutePosition", "played", "FromLaneCoordinates, FromRoadCoordinates; straight routes"),
    Row("position", "TrajectoryPosition", "played", ""),
    Row("position", "WorldPosition", "played", ""),
    Row("position", "RelativeWorldPosition", "refused", ""),
    Row("position", "GeoPosition", "refused", ""),
    Row("shape", "Polyline", "played", "straight; others only as places on them"),
    Row("shape", "ClothoidSpline", "played", "the way of an ego that turns; of others as places on it"),
    Row("shape", "Nurbs", "refused", ""),
    Row("action", "TeleportAction", "played", "before the start"),
    Row("action", "SpeedAction", "played", "step, linear; by rate, time, distance; absolute, or relative to how "
                                           "the ego "
                                           "or another starts"),
    Row("action", "LaneChangeAction", "played", "sinusoidal, linear; by rate (peak speed), time"),
    Row("action", "LaneOffsetAction", "played", "sinusoidal, by maxLateralAcc"),
    Row("action", "LongitudinalDistanceAction", "played", "once, at the start, free space"),
    Row("action", "FollowTrajectoryAction", "played", "straight on the map, with times or without; "
                                                     "the ego's may bend"),
    Row("action", "AssignRouteAction", "played", "a route that goes straight"),
    Row("action", "SynchronizeAction", "played", "planned once; master the ego; AbsoluteSpeed with a steady part"),
    Row("action", "EntityAction", "played", "DeleteEntityAction at the start"),
    Row("action", "EnvironmentAction", "ignored", "no weather and no light without a model of sensors"),
    Row("action", "AppearanceAction", "ignored", "lights and animations move nothing"),
    Row("action", "VisibilityAction", "ignored", "what an ADS sees is a setting of the simulation"),
    Row("action", "ControllerAction", "ignored", "the ADS drives the ego from the start"),
    Row("action", "ActivateControllerAction", "ignored", "the ADS drives the ego from the start"),
    Row("action", "VariableAction", "ignored", "variables are read by stops alone"),
    Row("action", "ParameterAction", "ignored", "parameters are read before the drive"),
    Row("action", "InfrastructureAction", "ignored", "there are no signals"),
    Row("action", "UserDefinedAction", "ignored", "nobody else knows what it means"),
    Row("action", "LateralDistanceAction", "refused", ""),
    Row("action", "SpeedProfileAction", "refused", ""),
    Row("action", "AcquirePositionAction", "refused", ""),
    Row("action", "TrafficAction", "refused", ""),
    Row("action", "TrailerAction", "refused", ""),
    Row("condition", "SimulationTimeCondition", "played", "as a stop it is the case's longest time"),
    Row("condition", "StoryboardElementStateCondition", "played", "complete, end, start and running"),
    Row("condition", "ParameterCondition", "played", "before the drive"),
    Row("condition", "VariableCondition", "refused", "as a start; in stops ignored"),
    Row("condition", "RelativeDistanceCondition", "played", "longitudinal, free space"),
    Row("condition", "TimeHeadwayCondition", "played", "free space"),
    Row("condition", "TimeToCollisionCondition", "played", "free space, to an entity"),
    Row("condition", "SpeedCondition", "played", "along the road"),
    Row("condition", "RelativeSpeedCondition", "played", "along the road"),
    Row("condition", "TraveledDistanceCondition", "played", "along the road"),
    Row("condition", "CollisionCondition", "refused", "as a start; in stops ignored: contact ends every case"),
    Row("condition", "StandStillCondition", "refused", "as a start; in stops ignored: standstill ends every case"),
    Row("condition", "AngleCondition", "refused", "as a start; in stops ignored"),
    Row("condition", "AccelerationCondition", "refused", ""),
    Row("condition", "ReachPositionCondition", "refused", ""),
    Row("condition", "DistanceCondition", "refused", ""),
    Row("condition", "OffroadCondition", "refused", "as a start; in stops ignored: leaving the road ends every case"),
    Row("trigger", "ConditionGroup", "played", "and within a group, or between groups; delay; edges none and rising"),
    Row("trigger", "StopTrigger", "ignored", "but by time; of an act in which somebody then still moves: refused"),
    Row("trigger", "priority", "played", "all that end or leave out nothing half-way; else refused"),
)  # fmt: skip

USED: Mapping[str, tuple[int, int]] = MappingProxyType({
    "ParameterDeclarations": (15, 20),
    "VariableDeclarations": (0, 10),
    "CatalogLocations": (15, 10),
    "RoadNetwork": (15, 10),
    "ParameterValueDistribution": (14, 22),
    "Vehicle": (6, 7),
    "Pedestrian": (1, 2),
    "MiscObject": (1, 0),
    "ObjectController": (15, 0),
    "LanePosition": (26, 24),
    "RelativeLanePosition": (9, 3),
    "RoadPosition": (0, 10),
    "RelativeRoadPosition": (0, 1),
    "RelativeObjectPosition": (0, 5),
    "RoutePosition": (0, 15),
    "TrajectoryPosition": (0, 8),
    "Polyline": (1, 10),
    "ClothoidSpline": (0, 3),
    "TeleportAction": (33, 25),
    "SpeedAction": (29, 14),
    "LaneChangeAction": (4, 0),
    "LaneOffsetAction": (5, 0),
    "LongitudinalDistanceAction": (5, 1),
    "FollowTrajectoryAction": (1, 6),
    "AssignRouteAction": (0, 6),
    "SynchronizeAction": (0, 7),
    "EntityAction": (0, 3),
    "EnvironmentAction": (0, 10),
    "AppearanceAction": (0, 5),
    "ControllerAction": (15, 0),
    "ActivateControllerAction": (15, 0),
    "VariableAction": (0, 2),
    "SimulationTimeCondition": (54, 3),
    "StoryboardElementStateCondition": (8, 2),
    "ParameterCondition": (0, 6),
    "VariableCondition": (0, 21),
    "RelativeDistanceCondition": (4, 2),
    "TimeHeadwayCondition": (1, 0),
    "SpeedCondition": (0, 1),
    "RelativeSpeedCondition": (0, 2),
    "TraveledDistanceCondition": (0, 13),
    "CollisionCondition": (0, 1),
    "StandStillCondition": (0, 11),
    "AngleCondition": (0, 1),
    "ConditionGroup": (67, 50),
    "StopTrigger": (15, 11),
})  # fmt: skip
"""How often the files of UN R157 (asam-oss/OSC-ALKS-scenarios) and of Euro NCAP 2026, frontal, standard range
(vectorgrp/OSC-NCAP-scenarios) use an element, with the scenario files and catalogs that they name; others: never.
"""


def table() -> str:
    """The list as a table of Markdown."""
    lines = ["| kind | element | | how | UN R157 | Euro NCAP |", "|---|---|---|---|---|---|"]
    for row in ROWS:
        counts = " | ".join(str(count) if count else "" for count in USED.get(row.element, (0, 0)))
        lines.append(
            f"| {row.kind} | `{row.element}` | {row.treatment} | {row.words or 'named with its line'} | {counts} |"
        )
    return "\n".join(lines)
