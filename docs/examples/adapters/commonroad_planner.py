"""CommonRoad's planners: the Reactive Planner as it is, and every planner that has
`plan(scenario, planning_problem)` and returns a trajectory with a `state_list`.

Install commonroad-io, or commonroad-reactive-planner, into the environment of sumo_eval
(docs/ads/other_simulators.md). Scenario and planning problem are made for every call. Frames agree.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.scenario import Scenario, ScenarioID
from commonroad.scenario.state import CustomState, InitialState
from commonroad.scenario.trajectory import Trajectory
from other_tools import densified, found_agent, made_agent

from sumo_eval.cosim.doors.controller import Briefing
from sumo_eval.cosim.doors.observation import Observation, SeenVehicle, lane_borders
from sumo_eval.cosim.plans import Plan, Wanted
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import ControllerError, must_be

_NAME = "commonroad_planner.py:CommonRoadPlanner"
_TYPES = {
    "van": ObstacleType.TRUCK,
    "truck": ObstacleType.TRUCK,
    "bus": ObstacleType.BUS,
    "motorcycle": ObstacleType.MOTORCYCLE,
    "bicycle": ObstacleType.BICYCLE,
    "pedestrian": ObstacleType.PEDESTRIAN,
    "child": ObstacleType.PEDESTRIAN,
}
_NO_PLAN = Command(-6.0)  # m/s2, where the planner finds no trajectory


class CommonRoadPlanner:
    """Drives a planner that has `plan(scenario, planning_problem)`, or the Reactive Planner.

    agent: a class, an object or the name of one.

    dt: s between two time steps of scenario and trajectory.
    horizon: s of the predictions, at constant velocity.
    """

    def __init__(
        self, agent: Any = None, dt: float = 0.1, horizon: float = 6.0, **options: Any
    ) -> None:
        for name, value in (("dt", dt), ("horizon", horizon)):
            if (
                isinstance(value, bool)
                or not isinstance(value, int | float)
                or not 0.0 < value < math.inf
            ):
                raise must_be(f"`{name}`", _NAME, "a number greater than 0 s", value)
        kind = found_agent(agent, "plan", _NAME)
        self._reactive = hasattr(kind, "set_reference_path")
        self.agent = ReactivePlans(kind) if self._reactive else made_agent(kind, options, _NAME)
        self._dt, self._steps = float(dt), max(round(horizon / dt), 1)

    def reset(self, scenario: Briefing) -> None:
        """The lanes, and the speed that the goal asks for."""
        self._wanted, self._goal = scenario.desired_speed, scenario.goal
        self._lanes = [
            [densified(line) for line in (lane.left, lane.centre, lane.right)]
            for lane in lane_borders(scenario.road)
        ]
        if self._reactive:
            self.agent.reset(self._lanes[0][1], self._dt, scenario)

    def act(self, seen: Observation) -> Wanted:
        """Scenario and planning problem in, a trajectory out; time step 0 is the instant of the
        call."""
        answer = self.agent.plan(self._scenario(seen), self._problem(seen))
        if answer is None:
            return _NO_PLAN
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
            [float(state.orientation) for state in states],
            [float(state.velocity) for state in states],
        )

    def _scenario(self, seen: Observation) -> Scenario:
        scenario = Scenario(self._dt, ScenarioID())
        for number, (left, centre, right) in enumerate(self._lanes, 1):
            lanelet = Lanelet(
                left,
                centre,
                right,
                number,
                adjacent_left=number + 1 if number < len(self._lanes) else None,
                adjacent_left_same_direction=True,
                adjacent_right=number - 1 or None,
                adjacent_right_same_direction=True,
            )
            scenario.add_objects(lanelet)
        scenario.add_objects([self._obstacle(it) for it in seen.vehicles])
        return scenario

    def _problem(self, seen: Observation) -> PlanningProblem:
        begin = _initial(seen.ego, seen.ego.acceleration)
        area = Rectangle(10.0, 5.0, np.array(self._goal), 0.0)
        goal = CustomState(
            time_step=Interval(0, 10_000), position=area, velocity=Interval(0.0, self._wanted)
        )
        problem = PlanningProblem(1, begin, GoalRegion([goal]))
        problem.desired_speed = self._wanted
        return problem

    def _obstacle(self, it: SeenVehicle) -> DynamicObstacle:
        step = it.speed * self._dt * np.array([math.cos(it.heading), math.sin(it.heading)])
        later = [
            CustomState(
                time_step=k,
                position=np.array([it.x, it.y]) + k * step,
                orientation=it.heading,
                velocity=it.speed,
            )
            for k in range(1, self._steps + 1)
        ]
        shape = Rectangle(it.length, it.width)
        prediction = TrajectoryPrediction(Trajectory(1, later), shape)
        kind = _TYPES.get(it.kind, ObstacleType.CAR)
        return DynamicObstacle(
            1000 + it.number, kind, shape, _initial(it, it.acceleration), prediction
        )


class ReactivePlans:
    """The Reactive Planner behind `plan(scenario, planning_problem)`, on the centre line of the
    first lane; a plan starts where the last one has the ego by then, as in its own runner.

    kind: the class `commonroad_rp.reactive_planner.ReactivePlanner`.
    """

    def __init__(self, kind: type) -> None:
        self._kind = kind

    def reset(self, line: Any, dt: float, case: Briefing) -> None:
        """Start a case with a reference path, (n, 2) m."""
        from commonroad_rp.utility.config import ReactivePlannerConfiguration

        self._config, self._line = ReactivePlannerConfiguration(), line
        self._config.planning.dt = dt
        body, own = case.vehicle, self._config.vehicle
        own.length, own.width = body.length, body.width
        steps = case.period / dt
        self._later = round(steps) if abs(steps - round(steps)) < 1e-6 else 0
        self._last: Any = None
        self._config.debug.multiproc, self._config.debug.logging_level = False, "CRITICAL"
        self._planner: Any = None

    def plan(self, scenario: Scenario, problem: PlanningProblem) -> Any:
        """A trajectory of the vehicle's centre, None where the planner finds none."""
        from commonroad_clcs.config import CLCSParams
        from commonroad_dc.boundary.boundary import create_road_boundary_obstacle
        from commonroad_rp.state import ReactivePlannerState
        from commonroad_rp.utility.utils_coordinate_system import CoordinateSystem

        config, begin = self._config, problem.initial_state
        config.scenario = scenario
        if self._planner is None:
            self._boundary = create_road_boundary_obstacle(scenario)[1]
            self._planner = self._kind(config)
            line = CoordinateSystem(self._line, clcs_params=CLCSParams())
            self._planner.set_reference_path(coordinate_system=line)
        planner, vehicle = self._planner, config.vehicle
        state, along = (
            ReactivePlannerState.create_from_initial_state(
                begin, vehicle.wheelbase, vehicle.wb_rear_axle
            ),
            None,
        )
        if self._last is not None and self._later:
            plan, s, d = self._last
            state, along = plan.state_list[self._later], (s[self._later], d[self._later])
            state.time_step = 0
        planner.set_collision_checker(scenario, road_boundary_obstacle=self._boundary)
        planner.reset(config, state, along, planner.collision_checker, planner.coordinate_system)
        planner.set_desired_velocity(problem.desired_speed, state.velocity)
        self._last = answer = planner.plan()
        if answer is None:
            return None
        axle = vehicle.wb_rear_axle
        states = answer[0].state_list
        return Trajectory(
            states[0].time_step,
            [ReactivePlannerState.shift_state_to_center(it, axle) for it in states],
        )


def _initial(it: Any, acceleration: float) -> InitialState:
    return InitialState(
        time_step=0,
        position=np.array([it.x, it.y]),
        orientation=it.heading,
        velocity=it.speed,
        acceleration=acceleration,
        yaw_rate=0.0,
        slip_angle=0.0,
    )
