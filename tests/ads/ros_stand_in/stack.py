"""A driving stack of two nodes, as STACK names it: an ACC, or with STACK_PLANS a planner that stays
in its lane."""

import os

import rclpy
from ackermann_msgs.msg import AckermannDriveStamped
from messages import PoseStamped, Time
from nav_msgs.msg import Odometry, Path


class Stack:
    def __init__(self):
        node = rclpy.create_node("stack")
        self.control = node.create_publisher(AckermannDriveStamped, "/sumo_eval/control", 1)
        self.plan = node.create_publisher(Path, "/sumo_eval/plan", 1)
        node.create_subscription(Odometry, "/sumo_eval/others", self.other, 10)
        node.create_subscription(Odometry, "/sumo_eval/ego", self.ego, 10)
        self.others = {}
        self.control.publish(AckermannDriveStamped())  # of no step: must not count

    def other(self, it):
        self.others[it.child_frame_id] = (it.pose.pose.position.x, it.twist.twist.linear.x)

    def ego(self, it):
        x, v = it.pose.pose.position.x, it.twist.twist.linear.x
        ahead = [(there - x - 4.5, speed) for there, speed in self.others.values() if there > x]
        gap, speed = min(ahead, default=(1000.0, v))
        acceleration = max(-6.0, min(0.0, 0.15 * (gap - 3.0 - 1.5 * v) + 0.9 * (speed - v)))
        if "STACK_PLANS" in os.environ:
            path = Path(header=it.header)
            now = it.header.stamp.sec + 1e-9 * it.header.stamp.nanosec
            for ahead in (0.0, 1.0, 2.0, 3.0):
                pose = PoseStamped()
                pose.header.stamp = Time(*divmod(round((now + ahead) * 1e9), 10**9))
                pose.pose.position.x = x + (v - 1.0) * ahead
                path.poses.append(pose)
            self.plan.publish(path)
            return
        late = AckermannDriveStamped()  # stamped 0: an answer to an earlier step
        late.drive.acceleration = 2.0
        if it.header.stamp.sec or it.header.stamp.nanosec:
            self.control.publish(late)
        answer = AckermannDriveStamped(header=it.header)
        answer.drive.acceleration, answer.drive.speed = acceleration, 10.0
        self.control.publish(answer)


def start():
    Stack()
