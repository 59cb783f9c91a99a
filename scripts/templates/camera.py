#!/usr/bin/env python3
"""A camera for a robot: change the function. As it is, it sends the JPEG files of a folder, again and again.

    nims plug camera -- python3 camera.py FOLDER

Needs the package `nims` with its extra `shm`.
"""

import argparse
import itertools
import os
import sys
import time
from pathlib import Path

import nims.blob


def pictures(folder):
    """The pictures as JPEG files, each when it was taken: replace this by what delivers those of the camera."""
    files = [path.read_bytes() for path in sorted(Path(folder).glob("*.jpg"))]
    if not files:
        sys.exit(f"{folder} has no JPEG file (*.jpg): name a folder with some")
    return itertools.cycle(files)


def main():
    """Publishes them with a rate."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("folder")
    options.add_argument("--rate", type=float, default=30.0, help="pictures per second")
    options.add_argument("--most-bytes", type=int, default=400_000, help="size of the largest picture: memory is reserved for it")
    given, _ = options.parse_known_args()
    files, due = pictures(given.folder), time.monotonic()
    with nims.blob.Pictures(os.environ.get("NIMS_NAME", "camera"), most_bytes=given.most_bytes, rate_hz=given.rate) as camera:
        while camera.running():
            camera.send(next(files))
            due = max(due + 1.0 / given.rate, time.monotonic() - 1.0)
            time.sleep(max(due - time.monotonic(), 0.0))


main()
