"""A ROS 2 node between sumo_eval and a driving stack: `exec:/usr/bin/python3 ros2_node.py`
(docs/ads/ros2.md).

It needs rclpy and the usual messages, and nothing of sumo_eval. At every step it publishes what is
seen, stamped with the time of the case, and waits for a control or a plan that is stamped no
earlier: the stack has the time that it needs (`step_timeout`), and no message of an earlier step
counts.
"""

import argparse
import json
import math
import sys

import rclpy
from ackermann_msgs.msg import AckermannDriveStamped
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

QUEUE = 50
SHORTLY = 0.01  # s


def stamp(message, time):
    message.sec, message.nanosec = divmod(round(time * 1e9), 10**9)


def seconds(it):
    return it.sec + 1e-9 * it.nanosec


def place(pose, x, y, heading):
    pose.position.x, pose.position.y = float(x), float(y)
    pose.orientation.z, pose.orientation.w = math.sin(0.5 * heading), math.cos(0.5 * heading)


class Bridge:
    def __init__(self, follow):
        rclpy.init()
        self.node, self.follow = rclpy.create_node("sumo_eval"), follow
        self.clock = self.node.create_publisher(Clock, "/clock", QUEUE)
        self.begun = self.node.create_publisher(String, "/sumo_eval/reset", QUEUE)
        self.ego = self.node.create_publisher(Odometry, "/sumo_eval/ego", QUEUE)
        self.others = self.node.create_publisher(Odometry, "/sumo_eval/others", QUEUE)
        self.bodies = self.node.create_publisher(MarkerArray, "/sumo_eval/bodies", QUEUE)
        self.seen = self.node.create_publisher(String, "/sumo_eval/observation", QUEUE)
        self.node.create_subscription(
            AckermannDriveStamped, "/sumo_eval/control", self.controlled, QUEUE
        )
        self.node.create_subscription(Path, "/sumo_eval/plan", self.planned, QUEUE)
        self.time, self.answer = 0.0, None

    def reset(self, told):
        """Wait until a stack is there, and tell it that a case begins."""
        self.ratio, self.length = told["vehicle"]["steering_ratio"], told["vehicle"]["length"]
        while not (
            self.node.count_publishers("/sumo_eval/control")
            or self.node.count_publishers("/sumo_eval/plan")
        ):
            rclpy.spin_once(self.node, timeout_sec=SHORTLY)
        self.begun.publish(String(data=json.dumps(told)))
        return {}

    def step(self, seen):
        self.time, self.answer = seen["time"], None
        clock = Clock()
        stamp(clock.clock, self.time)
        self.clock.publish(clock)
        bodies = MarkerArray()
        for it in seen["vehicles"]:
            self.others.publish(self.odometry(it, f"{it['kind']} {it['number']}"))
            bodies.markers.append(self.body(it))
        self.bodies.publish(bodies)
        self.seen.publish(String(data=json.dumps(seen)))
        # the last: who has it has all of the step
        self.ego.publish(self.odometry(seen["ego"], "ego"))
        while self.answer is None:
            rclpy.spin_once(self.node, timeout_sec=SHORTLY)
        return self.answer

    def odometry(self, it, name):
        found = Odometry()
        found.header.frame_id, found.child_frame_id = "road", name
        stamp(found.header.stamp, self.time)
        place(found.pose.pose, it["x"], it["y"], it["heading"])
        found.twist.twist.linear.x = float(it["speed"])
        return found

    def body(self, it):
        found = Marker()
        found.header.frame_id, found.ns, found.id, found.type = (
            "road",
            it["kind"],
            it["number"],
            Marker.CUBE,
        )
        stamp(found.header.stamp, self.time)
        place(found.pose, it["x"], it["y"], it["heading"])
        found.scale.x, found.scale.y, found.scale.z = float(it["length"]), float(it["width"]), 1.5
        found.color.a = 1.0
        return found

    def controlled(self, message):
        if seconds(message.header.stamp) < self.time - 1e-6:
            return
        # of the front wheels there, of the steering wheel here
        wheel = message.drive.steering_angle * self.ratio
        self.answer = {self.follow: getattr(message.drive, self.follow), "steering": wheel}

    def planned(self, message):
        if seconds(message.header.stamp) < self.time - 1e-6:
            return
        poses = [
            (seconds(it.header.stamp), it.pose.position, it.pose.orientation)
            for it in message.poses
        ]
        self.answer = {
            "plan": {
                "time": [time for time, _, _ in poses],
                "x": [at.x for _, at, _ in poses],
                "y": [at.y for _, at, _ in poses],
                "heading": [2.0 * math.atan2(turned.z, turned.w) for _, _, turned in poses],
            }
        }


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--follow", choices=("acceleration", "speed"), default="acceleration", help="of a control"
    )
    bridge = Bridge(parser.parse_args().follow)
    for line in sys.stdin:
        message = json.loads(line)
        answer = bridge.reset(message) if message["type"] == "reset" else bridge.step(message)
        print(json.dumps(answer), flush=True)  # noqa: T201
    bridge.node.destroy_node()
    rclpy.shutdown()
