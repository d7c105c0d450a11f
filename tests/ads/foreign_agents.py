"""Stand-ins with the interfaces of other tools, written as their own users write them."""

import math
from types import SimpleNamespace

import numpy as np


def followed(speed, ahead, wanted):
    """Acceleration of a linear follower, m/s2.

    ahead: gap and speed of each vehicle ahead.
    """
    gap, lead_speed = min(ahead, default=(None, 0.0))
    if gap is not None:
        wanted = min(wanted, lead_speed + 0.3 * (gap - 5.0 - 1.2 * speed))
    return min(max(0.6 * (wanted - speed), -5.0), 2.0)


class BasicAgent:
    """As CARLA's navigation agents: takes its vehicle, asks it for the world, returns a
    VehicleControl."""

    def __init__(self, vehicle, target_speed=20):
        self._vehicle, self._target_speed = vehicle, target_speed

    def set_target_speed(self, speed):
        self._target_speed = speed

    def run_step(self):
        me = self._vehicle.get_transform()
        gaps = []
        for other in self._vehicle.get_world().get_actors().filter("*vehicle*"):
            place = other.get_transform().location
            if (
                other.id != self._vehicle.id
                and place.x > me.location.x
                and abs(place.y - me.location.y) < 1.8
            ):
                reach = other.bounding_box.extent.x + self._vehicle.bounding_box.extent.x
                gaps.append((place.x - me.location.x - reach, other.get_velocity().x))
        speed = math.hypot(self._vehicle.get_velocity().x, self._vehicle.get_velocity().y)
        a = followed(speed, gaps, self._target_speed / 3.6)
        steer = -0.05 * (me.location.y - 0.0) - 0.01 * me.rotation.yaw
        return SimpleNamespace(
            throttle=max(a, 0.0) / 4.0, brake=max(-a, 0.0) / 9.0, steer=steer, hand_brake=False
        )


class LeaderboardAgent:
    """As the leaderboard's AutonomousAgent: sensor data and a timestamp; to the right at 0.2 of the
    end stop."""

    def __call__(self):
        raise AssertionError("the adapter calls run_step")

    def run_step(self, input_data, timestamp):
        _frame, data = input_data["speed"]
        assert data["speed"] >= 0.0
        return SimpleNamespace(
            throttle=0.0, brake=0.0, steer=0.02 if timestamp < 0.5 else 0.0, reverse=False
        )


class RadarAgent:
    """As a leaderboard's agent that names its own sensors."""

    def __init__(self, carla_host, carla_port, debug=False):
        self.ready = False

    def setup(self, path_to_conf_file):
        self.ready = True

    def sensors(self):
        return [{"type": "sensor.speedometer", "id": "Speed"}, {"type": "sensor.other.imu", "id": "I"},
                {"type": "sensor.other.gnss", "id": "G"},
                {"type": "sensor.other.radar", "id": "R", "x": 2.25, "y": 0.0, "yaw": 0.0}]  # fmt: skip

    def set_global_plan(self, global_plan_gps, global_plan_world_coord):
        assert self.ready
        assert global_plan_gps[0][0]["lat"] == global_plan_world_coord[0][0].location.y == 0.0

    def run_step(self, input_data, timestamp):
        frame, data = input_data["Speed"]
        assert frame == round(timestamp / 0.05)
        speed = data["speed"]
        assert input_data["I"][1][6] == math.pi / 2
        assert input_data["G"][1][1] > 0.0
        radar = [row for row in input_data["R"][1] if abs(row[0] * math.sin(row[2])) < 1.5]
        a = followed(speed, [(gap, speed + receding) for gap, _, _, receding in radar], 20.0)
        return SimpleNamespace(throttle=max(a, 0.0) / 4.0, brake=max(-a, 0.0) / 9.0, steer=0.0)


class Photographer(RadarAgent):
    def sensors(self):
        return [{"type": "sensor.camera.rgb", "id": "Left"}]


