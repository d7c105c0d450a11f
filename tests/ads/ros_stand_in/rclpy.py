"""In place of ROS 2's rclpy: nodes of one process that exchange messages through queues, delivered
by `spin_once`.

On `init` the module that STACK names is imported and makes its node, as a stack that was started
before.
"""

import importlib
import os

_nodes = []


class Node:
    def __init__(self, name):
        self.name, self.subscriptions, self.topics, self.waiting = name, {}, [], []

    def create_publisher(self, kind, topic, queue):
        self.topics.append(topic)
        return Publisher(kind, topic)

    def create_subscription(self, kind, topic, heard, queue):
        self.subscriptions[topic] = (kind, heard)

    def count_publishers(self, topic):
        return sum(node.topics.count(topic) for node in _nodes)

    def destroy_node(self):
        _nodes.remove(self)


class Publisher:
    def __init__(self, kind, topic):
        self.kind, self.topic = kind, topic

    def publish(self, message):
        assert type(message) is self.kind
        for node in _nodes:
            kind, heard = node.subscriptions.get(self.topic, (None, None))
            if heard is not None:
                assert kind is self.kind
                node.waiting.append((heard, message))


def init():
    if "STACK" in os.environ:
        importlib.import_module(os.environ["STACK"]).start()


def create_node(name):
    _nodes.append(Node(name))
    return _nodes[-1]


def spin_once(node, timeout_sec):
    for one in list(_nodes):
        waiting, one.waiting = one.waiting, []
        for heard, message in waiting:
            heard(message)


def shutdown():
    _nodes.clear()
