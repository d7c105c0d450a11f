"""The drivers of highway-env (https://github.com/Farama-Foundation/HighwayEnv), which nobody here
wrote: its IDM, which keeps its lane, and its MOBIL, which changes lanes. They are put on a copy of
the road, see what the ego sees, and what they would do is what the ego does. highway-env's y points
to the right.
"""

import numpy as np
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle


class Idm:
    changes_lanes = False

    def reset(self, scenario):
        road, net = scenario.road, RoadNetwork()
        for lane in reversed(range(road.lanes)):
            y = -road.lane_centre(lane)
            net.add_lane(
                "begin",
                "end",
                StraightLane([0.0, y], [road.length + road.run_out, y], width=road.lane_width),
            )
        self.road = Road(network=net, np_random=np.random.RandomState(0))
        self.step, self.ratio, self.ego = scenario.step, scenario.vehicle.steering_ratio, None

    def act(self, seen):
        me = seen.ego
        if self.ego is None:
            self.ego = IDMVehicle(
                self.road, [me.x, -me.y], -me.heading, me.speed, target_speed=me.speed,
                enable_lane_change=self.changes_lanes, timer=0.0,
            )  # fmt: skip
        self.ego.position, self.ego.heading, self.ego.speed = (
            np.array([me.x, -me.y]),
            -me.heading,
            me.speed,
        )
        self.ego.lane_index = self.road.network.get_closest_lane_index(
            self.ego.position, self.ego.heading
        )
        self.ego.lane = self.road.network.get_lane(self.ego.lane_index)
        self.road.vehicles = [self.ego, *(self.other(me, it) for it in seen.vehicles)]
        self.ego.timer += self.step
        self.ego.act()
        return self.ego.action["acceleration"], -self.ego.action["steering"] * self.ratio

    def other(self, me, it):
        reach = it.gap + 0.5 * (me.length + it.length)
        vehicle = Vehicle(
            self.road, [me.x + (reach if it.ahead else -reach), -(me.y + it.offset)], 0.0, it.speed
        )
        vehicle.LENGTH, vehicle.WIDTH = it.length, it.width
        return vehicle


class Mobil(Idm):
    changes_lanes = True
