"""A trajectory planner: once a second it plans 4 s ahead in the coordinates of the road and returns
a Plan.

It keeps the wanted speed, and behind a slower vehicle it changes to the left-hand lane as soon as
that is free.
"""

import numpy as np

from sumo_eval import Plan

HORIZON, SPACING, CHANGE = 6.0, 0.2, 4.0  # s


class Planner:
    def reset(self, scenario):
        self.wanted = scenario.desired_speed
        self.lines = scenario.road.lanes
        self.width = scenario.road.lane_width
        self.lane = 0
        self.next = 0.0

    def act(self, seen):
        if seen.time < self.next - 1e-9:
            return None  # the last plan holds
        self.next = seen.time + 1.0
        me, lead = seen.ego, seen.lead
        if (
            lead is not None
            and lead.gap < 5.0 * me.speed
            and lead.speed < self.wanted - 1.0
            and self._is_free(seen)
        ):
            self.lane = me.lane + 1
        t = np.arange(0.0, HORIZON + SPACING, SPACING)
        target = self.wanted
        if lead is not None and self.lane == me.lane and lead.gap < 3.0 * me.speed:
            target = min(target, lead.speed + 0.2 * (lead.gap - 5.0 - 1.5 * me.speed))
        speed = np.clip(me.speed + np.clip(target - me.speed, -3.0 * t, 1.5 * t), 0.0, None)
        x = me.x + np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * SPACING)])
        return Plan(seen.time + t, x, self._across(me, t), speed=speed)

    def _is_free(self, seen):
        if seen.ego.lane + 1 >= self.lines:
            return False
        ahead, behind = seen.neighbours["left_ahead"], seen.neighbours["left_behind"]
        return (ahead is None or ahead.gap > 30.0) and (behind is None or behind.gap > 30.0)

    def _across(self, me, t):
        """From where the ego is, at the slope that it has, to the lane's centre line: a cubic."""
        off, slope = self.width * self.lane - me.y, me.speed * np.sin(me.heading) * CHANGE
        u = np.clip(t / CHANGE, 0.0, 1.0)
        return me.y + slope * u + (3.0 * off - 2.0 * slope) * u**2 + (slope - 2.0 * off) * u**3
