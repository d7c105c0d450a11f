"""The Reactive Planner of TU Munich (https://github.com/CommonRoad/commonroad-reactive-planner), as
an `exec:` program.

It runs in an environment of its own, whose packages need not agree with ours:

    python -m venv planner && planner/bin/pip install commonroad-reactive-planner
    sumo-eval run --ads "exec:planner/bin/python reactive_planner.py" --ads idm

The road becomes a CommonRoad scenario, every vehicle that is seen one that keeps its speed for the
horizon of 6 s. The planner plans every 0.3 s, its own default, from where its last plan has it by
then, as its own runner does, and the harness's tracker follows. Where it finds no trajectory the
ego brakes, and it plans on from where the ego is. Straight roads.
"""

import json
import math
import os
import sys

import numpy as np
from commonroad.geometry.shape import Rectangle
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.scenario import Scenario, ScenarioID
from commonroad.scenario.state import CustomState, InitialState
from commonroad.scenario.trajectory import Trajectory
from commonroad_clcs.config import CLCSParams
from commonroad_dc.boundary.boundary import create_road_boundary_obstacle
from commonroad_rp.reactive_planner import ReactivePlanner
from commonroad_rp.state import ReactivePlannerState
from commonroad_rp.utility.config import ReactivePlannerConfiguration
from commonroad_rp.utility.utils_coordinate_system import CoordinateSystem

BRAKE = {"acceleration": -6.0}


class Driver:
    def __init__(self, told):
        self.config = config = ReactivePlannerConfiguration()
        config.debug.multiproc, config.debug.logging_level = False, "CRITICAL"
        config.vehicle.length, config.vehicle.width = (
            told["vehicle"]["length"],
            told["vehicle"]["width"],
        )
        self.lanes = []
        for line in told["road"]["lane_borders"]:
            (begin, _), (end, _) = line["centre"][0], line["centre"][-1]
            x = np.linspace(begin - 100.0, end + 300.0, 200)
            self.lanes.append(
                [
                    np.stack([x, np.full_like(x, line[of][0][1])], 1)
                    for of in ("left", "centre", "right")
                ]
            )
        self.boundary = create_road_boundary_obstacle(self.scenario([]))[1]
        self.wanted, self.next, self.planner, self.last = told["desired_speed"], 0.0, None, None
        self.every = config.planning.dt * config.planning.replanning_frequency

    def scenario(self, others):
        found = Scenario(self.config.planning.dt, ScenarioID())
        for number, (left, centre, right) in enumerate(self.lanes, 1):
            beside = number + 1 if number < len(self.lanes) else None, number - 1 or None
            found.add_objects(
                Lanelet(left, centre, right, number, adjacent_left=beside[0],
                    adjacent_left_same_direction=True,
                        adjacent_right=beside[1], adjacent_right_same_direction=True)
            )  # fmt: skip
        found.add_objects([self.obstacle(it) for it in others])
        return found

    def obstacle(self, it):
        dt, c, s = self.config.planning.dt, math.cos(it["heading"]), math.sin(it["heading"])
        states = [
            {
                "time_step": k,
                "position": np.array(
                    [it["x"] + k * dt * it["speed"] * c, it["y"] + k * dt * it["speed"] * s]
                ),
                "orientation": it["heading"],
                "velocity": it["speed"],
            }
            for k in range(self.config.planning.time_steps_computation + 1)
        ]
        shape, later = (
            Rectangle(it["length"], it["width"]),
            [CustomState(**state) for state in states[1:]],
        )
        begin = InitialState(**states[0], acceleration=0.0, yaw_rate=0.0, slip_angle=0.0)
        prediction = TrajectoryPrediction(Trajectory(1, later), shape)
        return DynamicObstacle(1000 + it["number"], ObstacleType.CAR, shape, begin, prediction)

    def start(self, me):
        """Where the next plan begins, on the map and along the road."""
        vehicle = self.config.vehicle
        if self.last is not None:
            place, (plan, along, across) = self.config.planning.replanning_frequency, self.last
            state = plan.state_list[place]
            state.time_step = 0
            return state, (along[place], across[place])
        here = InitialState(
            time_step=0, position=np.array([me["x"], me["y"]]), orientation=me["heading"],
            velocity=me["speed"],
            acceleration=me["acceleration"], yaw_rate=0.0, slip_angle=0.0,
        )  # fmt: skip
        return ReactivePlannerState.create_from_initial_state(
            here, vehicle.wheelbase, vehicle.wb_rear_axle
        ), None

    def answer(self, seen):
        if seen["time"] < self.next - 1e-9:
            return BRAKE if self.last is None else {"plan": None}
        self.next = seen["time"] + self.every
        vehicle, self.config.scenario = self.config.vehicle, self.scenario(seen["vehicles"])
        begin, along = self.start(seen["ego"])
        if self.planner is None:
            self.planner = ReactivePlanner(self.config)
            line = CoordinateSystem(self.lanes[0][1], clcs_params=CLCSParams())
            self.planner.set_reference_path(coordinate_system=line)
        self.planner.set_collision_checker(
            self.config.scenario, road_boundary_obstacle=self.boundary
        )
        self.planner.reset(
            self.config, begin, along, self.planner.collision_checker,
            self.planner.coordinate_system,
        )  # fmt: skip
        self.planner.set_desired_velocity(self.wanted, begin.velocity)
        self.last = found = self.planner.plan()
        if found is None:
            return BRAKE
        axle, dt = vehicle.wb_rear_axle, self.config.planning.dt
        states = [
            ReactivePlannerState.shift_state_to_center(state, axle) for state in found[0].state_list
        ]
        plan = {
            "time": [seen["time"] + dt * state.time_step for state in states],
            "x": [float(state.position[0]) for state in states],
            "y": [float(state.position[1]) for state in states],
            "heading": [float(state.orientation) for state in states],
            "speed": [float(state.velocity) for state in states],
        }
        return {"plan": plan}


if __name__ == "__main__":
    # what a library prints is no answer
    answers, sys.stdout = os.fdopen(os.dup(1), "w"), sys.stderr
    driver = None
    for line in sys.stdin:
        message = json.loads(line)
        if message["type"] == "reset":
            driver, answer = Driver(message), {}
        else:
            answer = driver.answer(message)
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
