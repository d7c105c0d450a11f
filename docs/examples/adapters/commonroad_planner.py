"""CommonRoad-style planners: `plan(scenario, planning_problem)` returns a trajectory with a
`state_list`.

Scenario and planning problem are made anew for every call, as plain objects with commonroad-io's
names. Frames agree."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
from other_tools import found_agent, made_agent

from sumo_eval.cosim.doors.controller import Briefing
from sumo_eval.cosim.doors.observation import Observation, SeenVehicle
from sumo_eval.cosim.plans import Plan
from sumo_eval.errors import ControllerError, must_be

_NAME = "commonroad_planner.py:CommonRoadPlanner"
# what commonroad-io has no obstacle type of its own for
_TYPES = {"van": "truck", "child": "pedestrian"}


class CommonRoadPlanner:
    """Drives a planner that has `plan(scenario, planning_problem)`.

    agent: a class, an object or the name of one.

    dt: s between two time steps of scenario and trajectory.
    horizon: s of the predictions, at constant velocity.
    """

    def __init__(
        self, agent: Any = None, dt: float = 0.1, horizon: float = 5.0, **options: Any
    ) -> None:
        for name, value in (("dt", dt), ("horizon", horizon)):
            if (
                isinstance(value, bool)
                or not isinstance(value, int | float)
                or not 0.0 < value < math.inf
            ):
                raise must_be(f"`{name}`", _NAME, "a number greater than 0 s", value)
        self.agent = made_agent(found_agent(agent, "plan", _NAME), options, _NAME)
        self._dt, self._steps = float(dt), max(round(horizon / dt), 1)

    def reset(self, scenario: Briefing) -> None:
        """Keep the speed that the goal asks for."""
        self._wanted = scenario.desired_speed

    def act(self, seen: Observation) -> Plan:
        """Scenario and planning problem in, a trajectory out; time step 0 is the instant of the
        call."""
        answer = self.agent.plan(self._scenario(seen), self._problem(seen))
        trajectory = answer[0] if isinstance(answer, tuple) and answer else answer
        states = getattr(trajectory, "state_list", None)
        if not states:
            raise ControllerError(
                "`plan` of the ADS must return a trajectory with a `state_list` that is not empty, "
                f"got {type(answer).__name__}"
            )
        return Plan(
            [seen.time + self._dt * state.time_step for state in states],
            [float(state.position[0]) for state in states],
            [float(state.position[1]) for state in states],
            [state.orientation for state in states], [state.velocity for state in states],
        )  # fmt: skip

    def _scenario(self, seen: Observation) -> SimpleNamespace:
        obstacles = [self._obstacle(it) for it in seen.vehicles]
        lanelets = [_lanelet(number, seen) for number in range(seen.road.lanes)]
        network = SimpleNamespace(
            lanelets=lanelets,
            find_lanelet_by_id=lambda wanted: {it.lanelet_id: it for it in lanelets}.get(wanted),
        )
        return SimpleNamespace(
            dt=self._dt, lanelet_network=network, obstacles=obstacles, dynamic_obstacles=obstacles,
            static_obstacles=[],
            obstacle_by_id=lambda wanted: {it.obstacle_id: it for it in obstacles}.get(wanted),
        )  # fmt: skip

    def _problem(self, seen: Observation) -> SimpleNamespace:
        me = seen.ego
        begin = _state(0, me.x, me.y, me.heading, me.speed, me.acceleration)
        goal = SimpleNamespace(
            position=SimpleNamespace(center=np.array(seen.goal)),
            velocity=SimpleNamespace(start=0.0, end=self._wanted),
        )
        return SimpleNamespace(
            planning_problem_id=1, initial_state=begin, goal=SimpleNamespace(state_list=[goal]),
            desired_speed=self._wanted,
        )  # fmt: skip

    def _obstacle(self, it: SeenVehicle) -> SimpleNamespace:
        kind = _TYPES.get(it.kind, it.kind)
        along, across = (
            it.speed * math.cos(it.heading) * self._dt,
            it.speed * math.sin(it.heading) * self._dt,
        )
        states = [
            _state(k, it.x + k * along, it.y + k * across, it.heading, it.speed, it.acceleration)
            for k in range(self._steps + 1)
        ]
        return SimpleNamespace(
            obstacle_id=1000 + it.number,
            obstacle_type=SimpleNamespace(name=kind.upper(), value=kind),
            obstacle_shape=SimpleNamespace(length=it.length, width=it.width),
            initial_state=states[0],
            prediction=SimpleNamespace(
                trajectory=SimpleNamespace(initial_time_step=1, state_list=states[1:]),
                final_time_step=self._steps
            ),
            state_at_time=lambda k: states[k] if 0 <= k < len(states) else None,
        )  # fmt: skip


def _state(
    step: int, x: float, y: float, heading: float, speed: float, acceleration: float
) -> SimpleNamespace:
    return SimpleNamespace(
        time_step=step, position=np.array([x, y]), orientation=heading, velocity=speed,
        acceleration=acceleration,
        yaw_rate=0.0, slip_angle=0.0,
    )  # fmt: skip


def _lanelet(number: int, seen: Observation) -> SimpleNamespace:
    line = seen.lane_borders[number]
    return SimpleNamespace(
        lanelet_id=number + 1, center_vertices=np.array(line.centre),
        left_vertices=np.array(line.left),
        right_vertices=np.array(line.right), predecessor=[], successor=[],
        adj_left=number + 2 if number + 1 < seen.road.lanes else None, adj_left_same_direction=True,
        adj_right=number or None, adj_right_same_direction=True,
    )  # fmt: skip
