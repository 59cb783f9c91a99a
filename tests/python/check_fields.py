"""Fields of sensors with awkward names and numbers: what `nims_sensor` refuses, and what readers make of the rest.

Argument: a folder for run files. They are written as a recorder writes them, by the independent package `mcap`.
"""

import importlib.util
import json
import struct
import sys
import warnings
from ctypes import c_double, c_int16, c_uint8
from pathlib import Path

import numpy as np
from mcap.writer import Writer

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts" / "python"))
import nims_gateway
import nims_sensor
from nims.run import unit_of
from nims_run import Run, RunError

FOLDER = Path(sys.argv[1])
BEGIN_NS = 1_790_000_000 * 10**9
HEADER = "=" * 80 + "\nMSG: nims_msgs/Header\n" + "".join(f"uint64 {name}\n" for name, _ in nims_sensor.Header._fields_)


class Counts(nims_sensor.Sample):
    """Whole numbers."""

    _fields_ = [("value", c_double), ("offset", c_int16), ("steps", c_int16 * 4), ("count", c_uint8)]


class Kept:
    """A way that keeps what is published."""

    def publish(self, sample, stamp_ns):
        return sample


def check_numbers():
    sensor = nims_sensor.Sensor.__new__(nims_sensor.Sensor)
    sensor._message, sensor._kinds, sensor._way = Counts, dict(Counts._fields_), Kept()
    sent = sensor.send(value=np.float32(1.5), count=np.int64(255), offset=-32768, steps=np.array([[1, -2], [3, 32767]]))
    assert (sent.value, sent.count, sent.offset, list(sent.steps)) == (1.5, 255, -32768, [1, -2, 3, 32767])
    image = np.arange(16).reshape(4, 4)
    small = image.astype(np.int16)  # of the type of the field
    odd = [(small[::2, ::2], [0, 2, 8, 10]), (small[:2, :2].T, [0, 4, 1, 5]), (small[:2, :2].astype(">i2"), [0, 1, 4, 5])]
    for given, kept in (*odd, (image[::2, ::2], [0, 2, 8, 10]), (image[:2, :2].T, [0, 4, 1, 5]), (image[:2, :2].astype(">i4"), [0, 1, 4, 5])):
        assert list(sensor.send(value=0.0, count=0, offset=0, steps=given).steps) == kept, given
    # ctypes would keep the lowest bits: 44, -25536 and 1.
    for field, wrong in (("count", 300), ("count", -1), ("offset", 40000), ("steps", [0, 65537]), ("steps", np.array([40000]))):
        try:
            sensor.send(**{field: wrong})
        except nims_sensor.SensorError as error:
            assert f"`{field}`" in str(error), error
        else:
            raise AssertionError(f"{field}={wrong} was sent")


def check_readings():
    """A reading without a value, of a device that says so in another way."""
    sensor, sent = nims_gateway.Sensor("odd", "/nowhere.sock"), []
    sensor._call = lambda call: sent.append(json.dumps(call, allow_nan=False)) or {"reply": "done"}
    assert sensor.send([1, np.float32(2.5), None, float("nan"), np.inf], age_s=np.float32(0.5))
    reading = json.loads(sent[0])["reading"]
    assert reading["values"] == [1.0, 2.5, None, None, None] and reading["age_s"] == 0.5, reading


