"""The elements of OpenSCENARIO that are played, ignored or refused: one list.

The readers ignore the actions that the list has as ignored; `sumo-eval import --conformity` prints
the list. All other entries only describe what the readers of this package do.

Users: `extras/openscenario/command.py`, `extras/openscenario/places.py`,
`extras/openscenario/story.py`.
"""

NAMED = "named with its line"
"""How most elements are refused: the message names the element and its line."""


ROWS = {
    ("file", "played"): {
        "ParameterDeclarations": (
            "of the file, a story, a manoeuvre; with ConstraintGroup: of several groups one "
            "must hold"
        ),
        "CatalogLocations": "every .xosc of a folder; entries with their parameters",
        "RoadNetwork": (
            "OpenDRIVE: lines, arcs, spirals, parametric cubics, one lane section, constant "
            "widths and offset, flattened, without objects, signals, limits; other roads of the "
            "file may be of any kind"
        ),
        "ParameterValueDistribution": "ranges, sets, sets of several; uniform, normal with a range",
    },
    ("file", "ignored"): {
        "VariableDeclarations": "variables are read by stops alone",
        "MonitorDeclarations": "checks of a scenario file say what must hold",
        "TrafficSignals": "there are no signals",
    },
    ("entity", "played"): {
        "Vehicle": "its bounding box; its category is its class in SUMO",
        "Pedestrian": "its bounding box",
        "MiscObject": "as a standing car of its size",
    },
    ("entity", "ignored"): {
        "Performance": "the ego's limits are settings, scripts are exact",
        "ObjectController": "the ADS drives the ego, scripts the actors",
        "Trailer": "a vehicle is its own bounding box",
    },
    ("entity", "refused"): {
        "EntitySelection": NAMED,
    },
    ("position", "played"): {
        "LanePosition": "",
        "RelativeLanePosition": "",
        "RoadPosition": "",
        "RelativeRoadPosition": "",
        "RelativeObjectPosition": "",
        "RoutePosition": "FromLaneCoordinates, FromRoadCoordinates; one road, or straight",
        "TrajectoryPosition": "",
        "WorldPosition": "in the driving lane where it lies",
        "RelativeWorldPosition": "",
        "GeoPosition": "on a map of `+proj=tmerc` or `+proj=utm`",
    },
    ("shape", "played"): {
        "Polyline": "straight of an ego, any of an actor",
        "ClothoidSpline": "of an ego that turns, or of an actor",
    },
    ("shape", "refused"): {
        "Nurbs": NAMED,
        "Clothoid": NAMED,
    },
    ("action", "played"): {
        "TeleportAction": "before the start",
        "SpeedAction": (
            "every shape; by rate, time, distance; absolute, relative to how the ego starts or "
            "an actor drives, or `continuous`"
        ),
        "LaneChangeAction": "but step; by rate (peak speed), time, distance at one speed",
        "LaneOffsetAction": "sinusoidal, cubic, by maxLateralAcc",
        "LongitudinalDistanceAction": "`continuous`, or once: at the start, or within limits",
        "FollowTrajectoryAction": "of an actor, also with times; of the ego at the start",
        "AssignRouteAction": "along one road, or straight",
        "SynchronizeAction": "planned once; master the ego; a final speed with a steady part",
        "EntityAction": "at the start",
    },
    ("action", "ignored"): {
        "EnvironmentAction": "no weather and no light without a model of sensors",
        "AppearanceAction": "lights and animations move nothing",
        "VisibilityAction": "what an ADS sees is a setting of the simulation",
        "ControllerAction": "the ADS drives the ego from the start",
        "ActivateControllerAction": "the ADS drives the ego from the start",
        "SetMonitorAction": "checks of a scenario file say what must hold",
        "VariableAction": "variables are read by stops alone",
        "ParameterAction": "parameters are read before the drive",
        "InfrastructureAction": "there are no signals",
        "UserDefinedAction": "its meaning is another tool's",
    },
    ("action", "refused"): dict.fromkeys(
        (
            "LateralDistanceAction",
            "SpeedProfileAction",
            "AcquirePositionAction",
            "RandomRouteAction",
            "TrafficAction",
            "TrailerAction",
        ),
        NAMED,
    ),
    ("condition", "played"): {
        "SimulationTimeCondition": "as a stop it is the case's longest time",
        "StoryboardElementStateCondition": "complete, end, start and running",
        "ParameterCondition": "before the drive",
        "RelativeDistanceCondition": "every type",
        "DistanceCondition": "to an entity or a fixed place",
        "ReachPositionCondition": "a fixed place",
        "TimeHeadwayCondition": "as it drives",
        "TimeToCollisionCondition": "along the road",
        "SpeedCondition": "as it drives",
        "RelativeSpeedCondition": "along the road",
        "TraveledDistanceCondition": "along the road",
    },
    ("condition", "refused"): {
        **dict.fromkeys(
            (
                "VariableCondition",
                "TimeOfDayCondition",
                "UserDefinedValueCondition",
                "TrafficSignalCondition",
                "TrafficSignalControllerCondition",
                "AngleCondition",
                "RelativeAngleCondition",
                "AccelerationCondition",
                "RelativeClearanceCondition",
            ),
            "as a start; in stops ignored",
        ),
        "CollisionCondition": "as a start; in stops ignored: contact ends every case",
        "StandStillCondition": "as a start; in stops ignored: standstill ends every case",
        "OffroadCondition": "as a start; in stops ignored: leaving the road ends every case",
        "EndOfRoadCondition": "as a start; in stops ignored: the road's end ends every case",
    },
    ("trigger", "played"): {
        "ConditionGroup": "and within a group, or between groups; delay; edges",
        "priority": "all that end or leave out nothing half-way; else refused",
    },
    ("trigger", "ignored"): {
        "StopTrigger": "but by time; of an act: by a condition, over changes of speed",
    },
}
"""By kind and treatment (`played`, `ignored` or `refused`): the elements of the standard, each with
how it is played, why it is ignored, or how it is refused.
"""
IGNORED = tuple(ROWS["action", "ignored"])
"""Actions that move no vehicle here."""


def table() -> str:
    """The list as a table of Markdown."""
    lines = ["| kind | element | | how |", "|---|---|---|---|"]
    for (kind, treatment), rows in ROWS.items():
        lines += [f"| {kind} | `{name}` | {treatment} | {words} |" for name, words in rows.items()]
    return "\n".join(lines)
