"""What of OpenSCENARIO plays, what is ignored because it means nothing here, and what is refused: one list."""

from __future__ import annotations

from typing import Literal, NamedTuple

Treatment = Literal["played", "ignored", "refused"]


class Row(NamedTuple):
    """An element of the standard. words: how it is played, why it is ignored, or with what it is refused."""

    kind: str
    element: str
    treatment: Treatment
    words: str


ROWS = (
    Row("file", "ParameterDeclarations", "played", "with ConstraintGroup: of several groups one must hold"),
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
    Row("trigger", "StopTrigger", "ignored", "but by time: contact, standstill, the road's end, a decided case do"),
    Row("trigger", "priority", "played", "all; two moves across at once are refused"),
)  # fmt: skip


def table() -> str:
    """The list as a table of Markdown."""
    lines = ["| kind | element | | how |", "|---|---|---|---|"]
    lines += [
        f"| {row.kind} | `{row.element}` | {row.treatment} | {row.words or 'named with its line'} |" for row in ROWS
    ]
    return "\n".join(lines)
