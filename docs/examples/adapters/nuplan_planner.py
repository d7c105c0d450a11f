"""nuPlan planners: `AbstractPlanner.compute_planner_trajectory(current_input)` returns a
trajectory, driven as a Plan.

Frames agree: x, y m, heading rad counterclockwise. nuPlan's states are about the rear axle, and
know the centre too."""

from __future__ import annotations

import math
from collections import deque
from types import SimpleNamespace
from typing import Any

from other_tools import found_agent, made_agent

from sumo_eval.cosim.doors.controller import Briefing
from sumo_eval.cosim.doors.observation import Observation, SeenVehicle
from sumo_eval.cosim.plans import Plan
from sumo_eval.errors import ControllerError

_NAME = "nuplan_planner.py:NuPlanPlanner"
_MICRO = 1e6
_HISTORY = 2.0  # s, nuPlan's own buffer


class NuPlanPlanner:
    """Drives a planner with nuPlan's interface.

    agent: a class, an object or the name of one, made with the options.
    """

    def __init__(self, agent: Any = None, **options: Any) -> None:
        self.agent = made_agent(
            found_agent(agent, "compute_planner_trajectory", _NAME), options, _NAME
        )

    def reset(self, scenario: Briefing) -> None:
        """`initialize(PlannerInitialization)`: the goal, and no map: `map_api` is None."""
        self._rear = 0.5 * scenario.vehicle.wheelbase
        self._ratio = scenario.vehicle.steering_ratio
        self._iteration = 0
        step = scenario.period if scenario.period > 0.0 else scenario.step
        size = max(round(_HISTORY / step), 1) + 1
        self._states: deque[Any] = deque(maxlen=size)
        self._observed: deque[Any] = deque(maxlen=size)
        self._interval = step
        if callable(begin := getattr(self.agent, "initialize", None)):
            goal = SimpleNamespace(x=scenario.goal[0], y=scenario.goal[1], heading=0.0)
            begin(SimpleNamespace(route_roadblock_ids=[], mission_goal=goal, map_api=None))

    def act(self, seen: Observation) -> Plan:
        """One iteration: the history of ego and tracked objects in, a trajectory out."""
        self._states.append(self._ego_state(seen))
        objects = [_tracked(it) for it in seen.vehicles]
        self._observed.append(SimpleNamespace(tracked_objects=_Tracked(objects)))
        history = SimpleNamespace(
            ego_states=list(self._states), observations=list(self._observed),
            current_state=(self._states[-1], self._observed[-1]), size=len(self._states),
            sample_interval=self._interval,
        )  # fmt: skip
        time = SimpleNamespace(time_us=round(seen.time * _MICRO), time_s=seen.time)
        iteration = SimpleNamespace(
            time_point=time, index=self._iteration, time_us=time.time_us, time_s=seen.time
        )
        self._iteration += 1
        answer = self.agent.compute_planner_trajectory(
            SimpleNamespace(iteration=iteration, history=history, traffic_light_data=[])
        )
        if not callable(getattr(answer, "get_sampled_trajectory", None)):
            raise ControllerError(
                "`compute_planner_trajectory` of the ADS must return a trajectory with "
                "`get_sampled_trajectory()`, "
                f"got {type(answer).__name__}"
            )
        states = answer.get_sampled_trajectory()
        return Plan(
            [state.time_point.time_us / _MICRO for state in states],
            [state.center.x for state in states],
            [state.center.y for state in states], [state.center.heading for state in states],
            [state.dynamic_car_state.speed for state in states],
        )  # fmt: skip

    def _ego_state(self, seen: Observation) -> SimpleNamespace:
        me = seen.ego
        c, s = math.cos(me.heading), math.sin(me.heading)
        centre = SimpleNamespace(x=me.x, y=me.y, heading=me.heading)
        rear = SimpleNamespace(x=me.x - self._rear * c, y=me.y - self._rear * s, heading=me.heading)
        box = SimpleNamespace(center=centre, length=me.length, width=me.width, height=1.5)
        velocity, acceleration = (
            SimpleNamespace(x=me.speed, y=0.0),
            SimpleNamespace(x=me.acceleration, y=0.0),
        )
        moving = SimpleNamespace(
            rear_axle_velocity_2d=velocity, rear_axle_acceleration_2d=acceleration,
            center_velocity_2d=velocity,
            center_acceleration_2d=acceleration, speed=me.speed, acceleration=me.acceleration,
        )  # fmt: skip
        micro = round(seen.time * _MICRO)
        return SimpleNamespace(
            center=centre, rear_axle=rear, dynamic_car_state=moving, time_us=micro,
            time_seconds=seen.time,
            time_point=SimpleNamespace(time_us=micro, time_s=seen.time),
            car_footprint=SimpleNamespace(center=centre, rear_axle=rear, oriented_box=box,
                length=me.length,
                                          width=me.width),
        )  # fmt: skip


class _Tracked:
    """As nuPlan's `TrackedObjects`."""

    def __init__(self, objects: list[Any]) -> None:
        self.tracked_objects = objects

    def get_agents(self) -> list[Any]:
        """All of them: every one moves."""
        return self.tracked_objects

    def __iter__(self) -> Any:
        return iter(self.tracked_objects)

    def __len__(self) -> int:
        return len(self.tracked_objects)


_VEHICLE, _PERSON = (
    SimpleNamespace(name="VEHICLE", value=0),
    SimpleNamespace(name="PEDESTRIAN", value=1),
)
_TYPES = {
    "bicycle": SimpleNamespace(name="BICYCLE", value=2),
    "pedestrian": _PERSON,
    "child": _PERSON,
}
"""nuPlan's `TrackedObjectType` of a kind; motorcycles and lorries are vehicles there."""


def _tracked(it: SeenVehicle) -> SimpleNamespace:
    centre = SimpleNamespace(x=it.x, y=it.y, heading=it.heading)
    velocity = SimpleNamespace(x=it.speed * math.cos(it.heading), y=it.speed * math.sin(it.heading))
    return SimpleNamespace(
        center=centre, velocity=velocity, track_token=str(it.number),
        box=SimpleNamespace(center=centre, length=it.length, width=it.width, height=1.5),
        tracked_object_type=_TYPES.get(it.kind, _VEHICLE),
        metadata=SimpleNamespace(track_token=str(it.number)),
    )  # fmt: skip
