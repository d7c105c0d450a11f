"""SMARTS agents: `Agent.act(obs)` with the action of its action space, named by the option
`action`.

SMARTS's headings are 0 to the north (y) and grow counterclockwise; SMARTS leaves open where
steering turns.
"""

from __future__ import annotations

import math
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
ACTIONS = {"Continuous": 3, "LaneWithContinuousSpeed": 2, "Trajectory": 4, "TrajectoryWithTime": 5}
"""The members of SMARTS's `ActionSpaceType` that can be driven, and how many parts an action
has."""
_LANE_TIME = 3.0  # s to the centre line of a lane
_AHEAD = 50.0  # m of waypoints


class SmartsAgent:
    """Drives an agent with SMARTS's interface.

    agent: a class, an object or the name of one, made with the options.

    action: `Continuous` (throttle, brake, steering), `LaneWithContinuousSpeed` (speed m/s, lanes to
        the left), `Trajectory` (xs, ys, headings, speeds, one for each step to come) or
        `TrajectoryWithTime` (times from the call on, s, before those).
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
        """Forget the case before."""
        self._step = scenario.period if scenario.period > 0.0 else scenario.step
        self._count = 0
        self._lane, self._began = -1, (0.0, 0.0, 0.0)

    def act(self, seen: Observation) -> Wanted:
        """Show what SMARTS would, take the action.

        Raises ControllerError for one of another form.
        """
        answer = self.agent.act(self._shown(seen))
        self._count += 1
        width = ACTIONS[self._action]
        try:
            parts = tuple(answer)
        except TypeError:
            parts = ()
        if len(parts) != width:
            raise ControllerError(
                f"`act` of the ADS must return {width} parts for `{self._action}`, got {answer!r}"
            )
        if self._action == "Continuous":
            return Command.pedals(parts[0], parts[1], self._left * parts[2])
        if self._action == "LaneWithContinuousSpeed":
            return self._to_lane(seen, float(parts[0]), int(parts[1]))
        xs, ys, headings, speeds = (np.asarray(part, float) for part in parts[-4:])
        times = (
            np.asarray(parts[0], float) if width == 5 else self._step * np.arange(1, len(xs) + 1)
        )
        return Plan(seen.time + times, xs, ys, headings + 0.5 * math.pi, speeds)

    def _to_lane(self, seen: Observation, speed: float, change: int) -> Plan:
        """At a speed to the centre line of a lane: a cubic in time from where the ego was when it
        was asked to."""
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

    def _shown(self, seen: Observation) -> SimpleNamespace:
        me = seen.ego
        ego = _vehicle("ego", me, seen)
        ego.linear_velocity = np.array(
            [me.speed * math.cos(me.heading), me.speed * math.sin(me.heading), 0.0]
        )
        ego.linear_acceleration = np.array(
            [me.acceleration * math.cos(me.heading), me.acceleration * math.sin(me.heading), 0.0]
        )
        goal = SimpleNamespace(position=SimpleNamespace(x=seen.goal[0], y=seen.goal[1], z=0.0))
        ego.mission = SimpleNamespace(goal=goal)
        others = tuple(_vehicle(str(it.number), it, seen) for it in seen.vehicles)
        return SimpleNamespace(
            dt=self._step, step_count=self._count, elapsed_sim_time=seen.time,
            ego_vehicle_state=ego,
            neighborhood_vehicle_states=others, waypoint_paths=_waypoints(seen),
        )  # fmt: skip


def _vehicle(name: str, it: Any, seen: Observation) -> SimpleNamespace:
    return SimpleNamespace(
        id=name, position=np.array([it.x, it.y, 0.0]), heading=it.heading - 0.5 * math.pi,
        speed=it.speed,
        bounding_box=SimpleNamespace(length=it.length, width=it.width, height=1.5),
        lane_index=it.lane,
        lane_id=f"lane_{it.lane}", road_id=seen.road.name,
    )  # fmt: skip


def _waypoints(seen: Observation) -> list[list[SimpleNamespace]]:
    """One path a lane, from beside the ego on, a point a metre."""
    xs = seen.ego.x + np.arange(0.0, _AHEAD)
    return [
        [
            SimpleNamespace(
                pos=np.array([x, seen.road.lane_centre(lane)]), heading=-0.5 * math.pi,
                lane_index=lane,
                lane_id=f"lane_{lane}", lane_width=seen.road.lane_width,
                speed_limit=seen.speed_limit,
            )
            for x in xs
        ]
        for lane in range(seen.road.lanes)
    ]  # fmt: skip
