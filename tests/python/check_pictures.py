"""Decodes the pictures of a run with two readers that this project did not write, and compares each with its file.

    python check_pictures.py RUN FOLDER

FOLDER has the pictures 0.jpg, 1.jpg, .., which the camera sent in this order, again and again. Prints their number.
"""

import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

TOPIC = "/blob/camera"


def by_mcap(path):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, _, message, picture in reader.iter_decoded_messages(topics=[TOPIC]):
            yield message.publish_time, picture


def by_rosbags(path):
    with AnyReader([path], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        for connection, _, raw in reader.messages(x for x in reader.connections if x.topic == TOPIC):
            yield None, reader.deserialize(raw, connection.msgtype)


def main():
    run, folder = map(Path, sys.argv[1:3])
    pictures = [path.read_bytes() for path in sorted(folder.glob("*.jpg"))]
    counts = []
    for read in (by_mcap, by_rosbags):
        number, last = 0, 0
        for path in sorted(run.glob("*.mcap")):
            for published, picture in read(path):
                if bytes(picture.data) != pictures[number % len(pictures)]:
                    sys.exit(f"{read.__name__}: picture {number} is not the one that was sent")
                if (picture.format, picture.header.frame_id) != ("jpeg", "node"):
                    sys.exit(f"{read.__name__}: {picture.format!r} in {picture.header.frame_id!r}")
                taken = picture.header.stamp.sec * 1_000_000_000 + picture.header.stamp.nanosec
                if taken <= last or (published is not None and published != taken):
                    sys.exit(f"{read.__name__}: picture {number} was taken at {taken}, after {last}; file {published}")
                number, last = number + 1, taken
        counts.append(number)
    if counts[0] != counts[1]:
        sys.exit(f"the readers find {counts} pictures")
    print(counts[0], "pictures are as they were sent, for both readers")


main()
