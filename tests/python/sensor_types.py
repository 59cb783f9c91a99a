"""Prints the type name and the definition that scripts/python/nims_sensor.py derives from a ctypes struct, for comparison with ours."""

import sys
from ctypes import c_double, c_uint8
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts" / "python"))
from nims_sensor import Sample, SensorError


class Spot(Sample):
    """A spot."""

    _fields_ = [
        ("value", c_double * 8, "Values, m."),
        ("latency_s", c_double, "Time since the measurement, s."),
        ("count", c_uint8),
        ("quality", c_uint8),
    ]


class Hidden(Sample):
    _fields_ = [("flag", c_uint8), ("value", c_double)]


class Named(Sample):
    _fields_ = [("class", c_double)]


class Foreign(Sample):
    _fields_ = [("a", c_double, "A width, \u00b5m.")]


print(Spot.type_name())
print(Spot.definition(), end="")
for refused in (Hidden, Named, Foreign):
    try:
        refused.definition()
        print(f"{refused.__name__} was accepted")
    except SensorError as error:
        print(f"refused: {error}")
