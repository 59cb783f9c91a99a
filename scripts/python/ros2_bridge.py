"""Publishes what a robot draws in ROS 2, while it runs.

    ros2_bridge.py [--gateway SOCKET] [--list]

Needs the package `nims` (`pip install ./scripts/python`), and ROS 2 as it is installed: `source /opt/ros/*/setup.bash`.
The robot's process `visualization` publishes messages that ROS 2 itself defines; this program hands their bytes on, as
`/tf`, `/visualization/..` and `/log`. It looks for new channels every few seconds, only reads, and works for every user
who may look at the robot through its gateway. When the gateway ends, it waits for the next one; SIGINT and SIGTERM end
it.
"""

import argparse
import re
import signal
import sys
import threading

from nims import Robot, RobotError

# Channels, and beginnings of channels, with their types.
TYPES = {
    "tf": "tf2_msgs/msg/TFMessage",
    "log": "rcl_interfaces/msg/Log",
    "visualization/pose": "geometry_msgs/msg/PoseStamped",
    "visualization/robot": "visualization_msgs/msg/MarkerArray",
    "visualization/plan": "nav_msgs/msg/Path",
    "visualization/track": "nav_msgs/msg/Path",
    "visualization/samples/": "sensor_msgs/msg/PointCloud2",
    "visualization/map/": "nav_msgs/msg/OccupancyGrid",
}
# In front of every message in ROS 2: CDR, little endian.
CDR = b"\x00\x01\x00\x00"
# Between two looks for new channels or another gateway, and the longest until a thread looks whether it should end, s.
SEARCH_S, WAKE_S = 3.0, 0.5


def type_of(channel):
    """The type of a channel that ROS 2 knows; None for others."""
    begins = [name for name in TYPES if channel == name or name.endswith("/") and channel.startswith(name)]
    return TYPES[begins[0]] if begins else None


def topic_of(channel):
    """A topic of ROS 2 has no `-` and no `__` in its name, and no part of it begins with a digit."""
    name = re.sub("[-_]+", "_", channel)
    return "/" + re.sub(r"(^|/)(?=[0-9])", r"\1_", name)


class Bridge:
    """Hands channels of a robot on, each through one publisher, which outlives the gateway."""

    def __init__(self, gateway, publisher_of):
        """`publisher_of`: makes the publisher of a topic with a type."""
        self.ended = threading.Event()
        self._gateway, self._publisher_of = gateway, publisher_of
        self._publishers, self._threads, self._told = {}, {}, None

    def run(self):
        """Returns after `ended`, when nothing is published any more."""
        while not self.ended.is_set():
            try:
                with Robot(self._gateway) as robot:
                    self._told = None
                    while not self.ended.is_set():
                        self._search(robot)
                        self.ended.wait(SEARCH_S)
            except (RobotError, OSError) as error:
                self._tell(str(error) or type(error).__name__)
                self.ended.wait(SEARCH_S)
        for thread in self._threads.values():
            thread.join()

    def _search(self, robot):
        """Begins with new channels, and again with those that ended with the gateway."""
        for channel in filter(type_of, robot.channels()):
            if channel in self._threads and self._threads[channel].is_alive():
                continue
            if channel not in self._publishers:
                self._publishers[channel] = self._publisher_of(topic_of(channel), type_of(channel))
                print(f"{topic_of(channel)} {type_of(channel)}", flush=True)
            self._threads[channel] = threading.Thread(target=self._hand_on, args=(robot, channel), daemon=True)
            self._threads[channel].start()

    def _hand_on(self, robot, channel):
        try:
            with robot.subscribe(channel) as samples:
                while not self.ended.is_set():
                    try:
                        sample = samples.receive(WAKE_S)
                    except TimeoutError:
                        continue
                    self._publishers[channel].publish(CDR + bytes(sample))
        except (RobotError, OSError) as error:
            self._tell(f"{channel}: {error}")

    def _tell(self, sentence):
        """Prints a sentence, but not at each attempt."""
        if sentence != self._told and not self.ended.is_set():
            print(f"ros2_bridge: {sentence}", file=sys.stderr, flush=True)
        self._told = sentence


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("--gateway", help="socket of the robot's gateway; default: the one that is found")
    arguments.add_argument("--list", action="store_true", help="print the topics, their types and end")
    arguments = arguments.parse_args()
    if arguments.list:
        try:
            with Robot(arguments.gateway) as robot:
                channels = robot.channels()
        except (RobotError, OSError) as error:
            sys.exit(f"ros2_bridge: {error}")
        for channel in sorted(filter(type_of, channels)):
            print(topic_of(channel), type_of(channel))
        return
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from rosidl_runtime_py.utilities import get_message

    # The handlers of ROS 2 would end its context while samples are being published.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("nims")
    bridge = Bridge(arguments.gateway, lambda topic, kind: node.create_publisher(get_message(kind), topic, 10))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: bridge.ended.set())
    bridge.run()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
