"""FISS+ (Sun et al., IROS 2023), a sampling planner (`pip install fiss-planner`), as an ADS."""

import fiss_planner as fp
import numpy as np


class Fiss:
    """Plans every 0.2 s on the two lanes, tracks the plan every step."""

    def reset(self, scenario):
        road, self.vehicle = scenario.road, scenario.vehicle
        x = np.arange(0.0, road.length + 400.0, 5.0)
        self.line = fp.ReferenceLine(x, np.zeros_like(x))
        self.lanes = fp.Corridor.parallel_lanes(0.0, x[-1], road.lane_width, road.lanes - 1, 0)
        self.planner = fp.make_planner(fp.make_config("fiss_plus"))
        self.tracker = fp.make_controller("stanley")
        self.plan = self.speed = None

    def act(self, seen):
        me = seen.ego
        self.speed = self.speed or me.speed
        if self.plan is None or seen.time - self.planned > 0.19:
            vx, vy = me.speed * np.cos(me.heading), me.speed * np.sin(me.heading)
            start = fp.FrenetState(me.x, vx, me.acceleration, me.y, vy)
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
        place = me.x + ahead, me.y + other.offset
        return fp.predict_constant_velocity(other.number, *place, 0.0, *shape, 6.0, 0.1)