class Follower:
    """As a SMARTS agent with ActionSpaceType.Continuous."""

    def act(self, obs, **configs):
        ego = obs.ego_vehicle_state
        ahead = [
            (
                it.position[0]
                - ego.position[0]
                - 0.5 * (it.bounding_box.length + ego.bounding_box.length),
                it.speed,
            )
            for it in obs.neighborhood_vehicle_states
            if it.lane_index == ego.lane_index and it.position[0] > ego.position[0]
        ]
        a = followed(ego.speed, ahead, 20.0)
        return np.array([max(a, 0.0) / 4.0, max(-a, 0.0) / 9.0, 0.0])


class Tracker:
    """As a SMARTS agent with ActionSpaceType.Trajectory: its lane's waypoints at 12 m/s."""

    def act(self, obs):
        path = obs.waypoint_paths[obs.ego_vehicle_state.lane_index][:10]
        assert obs.via_data.near_via_points == ()
        places = ([point.pos[axis] for point in path] for axis in (0, 1))
        return *places, [point.heading for point in path], [12.0] * len(path)


class LaneChanger:
    """As a SMARTS agent with ActionSpaceType.LaneWithContinuousSpeed: one change to the left."""

    def act(self, obs):
        return obs.ego_vehicle_state.speed, int(obs.step_count == 0)


# as a class that subclasses smarts.core.agent.Agent
Follower.__module__ = LaneChanger.__module__ = Tracker.__module__ = "smarts.zoo.mine"


class SimplePlanner:
    """As nuPlan's AbstractPlanner: initialize, and a trajectory of states about the rear axle and
    the centre."""

    def name(self):
        return "simple"

    def initialize(self, initialization):
        self.goal = initialization.mission_goal

    def compute_planner_trajectory(self, current_input):
        ego, observed = current_input.history.current_state
        assert current_input.history.ego_states[-1] is ego
        v, me = ego.dynamic_car_state.rear_axle_velocity_2d.x, ego.car_footprint.center
        ahead = [
            (it.center.x - me.x - 0.5 * (it.box.length + ego.car_footprint.length), it.velocity.x)
            for it in observed.tracked_objects.tracked_objects
            if it.center.x > me.x and abs(it.center.y - me.y) < 1.8
        ]
        a, states = followed(v, ahead, 20.0), []
        for k in range(9):
            t = 0.25 * k
            speed = max(v + a * t, 0.0)
            centre = SimpleNamespace(x=me.x + 0.5 * (v + speed) * t, y=self.goal.y, heading=0.0)
            time = SimpleNamespace(time_us=ego.time_point.time_us + 250_000 * k)
            states.append(SimpleNamespace(time_point=time, center=centre,
                                          dynamic_car_state=SimpleNamespace(speed=speed)))  # fmt: skip
        return SimpleNamespace(get_sampled_trajectory=lambda: states)


class LanePlanner:
    """As a planner on commonroad-io's objects: behind the predicted vehicle of its lanelet."""

    def plan(self, scenario, planning_problem):
        begin = planning_problem.initial_state
        lane = scenario.lanelet_network.find_lanelet_by_id(1).center_vertices
        ahead = [
            (
                it.initial_state.position[0] - begin.position[0] - it.obstacle_shape.length,
                it.state_at_time(5).velocity,
            )
            for it in scenario.dynamic_obstacles
            if it.initial_state.position[0] > begin.position[0]
            and abs(it.initial_state.position[1] - lane[0, 1]) < 1.8
        ]
        v, states = begin.velocity, []
        a = followed(v, ahead, planning_problem.desired_speed)
        for k in range(21):
            t = scenario.dt * k
            speed = max(v + a * t, 0.0)
            place = np.array([begin.position[0] + 0.5 * (v + speed) * t, lane[0, 1]])
            states.append(
                SimpleNamespace(time_step=k, position=place, orientation=0.0, velocity=speed)
            )
        return SimpleNamespace(state_list=states)
