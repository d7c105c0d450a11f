"""SMARTS agents: `Agent.act(obs)` with the action of its action space, named by the option
`action`.

The observation has SMARTS's own classes where SMARTS is installed. Its headings are 0 to the north
(y) and grow counterclockwise, and it leaves open where steering turns.
"""

from __future__ import annotations

import math
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import numpy as np
from other_tools import found_agent, made_agent

from sumo_eval.cosim.doors.controller import Briefing
from sumo_eval.cosim.doors.observation import Observation
from sumo_eval.cosim.plans import Plan, Wanted
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import ControllerError, must_be, unknown

_NAME = "smarts_agent.py:SmartsAgent"
ACTIONS = {
    "Continuous": 3,
    "Lane": 1,
    "LaneWithContinuousSpeed": 2,
    "TargetPose": 4,
    "Trajectory": 4,
    "MPC": 4,
    "TrajectoryWithTime": 5,
}
"""Supported members of SMARTS's `ActionSpaceType`, and the parts of an action."""
LANE_ACTIONS = {
    "keep_lane": (15.0, 0),
    "slow_down": (0.0, 0),
    "change_lane_left": (12.5, 1),
    "change_lane_right": (12.5, -1),
}
"""Speed, m/s, and lanes to the left of a `Lane` action, SMARTS's own."""
_LANE_TIME = 3.0  # s to the centre line of a lane
_AHEAD = 80.0  # m of waypoints


@cache
def _class(module: str, name: str, otherwise: Any = SimpleNamespace) -> Any:
    return getattr(import_module(module), name) if find_spec("smarts") else otherwise


class SmartsAgent:
    """Drives an agent with SMARTS's interface.

    agent: a class, an object or the name of one, made with the options.

    action: `Continuous` (throttle, brake, steering), `Lane` (a word), `LaneWithContinuousSpeed`
        (speed m/s, lanes to the left), `TargetPose` (x, y, heading, s from now), `Trajectory` or
        `MPC` (xs, ys, headings, speeds of a path) or `TrajectoryWithTime` (times from the call on,
        s, before those).
    steering: where positive steering turns, `right` or `left`.
    """

    def __init__(
        self, agent: Any = None, action: str = "Continuous", steering: str = "right", **options: Any
    ) -> None:
        if action not in ACTIONS:
            raise unknown(f"`action` of {_NAME}", action, ACTIONS)
        if steering not in ("right", "left"):
            raise must_be("`steering`", _NAME, "`right` or `left`", steering)
        self.agent = made_agent(found_agent(agent, "act", _NAME), options, _NAME)
        self._action, self._left = action, (1.0 if steering == "left" else -1.0)

    def reset(self, scenario: Briefing) -> None:
        """Start a case: no steps, no lane change."""
        self._step = scenario.period if scenario.period > 0.0 else scenario.step
        self._count, self._travelled = 0, 0.0
        self._wanted = scenario.desired_speed
        self._lane, self._began = -1, (0.0, 0.0, 0.0)

    def act(self, seen: Observation) -> Wanted:
        """Show what SMARTS would, take the action.

        Raises ControllerError for one of another form.
        """
        answer = self.agent.act(self._shown(seen))
        self._count += 1
        self._travelled += self._step * seen.ego.speed
        width = ACTIONS[self._action]
        if self._action == "Lane":
            if answer not in LANE_ACTIONS:
                raise ControllerError(
                    f"`act` of the ADS must return one of {', '.join(LANE_ACTIONS)} for `Lane`, "
                    f"got {answer!r}"
                )
            return self._to_lane(seen, *LANE_ACTIONS[answer])
        try:
            parts = tuple(answer)
        except TypeError:
            parts = ()
        if len(parts) != width:
            raise ControllerError(
                f"`act` of the ADS must return {width} parts for `{self._action}`, got {answer!r}"
            )
        if self._action == "Continuous":
            throttle, brake = (float(np.clip(part, 0.0, 1.0)) for part in parts[:2])
            return Command.pedals(throttle, brake, self._left * float(np.clip(parts[2], -1, 1)))
        if self._action == "LaneWithContinuousSpeed":
            return self._to_lane(seen, float(parts[0]), int(parts[1]))
        if self._action == "TargetPose":
            return self._to_pose(seen, *(float(part) for part in parts))
        xs, ys, headings, speeds = (np.asarray(part, float) for part in parts[-4:])
        times = np.asarray(parts[0], float) if width == 5 else _times(seen, xs, ys, speeds)
        return Plan(seen.time + times, xs, ys, headings + 0.5 * math.pi, speeds)

    def _to_lane(self, seen: Observation, speed: float, change: int) -> Plan:
        """At a speed to the centre line of a lane: a cubic in time from the ego's place when the
        agent asked for it."""
        me = seen.ego
        if change or self._lane < 0:
            self._lane = min(max(me.lane + change, 0), seen.road.lanes - 1)
            self._began = seen.time, me.y, me.speed * math.sin(me.heading) * _LANE_TIME
        began, y, slope = self._began
        ahead = np.linspace(0.0, _LANE_TIME, 13)
        u = np.minimum((seen.time + ahead - began) / _LANE_TIME, 1.0)
        off = seen.road.lane_centre(self._lane) - y
        across = y + slope * u + (3.0 * off - 2.0 * slope) * u**2 + (slope - 2.0 * off) * u**3
        return Plan(
            seen.time + ahead, me.x + speed * ahead, across, speed=np.full_like(ahead, speed)
        )

    def _to_pose(self, seen: Observation, x: float, y: float, heading: float, after: float) -> Plan:
        """Straight to a pose at a constant speed."""
        me = seen.ego
        after = max(after, self._step)
        speed = math.dist((x, y), (me.x, me.y)) / after
        headings = [heading + 0.5 * math.pi] * 2
        return Plan([seen.time, seen.time + after], [me.x, x], [me.y, y], headings, [speed] * 2)

    def _shown(self, seen: Observation) -> Any:
        me = seen.ego
        direction = np.array([math.cos(me.heading), math.sin(me.heading), 0.0])
        goal = SimpleNamespace(position=SimpleNamespace(x=seen.goal[0], y=seen.goal[1], z=0.0))
        ego = _class("smarts.core.observations", "EgoVehicleObservation")(
            **_vehicle("ego", me, seen),
            steering=0.0,
            yaw_rate=0.0,
            mission=SimpleNamespace(goal=goal),
            linear_velocity=me.speed * direction,
            angular_velocity=np.zeros(3),
            linear_acceleration=me.acceleration * direction,
            angular_acceleration=None,
            linear_jerk=None,
            angular_jerk=None,
        )
        actor = _class("smarts.core.observations", "VehicleObservation")
        return _class("smarts.core.observations", "Observation")(
            dt=self._step,
            step_count=self._count,
            steps_completed=self._count,
            elapsed_sim_time=seen.time,
            events=_EVENTS,
            ego_vehicle_state=ego,
            under_this_agent_control=True,
            neighborhood_vehicle_states=tuple(
                actor(**_vehicle(str(it.number), it, seen)) for it in seen.vehicles
            ),
            waypoint_paths=_waypoints(seen, self._wanted),
            distance_travelled=self._travelled,
            road_waypoints=None,
            via_data=SimpleNamespace(near_via_points=(), hit_via_points=()),
        )


