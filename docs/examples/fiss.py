"""FISS+ (Sun et al., IROS 2023), a sampling planner in C++ (`pip install fiss-planner`), and its MPC, as an ADS."""

import math

import fiss_planner as fp
import numpy as np


class Fiss:
    """Plans every 0.2 s on the two lanes, tracks the plan every step."""

    def reset(self, scenario):
        road, self.vehicle = scenario.road, scenario.vehicle
        x = np.arange(0.0, road.length + 400.0, 5.0)
        self.line = fp.ReferenceLine(x, np.zeros_like(x))
        self.lanes = fp.Corridor.parallel_lanes(0.0, self.line.length, road.lane_width, road.lanes - 1, 0)
        self.planner = fp.make_planner(fp.make_config("fiss_plus"))
        self.tracker = fp.make_controller("stanley")
        self.plan = self.speed = None

    def act(self, seen):
        me = seen.ego
        self.speed = self.speed or me.speed
        if self.plan is None or seen.time - self.planned > 0.19:
            velocity = me.speed * math.cos(me.heading), me.speed * math.sin(me.heading)
            start = fp.FrenetState(me.x, velocity[0], me.acceleration, me.y, velocity[1])
            others = [self.predicted(me, other) for other in seen.vehicles]
            found = self.planner.plan(start, self.line, self.lanes, others, target_speed=self.speed)
            self.plan, self.planned = (found.trajectory if found.success else None), seen.time
        if self.plan is None:
            return -6.0, 0.0
        pose = fp.EgoState(me.x, me.y, me.heading, me.speed, me.acceleration)
        command = self.tracker.compute(pose, self.plan, seen.time - self.planned)
        return command.accel, command.steer * self.vehicle.steering_ratio

    def predicted(self, me, other):
        ahead = (other.gap + 0.5 * (other.length + me.length)) * (1 if other.ahead else -1)
        shape = other.speed, other.length, other.width
        return fp.predict_constant_velocity(other.number, me.x + ahead, me.y + other.offset, 0.0, *shape, 6.0, 0.1)
