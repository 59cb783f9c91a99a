#!/usr/bin/env python3
"""A sensor: rename the struct, define your fields (with units in their names), and read your device in read_device."""

import os
import time
from ctypes import c_double

from nims_sensor import Sample, Sensor

NAME = os.environ.get("NIMS_NAME", "example")  # the channel is sensor/NAME; `nims plug NAME` sets it
RATE_HZ = 10.0


class Example(Sample):
    """A reading of the device."""

    _fields_ = [
        ("value_v", c_double, "Voltage of the probe, V."),
        ("samples", c_double * 4, "The last four counts."),
    ]


def read_device(count):
    """Reads your device."""
    return 0.1 * count, [count, count + 1, count + 2, count + 3]


with Sensor(NAME, Example) as sensor:
    count = 0
    while sensor.running():
        value, samples = read_device(count)
        sensor.send(value_v=value, samples=samples)
        count += 1
        time.sleep(1.0 / RATE_HZ)