_ENDS = ("off_road", "off_route", "on_shoulder", "wrong_way", "not_moving", "reached_goal")
_EVENTS = SimpleNamespace(collisions=(), **dict.fromkeys(_ENDS, False))
"""No end of an episode: the evaluation ends its cases itself."""


def _times(seen: Observation, xs: Any, ys: Any, speeds: Any) -> Any:
    """When a path with its speeds reaches its points, s from the ego's place on."""
    steps = np.hypot(np.diff(xs, prepend=seen.ego.x), np.diff(ys, prepend=seen.ego.y))
    mean = 0.5 * (speeds + np.concatenate([speeds[:1], speeds[:-1]]))
    return np.cumsum(np.maximum(steps, 1e-3) / np.maximum(mean, 0.1))


def _heading(angle: float) -> Any:
    return _class("smarts.core.coordinates", "Heading", float)(angle - 0.5 * math.pi)


def _vehicle(name: str, it: Any, seen: Observation) -> dict[str, Any]:
    return {
        "id": name,
        "position": np.array([it.x, it.y, 0.0]),
        "bounding_box": SimpleNamespace(length=it.length, width=it.width, height=1.5),
        "heading": _heading(it.heading),
        "speed": it.speed,
        "road_id": seen.road.name,
        "lane_id": f"lane_{it.lane}",
        "lane_index": it.lane,
    }


def _waypoints(seen: Observation, speed: float) -> list[list[Any]]:
    """One path a lane, from beside the ego on, a point a metre; the limit is the desired speed."""
    made = _class("smarts.core.road_map", "Waypoint")
    return [
        [
            made(
                pos=np.array([x, seen.road.lane_centre(lane)]),
                heading=_heading(0.0),
                lane_id=f"lane_{lane}",
                lane_width=seen.road.lane_width,
                speed_limit=speed,
                lane_index=lane,
                lane_offset=float(x),
            )
            for x in seen.ego.x + np.arange(_AHEAD)
        ]
        for lane in range(seen.road.lanes)
    ]