def write(path, fields, values):
    """Ten samples of `sensor/odd` from 1 s on, ten a second, each with these values and its number."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "check_fields")
        if fields:
            writer.add_metadata("run", {"t0_unix_ns": str(BEGIN_NS), "t0_mono_ns": "0"})
            text = "nims_msgs/Header header\n" + "".join(f"float64 {name}\n" for name in fields) + HEADER
            schema = writer.register_schema("nims_msgs/msg/Odd", "ros2msg", text.encode())
            channel = writer.register_channel("/sensor/odd", "cdr", schema, {"type": "nims_msgs/Odd/00000001"})
            for number in range(10):
                at_ns = BEGIN_NS + 10**9 + number * 10**8
                sample = struct.pack(f"<6Q{len(fields)}d", 1, number, number, at_ns, at_ns, at_ns, *values)
                writer.add_message(channel, at_ns, b"\0\1\0\0" + sample, at_ns, number)
        writer.finish()


def check_names(path):
    fields = ["t_s", "log_time_ns", "seq", "utc"]
    write(path, fields, [np.nan, np.inf, 7.0, 8.0])
    run = Run(path)
    samples = run["sensor/odd"]
    assert np.allclose(run.seconds(samples), 1.0 + 0.1 * np.arange(10)) and np.isinf(samples["log_time_ns_"]).all()
    columns = run.columns("sensor/odd")
    # As in a table of `nims export`: the time and the number are those of the recording.
    assert np.array_equal(columns["t_s"], run.seconds(samples)) and np.array_equal(columns["seq"], np.arange(10))
    assert np.isnan(columns["t_s_"]).all() and (columns["seq_"] == 7).all() and (columns["utc"] == 8).all()
    if importlib.util.find_spec("pandas"):
        import nims

        frame = nims.Run(path).frame("sensor/odd")
        assert str(frame["utc"].iloc[0]) == "2026-09-21 14:13:21+00:00" and (frame["utc_"] == 8).all(), frame


def check_files(folder):
    """A file without samples, as a recovery makes it of an empty one, is no end of the run; one that is no MCAP is named."""
    write(folder / "run.mcap", [], [])
    write(folder / "run-0002.mcap", ["value"], [1.0])
    run = Run(folder)
    assert run.begin_ns == BEGIN_NS and len(run["sensor/odd"]) == 10
    (folder / "run-0003.mcap").write_bytes(bytes(5000))
    try:
        Run(folder)
    except RunError as error:
        assert "run-0003.mcap" in str(error) and "\n" not in str(error), error
    else:
        raise AssertionError("zeros are a run file")


def check_lists(path):
    """Samples with lists of different lengths, such as pictures, keep no other channel from being read."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "check_fields")
        for topic, text in (("/blob/camera", "uint8[] data\n"), ("/sensor/even", "float64 value\n")):
            channel = writer.register_channel(topic, "cdr", writer.register_schema("nims_msgs/msg/" + topic[-4:].title(), "ros2msg", text.encode()))
            for number in range(5):
                body = struct.pack("<I", number + 1) + bytes(number + 1) if topic == "/blob/camera" else struct.pack("<d", number)
                writer.add_message(channel, BEGIN_NS + number, b"\0\1\0\0" + body, BEGIN_NS + number, number)
        writer.finish()
    run = Run(path)
    for read in (run.read, lambda: dict(run.pieces())):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            samples = read()
        assert list(samples) == ["sensor/even"] and samples["sensor/even"]["value"].tolist() == [0, 1, 2, 3, 4], samples
        assert len(told) == 1 and "`blob/camera`" in str(told[0].message), told
    try:
        run.read("blob/camera")
    except RunError as error:
        assert "`blob/camera`" in str(error), error
    else:
        raise AssertionError("pictures of different sizes in one array")


def check_units():
    units = {
        "length_m_2": "m", "stamp_ns": "ns", "rate_deg_s": "deg/s", "stiffness_n_m": "N/m", "flux_w_m2": "W/m2", "force_constant_n_a": "N/A",
        "expansion_per_k": "1/K", "speed_mm_s": "mm/s", "temperature_deg_c": "degC", "knot_s_m": "m", "knot_v_m_s": "m/s",
        "feed_m_per_s": "m/s", "pole_m": "m",
        # No unit is better than one of its parts.
        "ramp_v_s": "", "gain_v_per_m": "", "charge_a_s": "", "drop_ohm_a": "", "drift_hz_s": "", "scale_counts_per_m": "",
        "flow_l_s": "", "inertia_kg_m2": "", "name": "",
    }
    for name, unit in units.items():
        assert unit_of(name) == unit, (name, unit_of(name))


check_numbers()
check_readings()
check_names(FOLDER / "odd.mcap")
(FOLDER / "run").mkdir()
check_files(FOLDER / "run")
check_lists(FOLDER / "lists.mcap")
check_units()
