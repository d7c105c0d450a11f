"""nuPlan's planners: `compute_planner_trajectory(current_input)` with nuPlan's own objects.

Install nuPlan's devkit into the environment of sumo_eval (docs/ads/other_simulators.md). The road
becomes a map of two roadblocks in a row, which are the route.
"""

from __future__ import annotations

import math
from collections import deque
from types import SimpleNamespace
from typing import Any

import numpy as np
from nuplan.common.actor_state.agent import Agent
from nuplan.common.actor_state.ego_state import EgoState
from nuplan.common.actor_state.oriented_box import OrientedBox
from nuplan.common.actor_state.scene_object import SceneObjectMetadata
from nuplan.common.actor_state.state_representation import StateSE2, StateVector2D, TimePoint
from nuplan.common.actor_state.tracked_objects import TrackedObjects
from nuplan.common.actor_state.tracked_objects_types import TrackedObjectType
from nuplan.common.actor_state.vehicle_parameters import VehicleParameters
from nuplan.common.maps.maps_datatypes import SemanticMapLayer
from nuplan.planning.simulation.history.simulation_history_buffer import SimulationHistoryBuffer
from nuplan.planning.simulation.observation.observation_type import DetectionsTracks
from nuplan.planning.simulation.planner.abstract_planner import PlannerInitialization, PlannerInput
from nuplan.planning.simulation.simulation_time_controller.simulation_iteration import (
    SimulationIteration,
)
from other_tools import densified, found_agent, made_agent
from shapely.geometry import Point, Polygon

from sumo_eval.cosim.doors.controller import Briefing
from sumo_eval.cosim.doors.observation import Observation, SeenVehicle, lane_borders
from sumo_eval.cosim.plans import Plan
from sumo_eval.errors import ControllerError

_NAME = "nuplan_planner.py:NuPlanPlanner"
_HISTORY = 2.0  # s, nuPlan's own buffer
_TYPES = {
    "bicycle": TrackedObjectType.BICYCLE,
    "pedestrian": TrackedObjectType.PEDESTRIAN,
    "child": TrackedObjectType.PEDESTRIAN,
}
"""Motorcycles and lorries are vehicles in nuPlan."""


class NuPlanPlanner:
    """Drives a planner with nuPlan's interface.

    agent: a class, an object or the name of one, made with the options.
    """

    def __init__(self, agent: Any = None, **options: Any) -> None:
        kind = found_agent(agent, "compute_planner_trajectory", _NAME)
        self.agent = made_agent(kind, options, _NAME)

    def reset(self, scenario: Briefing) -> None:
        """`initialize(PlannerInitialization)`: the road as map and route, and the goal."""
        self._vehicle: VehicleParameters | None = None
        self._wheelbase, self._count = scenario.vehicle.wheelbase, 0
        self._interval = scenario.period if scenario.period > 0.0 else scenario.step
        size = max(round(_HISTORY / self._interval), 1) + 1
        self._states: deque[EgoState] = deque(maxlen=size)
        self._observed: deque[DetectionsTracks] = deque(maxlen=size)
        goal = StateSE2(*scenario.goal, 0.0)
        self.agent.initialize(PlannerInitialization(["0", "1"], goal, RoadMap(scenario)))

    def act(self, seen: Observation) -> Plan:
        """One iteration: the history of ego and tracked objects in, a trajectory out."""
        now = TimePoint(round(seen.time * 1e6))
        self._states.append(self._ego_state(seen, now))
        tracks = TrackedObjects([_tracked(it, now) for it in seen.vehicles])
        self._observed.append(DetectionsTracks(tracks))
        history = SimulationHistoryBuffer(self._states, self._observed, self._interval)
        current = PlannerInput(SimulationIteration(now, self._count), history, [])
        self._count += 1

        answer = self.agent.compute_planner_trajectory(current)
        if not callable(getattr(answer, "get_sampled_trajectory", None)):
            raise ControllerError(
                "`compute_planner_trajectory` of the ADS must return a trajectory with "
                f"`get_sampled_trajectory()`, got {type(answer).__name__}"
            )
        states = answer.get_sampled_trajectory()
        return Plan(
            [1e-6 * state.time_point.time_us for state in states],
            [state.center.x for state in states],
            [state.center.y for state in states],
            [state.center.heading for state in states],
            [state.dynamic_car_state.speed for state in states],
        )

    def _ego_state(self, seen: Observation, now: TimePoint) -> EgoState:
        me = seen.ego
        if self._vehicle is None:  # the rear axle is half a wheelbase behind the centre
            front, rear = (0.5 * (me.length + sign * self._wheelbase) for sign in (1.0, -1.0))
            axle = 0.5 * self._wheelbase
            self._vehicle = VehicleParameters(
                me.width, front, rear, axle, self._wheelbase, "ego", "car", 1.5
            )
        return EgoState.build_from_center(
            center=StateSE2(me.x, me.y, me.heading),
            center_velocity_2d=StateVector2D(me.speed, 0.0),
            center_acceleration_2d=StateVector2D(me.acceleration, 0.0),
            tire_steering_angle=0.0,
            time_point=now,
            vehicle_parameters=self._vehicle,
        )


