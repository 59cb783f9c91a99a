"""Runs scripts/python/ros2_bridge.py with stand-ins for ROS 2 and for the robot. Usage: check_bridge.py PYTHON_FOLDER

The gateway ends and comes back: the bridge goes on with the same publishers, and publishes nothing after the shutdown.
"""

import os
import signal
import sys
import threading
import time
from types import ModuleType, SimpleNamespace

sys.path.insert(0, sys.argv[1])
import ros2_bridge
from nims import RobotError

CHANNELS = ["tf", "visualization/map/2nd-one", "motor/state"]
TOPICS = {"/tf", "/visualization/map/_2nd_one"}
published, publishers, connected, late = {}, [], [], []
is_shut_down = threading.Event()


class Publisher:
    def __init__(self, topic):
        self.topic = topic
        publishers.append(topic)

    def publish(self, body):
        (late if is_shut_down.is_set() else published.setdefault(self.topic, [])).append(body)


class Samples:
    """Some samples of one gateway, which ends then; the last gateway goes on until the bridge ends."""

    def __init__(self, life):
        self.life, self.left = life, 3

    def receive(self, timeout_s):
        if self.life == 4:
            time.sleep(0.001)
        elif self.left == 0:
            raise RobotError("the gateway has closed the connection")
        self.left -= 1
        if self.left % 2:
            raise TimeoutError
        return b"life %d" % self.life

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


class Robot:
    """The second connection is refused, and the first one is lost at the second search."""

    def __init__(self, gateway):
        connected.append(gateway)
        self.life, self.searches = len(connected), 0
        if self.life == 2:
            raise RobotError("the gateway is out of reach")
        if self.life == 3:
            raise ConnectionResetError

    def channels(self):
        self.searches += 1
        if self.life == 1 and self.searches > 1:
            raise BrokenPipeError
        return CHANNELS

    def subscribe(self, channel):
        return Samples(self.life)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def stand_in(name, **members):
    sys.modules[name] = ModuleType(name)
    sys.modules[name].__dict__.update(members)


def ended_by_a_signal():
    while not all(b"\0\1\0\0life 4" in published.get(topic, []) for topic in TOPICS):
        time.sleep(0.001)
    os.kill(os.getpid(), signal.SIGTERM)


node = SimpleNamespace(create_publisher=lambda kind, topic, depth: Publisher(topic), destroy_node=is_shut_down.set)
options = []
stand_in("rclpy", init=lambda **given: options.append(given), create_node=lambda name: node, shutdown=is_shut_down.set)
stand_in("rclpy.signals", SignalHandlerOptions=SimpleNamespace(NO="no"))
stand_in("rosidl_runtime_py")
stand_in("rosidl_runtime_py.utilities", get_message=lambda kind: kind)
ros2_bridge.Robot, ros2_bridge.SEARCH_S = Robot, 0.01
sys.argv = ["ros2_bridge.py", "--gateway", "socket"]
threading.Thread(target=ended_by_a_signal, daemon=True).start()
ros2_bridge.main()

assert connected == ["socket"] * 4, connected
assert sorted(publishers) == sorted(TOPICS), publishers
assert all(b"\0\1\0\0life 1" in bodies for bodies in published.values()), published
assert options == [{"signal_handler_options": "no"}]
time.sleep(0.05)
assert not late
for channel, topic in {"tf": "/tf", "a/1b/2-c": "/a/_1b/_2_c", "a--b/c1": "/a_b/c1"}.items():
    assert ros2_bridge.topic_of(channel) == topic, (channel, ros2_bridge.topic_of(channel))
print("ok")
