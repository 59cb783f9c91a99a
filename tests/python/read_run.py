"""Reads a run file with readers that this project did not write, and compares every field with what was published.

Usage: read_run.py RUN.mcap EXPECTED.json

The readers are `mcap` with `mcap-ros2-support`, and `rosbags` without any types of its own: both learn the types from the file alone.
Floating-point numbers are compared by their bits.
"""

import json
import re
import struct
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader


def value_at(message, path):
    """The field of a decoded message at a path such as `command[1].epoch`."""
    for part in re.findall(r"[a-z0-9_]+|\[\d+\]", path):
        message = message[int(part[1:-1])] if part.startswith("[") else getattr(message, part)
    return message


def comparable(kind, value):
    """A list of integers, floating-point numbers as the integer of their bits."""
    values = list(value) if hasattr(value, "__len__") else [value]
    if kind == "float64":
        return [struct.unpack("<Q", struct.pack("<d", number))[0] for number in values]
    if kind == "float32":
        return [struct.unpack("<I", struct.pack("<f", number))[0] for number in values]
    return [int(number) for number in values]


def difference(found, values):
    """Where two lists differ first: a map has thousands of cells, and one of them tells enough."""
    if len(found) != len(values):
        return f"has {len(found)} values, not {len(values)}"
    apart = [at for at, (one, other) in enumerate(zip(found, values, strict=True)) if one != other]
    return f"differs in {len(apart)} of {len(values)} values, first in {apart[0]}: {found[apart[0]]}, not {values[apart[0]]}"


class Check:
    """Takes the messages of one reader and compares them, channel by channel, in order."""

    def __init__(self, reader, expected):
        self.reader, self.expected = reader, expected
        self.seen = dict.fromkeys(expected, 0)
        self.fields = 0

    def take(self, topic, schema, log_time, publish_time, message):
        if topic not in self.expected:
            return  # what the recorder says about itself
        channel = self.expected[topic]
        number = self.seen[topic]
        self.seen[topic] += 1
        if number >= len(channel["samples"]):
            raise SystemExit(f"{self.reader}: {topic} has more than the {number} samples that were published")
        sample = channel["samples"][number]
        where = f"{self.reader}: {topic} sample {number}"
        if schema is not None and schema != channel["schema"]:
            raise SystemExit(f"{where}: type {schema}, not {channel['schema']}")
        for name, time in (("log_time", log_time), ("publish_time", publish_time)):
            if time is not None and sample.get(name, time) != time:
                raise SystemExit(f"{where}: {name} {time}, not {sample[name]}")
        for path, kind, values in sample["fields"]:
            found = comparable(kind, value_at(message, path))
            if found != values:
                raise SystemExit(f"{where}: {path} {difference(found, values)}")
            self.fields += 1

    def finish(self):
        for topic, channel in self.expected.items():
            if self.seen[topic] != len(channel["samples"]):
                raise SystemExit(
                    f"{self.reader}: {topic} has {self.seen[topic]} samples, {len(channel['samples'])} were published"
                )
        print(f"{self.reader}: {sum(self.seen.values())} samples of {len(self.seen)} channels, {self.fields} fields equal")


def main(run, expected_file):
    expected = json.loads(Path(expected_file).read_text())

    check = Check("mcap-ros2-support", expected)
    with open(run, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
        if reader.get_header().profile != "ros2":
            raise SystemExit("the profile of the file is not ros2")
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            check.take(channel.topic, schema.name, message.log_time, message.publish_time, decoded)
    check.finish()

    check = Check("mcap-ros2-support, convenience reader", expected)
    for message in read_ros2_messages(run):
        check.take(message.channel.topic, message.schema.name, message.log_time_ns, message.publish_time_ns, message.ros_msg)
    check.finish()

    check = Check("rosbags", expected)
    with AnyReader([Path(run)]) as reader:
        for connection, log_time, raw in reader.messages():
            check.take(connection.topic, connection.msgtype, log_time, None, reader.deserialize(raw, connection.msgtype))
    check.finish()


if __name__ == "__main__":
    main(*sys.argv[1:])
