"""An overtaking planner: changes to the left lane before a slower lead when nobody is there; steers
by pure pursuit."""

import math


class Overtaker:
    """Acts on observations; keeps which lane it wants."""

    def reset(self, scenario):
        self.vehicle = scenario.vehicle
        self.lane = None

    def act(self, seen):
        me, lead = seen.ego, seen.lead
        if self.lane is None:
            self.lane = me.lane
        slower = lead is not None and lead.relative_speed < -1.0 and lead.gap < 4.0 * me.speed
        if slower and self.lane + 1 < len(seen.lanes) and self.is_free(seen):
            self.lane += 1
        acceleration = 0.0
        # behind somebody: brake as hard as it takes
        if lead is not None and lead.lane == self.lane:
            closing = max(-lead.relative_speed, 0.0)
            acceleration = -min(closing**2 / (2.0 * max(lead.gap - 2.0, 0.1)), 8.0)
        return acceleration, self.pure_pursuit(me, seen.lanes[self.lane])

    def is_free(self, seen):
        """Whether the left lane has room around the ego for a change."""
        ahead, behind = seen.neighbours["left_ahead"], seen.neighbours["left_behind"]
        room_ahead = ahead is None or ahead.gap + 4.0 * min(ahead.relative_speed, 0.0) > 10.0
        room_behind = behind is None or behind.gap - 4.0 * max(behind.relative_speed, 0.0) > 10.0
        return room_ahead and room_behind

    def pure_pursuit(self, me, offset):
        """Steering wheel angle that leads through a point 1.8 s ahead, `offset` m to the left of
        the ego."""
        ahead = max(1.8 * me.speed, 8.0)
        bearing = math.atan2(offset, ahead) - me.heading
        wheel = math.atan(
            2.0 * self.vehicle.wheelbase * math.sin(bearing) / math.hypot(ahead, offset)
        )
        return wheel * self.vehicle.steering_ratio
