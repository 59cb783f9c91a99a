#!/usr/bin/env python3
"""A sensor as a plug-in of the gateway: name its values in the system file, and read your device in read_device."""

import os
import time

from nims_gateway import Sensor

NAME = os.environ.get("NIMS_NAME", "example")  # the [[plugin]] of the system file; the channel is sensor/NAME
RATE_HZ = 5.0  # at most the `rate_hz` of the [[plugin]]


def read_device(count):
    """Reads your device: as many numbers as the [[plugin]] has quantities, None where the device has none."""
    return [0.1 * count]


with Sensor(NAME) as sensor:
    count = 0
    while True:
        sensor.send(read_device(count))
        count += 1
        time.sleep(1.0 / RATE_HZ)