class RoadMap:
    """The road as nuPlan's map: roadblocks `0` and `1`, lanes `0_K` and `1_K` from the right.

    A lane's `speed_limit_mps` is the desired speed of the case, as nuPlan's planners drive at it.
    """

    def __init__(self, scenario: Briefing) -> None:
        blocks = {name: SimpleNamespace(id=name, interior_edges=[]) for name in ("0", "1")}
        for number, line in enumerate(lane_borders(scenario.road)):
            centre, left, right = (densified(part) for part in (line.centre, line.left, line.right))
            middle = len(centre) // 2
            halves = slice(None, middle + 1), slice(middle, None)
            first, second = (
                Lane(f"{name}_{number}", blocks[name], scenario.desired_speed, part)
                for name, part in zip("01", halves, strict=True)
            )
            first.draw(centre[:middle], left, right)
            second.draw(centre[middle:], left, right)
            first.outgoing_edges, second.incoming_edges = [second], [first]
        self._blocks = blocks

    def get_map_object(self, object_id: str, layer: SemanticMapLayer) -> Any:
        """A roadblock or a lane, None for anything else."""
        if layer == SemanticMapLayer.ROADBLOCK:
            return self._blocks.get(object_id)
        lanes = [lane for block in self._blocks.values() for lane in block.interior_edges]
        named = (lane for lane in lanes if lane.id == object_id)
        return next(named, None) if layer == SemanticMapLayer.LANE else None


class Lane:
    """Half of a lane with the names of nuPlan's `LaneGraphEdgeMapObject`."""

    def __init__(self, name: str, block: Any, speed: float, part: slice) -> None:
        self.id, self.parent, self.speed_limit_mps, self._part = name, block, speed, part
        self.outgoing_edges: list[Lane] = []
        self.incoming_edges: list[Lane] = []
        block.interior_edges.append(self)

    def draw(self, centre: Any, left: Any, right: Any) -> None:
        """Its line and its area, from points (n, 2) m."""
        step = np.gradient(centre, axis=0)
        headings = np.arctan2(step[:, 1], step[:, 0])
        path = [StateSE2(x, y, h) for (x, y), h in zip(centre, headings, strict=True)]
        self.baseline_path = SimpleNamespace(discrete_path=path)
        self.polygon = Polygon([*left[self._part], *right[self._part][::-1]])

    def contains_point(self, point: Any) -> bool:
        """Whether the area has it."""
        return bool(self.polygon.contains(Point(point.x, point.y)))

    def get_roadblock_id(self) -> str:
        """The roadblock's `id`."""
        return str(self.parent.id)


def _tracked(it: SeenVehicle, now: TimePoint) -> Agent:
    name = str(it.number)
    velocity = StateVector2D(it.speed * math.cos(it.heading), it.speed * math.sin(it.heading))
    return Agent(
        _TYPES.get(it.kind, TrackedObjectType.VEHICLE),
        OrientedBox(StateSE2(it.x, it.y, it.heading), it.length, it.width, 1.5),
        velocity,
        SceneObjectMetadata(now.time_us, name, it.number, name),
    )
