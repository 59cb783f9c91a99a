"""Decodes a file of drawings with two readers that this project did not write, and compares every field with what is expected.

    python check_scene.py VISUALIZATION.mcap EXPECTED.json

EXPECTED.json: {"anchors": [[x, y, z], ..], "places": {"stamp_ns": [x, y, z], ..}, "tensions": {"stamp_ns": [n, ..], ..},
"last_sample": [x, y, z, value], "log": {"name": .., "msg": .., "level": ..}}
"""

import json
import math
import re
import struct
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

CABLES = 8
KINDS = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/visualization/pose": "geometry_msgs/msg/PoseStamped",
    "/visualization/robot": "visualization_msgs/msg/MarkerArray",
    "/visualization/plan": "nav_msgs/msg/Path",
    "/visualization/track": "nav_msgs/msg/Path",
    "/visualization/samples/sensor-height": "sensor_msgs/msg/PointCloud2",
    "/visualization/map/height": "nav_msgs/msg/OccupancyGrid",
    "/log": "rcl_interfaces/msg/Log",
}


def same(what, found, expected):
    if found != expected:
        raise SystemExit(f"{what}: {found}, expected {expected}")


def stamp(header):
    same("frame", header.frame_id, "map")
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def xyz(point):
    return [point.x, point.y, point.z]


def upright(q):
    same("rotation", [q.x, q.y, q.z, q.w], [0.0, 0.0, 0.0, 1.0])


def robot(message, expected):
    cables = len(expected["anchors"])
    markers = list(message.markers)
    same("markers", [marker.id for marker in markers], list(range(3 + CABLES)))
    at = stamp(markers[0].header)
    node, tensions = expected["places"][str(at)], expected["tensions"][str(at)]
    lines, anchors, body = markers[:3]
    same("types", [lines.type, anchors.type, body.type], [5, 7, 2])
    drawn = [xyz(point) for point in lines.points]
    for i in range(CABLES):
        anchor = expected["anchors"][min(i, cables - 1)]
        same("a line", drawn[2 * i : 2 * i + 2], [anchor, node])
        same("an anchor", xyz(anchors.points[i]), anchor)
    same("colours", [len(lines.colors), len(anchors.colors)], [2 * CABLES, CABLES])
    same("the node", xyz(body.pose.position), node)
    for i, label in enumerate(markers[3:]):
        same("a label's action", label.action, 0 if i < cables else 2)
        if i < cables:
            same("a label", label.text, f"{tensions[i]:5.1f} N")
    for marker in markers:
        same("the rest", [marker.ns, marker.texture.format, marker.mesh_file.filename, marker.lifetime.sec], ["nims", "", "", 0])


def check(topic, message, expected):
    if topic == "/tf":
        (transform,) = message.transforms
        same("child", transform.child_frame_id, "node")
        at = stamp(transform.header)
        same("tf", xyz(transform.transform.translation), expected["places"][str(at)])
        upright(transform.transform.rotation)
    elif topic == "/visualization/pose":
        same("pose", xyz(message.pose.position), expected["places"][str(stamp(message.header))])
        upright(message.pose.orientation)
    elif topic == "/visualization/robot":
        robot(message, expected)
    elif topic in ("/visualization/plan", "/visualization/track"):
        same("poses", len(message.poses), 256)
        stamp(message.header)
        for pose in message.poses:
            upright(pose.pose.orientation)
            if not all(math.isfinite(x) for x in xyz(pose.pose.position)):
                raise SystemExit(f"{topic}: a pose that is no place")
    elif topic.startswith("/visualization/samples/"):
        same("fields", [(f.name, f.offset, f.datatype, f.count) for f in message.fields], [(n, 4 * i, 7, 1) for i, n in enumerate(["x", "y", "z", "value"])])
        same("size", [message.width, message.height, message.point_step, message.row_step], [1024, 1, 16, 16 * 1024])
        points = list(struct.iter_unpack("<4f", bytes(message.data)))
        real = [point for point in points if not math.isnan(point[3])]
        return real[-1] if real else None
    elif topic.startswith("/visualization/map/"):
        stamp(message.header)
        upright(message.info.origin.orientation)
        for field, value in expected["map"].items():
            same(f"map {field}", getattr(message.info, field), value)
        same("corner", xyz(message.info.origin.position), expected["corner"])
        cells = [cell for cell in message.data if cell != -1]
        same("cells", [len(message.data), cells], [64 * 64, expected["cells"]])
    elif topic == "/log":
        for field, value in expected["log"].items():
            same(f"log {field}", getattr(message, field), value)
    else:
        raise SystemExit(f"{topic}: unknown")
    return None


def main(file, expected_file):
    expected = json.loads(Path(expected_file).read_text())
    jazzy = get_typestore(Stores.ROS2_JAZZY)

    seen, last = {}, None
    with open(file, "rb") as stream:
        for schema, channel, _, message in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            same(channel.topic, schema.name, KINDS[channel.topic])
            if channel.topic not in seen:
                # word for word what ROS itself ships, types in any order
                text, _ = jazzy.generate_msgdef(schema.name, ros_version=2)
                parts = lambda text: sorted(part.strip() for part in re.split("={80}\n", text))
                same(f"definition of {schema.name}", parts(schema.data.decode()), parts(text))
            seen[channel.topic] = seen.get(channel.topic, 0) + 1
            last = check(channel.topic, message, expected) or last
    same("topics", sorted(seen), sorted(KINDS))
    same("last sample", list(last), expected["last_sample"])
    print(f"mcap-ros2-support: {sum(seen.values())} messages of {len(seen)} topics as expected")

    again = {}
    with AnyReader([Path(file)]) as reader:
        for connection, _, raw in reader.messages():
            # by the definition in the file, and by the one that ROS ships: the same
            for message in (reader.deserialize(raw, connection.msgtype), jazzy.deserialize_cdr(raw, connection.msgtype)):
                check(connection.topic, message, expected)
            again[connection.topic] = again.get(connection.topic, 0) + 1
    same("rosbags", again, seen)
    print(f"rosbags: {sum(again.values())} messages as expected")


if __name__ == "__main__":
    main(*sys.argv[1:])
