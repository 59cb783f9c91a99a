"""Publishes what a robot draws in ROS 2, while it runs.

    ros2_bridge.py [--gateway SOCKET] [--list]

Needs the package `nims` (`pip install ./scripts/python`), and ROS 2 as it is installed: `source /opt/ros/*/setup.bash`.
The robot's process `visualization` publishes messages that ROS 2 itself defines; this program hands their bytes on, as
`/tf`, `/visualization/..` and `/log`. It looks for new channels every few seconds, only reads, and works for every user
who may look at the robot through its gateway.
"""

import argparse
import threading
import time

from nims import Robot

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
SEARCH_S = 3.0


def type_of(channel):
    """The type of a channel that ROS 2 knows; None for others."""
    begins = [name for name in TYPES if channel == name or name.endswith("/") and channel.startswith(name)]
    return TYPES[begins[0]] if begins else None


def topic_of(channel):
    """A topic of ROS 2 has no `-` in its name."""
    return "/" + channel.replace("-", "_")


def bridge(robot, channel, publisher):
    """Hands on every sample of a channel until the robot's gateway ends."""
    with robot.subscribe(channel) as samples:
        for sample in samples:
            publisher.publish(CDR + bytes(sample))


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("--gateway", help="socket of the robot's gateway; default: the one that is found")
    arguments.add_argument("--list", action="store_true", help="print the topics, their types and end")
    arguments = arguments.parse_args()
    robot = Robot(arguments.gateway)
    if arguments.list:
        for channel in sorted(filter(type_of, robot.channels())):
            print(topic_of(channel), type_of(channel))
        return
    import rclpy
    from rosidl_runtime_py.utilities import get_message

    rclpy.init()
    node, bridged = rclpy.create_node("nims"), {}
    while rclpy.ok():
        for channel in robot.channels():
            kind = type_of(channel)
            if kind and (channel not in bridged or not bridged[channel].is_alive()):
                publisher = node.create_publisher(get_message(kind), topic_of(channel), 10)
                bridged[channel] = threading.Thread(target=bridge, args=(robot, channel, publisher), daemon=True)
                bridged[channel].start()
                print(f"{topic_of(channel)} {kind}", flush=True)
        time.sleep(SEARCH_S)


if __name__ == "__main__":
    main()
