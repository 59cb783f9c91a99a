"""Pictures, scans and grids of different lengths on `blob/NAME`, as messages of ROS 2.

    import nims.blob

    with nims.blob.Pictures("camera", most_bytes=400_000, rate_hz=30.0) as camera:
        while camera.running():
            camera.send(open("picture.jpg", "rb").read())

The publisher is one of the robot's own processes and needs the extra `shm`: the gateway takes samples of 64 KiB at most.
Memory for the largest size is reserved when it is made. A class per message: `Pictures` (sensor_msgs/CompressedImage),
`Images` (sensor_msgs/Image), `Scans` (sensor_msgs/LaserScan), `Grids` (nav_msgs/OccupancyGrid).
"""

from __future__ import annotations

import ctypes
import math
import struct
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Self

import nims_sensor

# As in shared/runtime/messages/src/channels.rs. A publisher in Python needs memory for each sample of each subscriber,
# so there are fewer of them: the recorder, the sensor logger, the gateway, and one more.
ROOM_BYTES, MOST_SAMPLES, HISTORY, LEAST, LAG_S, SUBSCRIBERS = 32 << 20, 75, 8, 4, 2.5, 4
# Bytes around the content of a message, at most.
AROUND_BYTES = 200

TIME = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n")
HEADER = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n")
POINT = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n")
QUATERNION = ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n")
POSE = ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n")
META = (
    "nav_msgs/MapMetaData",
    "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\ngeometry_msgs/Pose origin\n",
)


class _Header(nims_sensor.Header):  # type: ignore[misc]
    """The header of a sample, beside its body in shared memory."""

    @classmethod
    def type_name(cls) -> str:
        return "nims_msgs/Header/1"


class _Message:
    """A message of ROS 2, in place of the struct of a sensor."""

    def __init__(self, name: str, own: str, nested: Sequence[tuple[str, str]]) -> None:
        self._name = name
        self._text = own + "".join(f"{'=' * 80}\nMSG: {name}\n{lines}" for name, lines in nested)

    def definition(self) -> str:
        """The complete definition."""
        return self._text

    def type_name(self) -> str:
        """`package/Type/hash`."""
        return f"{self._name}/{nims_sensor._hash(self._text):08x}"


class _Memory(nims_sensor._SharedMemory):  # type: ignore[misc]
    """The channel in shared memory, whose samples are bytes."""

    _GROUP, _PUBLISHERS = "blob", 1

    def __init__(self, name: str, message: _Message, most_bytes: int, rate_hz: float, domain: str | None) -> None:
        self._most_bytes = most_bytes
        # iceoryx2 compares the name of an element of the body.
        self._element = type("Element", (ctypes.c_uint8,), {"type_name": staticmethod(message.type_name)})
        super().__init__(name, message, domain, rate_hz)

    def _size(self) -> int:
        return self._most_bytes

    def _quality(self, size: int, rate_hz: float) -> tuple[int, int, int]:
        buffer = min(MOST_SAMPLES, max(ROOM_BYTES // (size * SUBSCRIBERS), LEAST), max(math.ceil(rate_hz * LAG_S), LEAST))
        return buffer, min(HISTORY, buffer // 2), SUBSCRIBERS

    def _typed(self, builder: Any) -> Any:
        import iceoryx2

        return builder.publish_subscribe(iceoryx2.Slice[self._element]).user_header(_Header)

    def _made(self, builder: Any) -> Any:
        return builder.initial_max_slice_len(self._most_bytes)

    def _more(self) -> list[tuple[str, str]]:
        # The attributes of a channel have room for eight.
        parts = math.ceil(len(self._message.definition()) / nims_sensor.ATTRIBUTE_BYTES)
        return [("blob.bytes", str(self._most_bytes))] if parts + 2 <= nims_sensor.ATTRIBUTES else []

    def publish(self, body: bytes, stamp_ns: int) -> None:
        sample = self._publisher.loan_slice_uninit(len(body))
        self._seq += 1
        header = _Header(seq=self._seq, stamp_ns=stamp_ns, published_ns=nims_sensor.now_ns(), oldest_input_ns=stamp_ns)
        ctypes.memmove(sample.user_header_ptr, ctypes.byref(header), ctypes.sizeof(header))
        ctypes.memmove(sample.payload_ptr, body, len(body))
        sample.assume_init().send()
        self._notifier.notify()


class _Cdr:
    """A little-endian CDR body; every number is aligned to its own size."""

    def __init__(self) -> None:
        self.body = bytearray()

    def numbers(self, code: str, *values: float) -> None:
        size = struct.calcsize(f"<{code}")
        self.body.extend(bytes(-len(self.body) % size))
        self.body.extend(struct.pack(f"<{len(values)}{code}", *values))

    def text(self, text: str) -> None:
        data = text.encode() + b"\0"
        self.bytes(data)

    def bytes(self, data: Any) -> None:
        view = memoryview(data).cast("B")
        self.numbers("I", len(view))
        self.body.extend(view)

    def time(self, unix_ns: int) -> None:
        self.numbers("i", unix_ns // 1_000_000_000)
        self.numbers("I", unix_ns % 1_000_000_000)


class _Blobs:
    """Publishes messages on `blob/NAME`."""

    MESSAGE: ClassVar[_Message]

    def __init__(self, name: str, *, most_bytes: int, rate_hz: float, frame: str = "node", domain: str | None = None) -> None:
        """`most_bytes`: size of the largest content, for which memory is reserved; `rate_hz`: messages per second at
        most; `frame`: in which frame the content is."""
        self._frame, self._most_bytes = frame, most_bytes
        nims_sensor._watch_signals()
        self._way = _Memory(name, self.MESSAGE, most_bytes + AROUND_BYTES, rate_hz, domain)

    def running(self) -> bool:
        """False after SIGINT or SIGTERM, for every publisher of the program, as with `nims_sensor.Sensor`."""
        self._way.look()
        return not nims_sensor._ended()

    def _begin(self, taken_ns: int) -> _Cdr:
        cdr = _Cdr()
        cdr.time(self._unix_ns(taken_ns))
        cdr.text(self._frame)
        return cdr

    def _unix_ns(self, mono_ns: int) -> int:
        """By the clock of the run, as in the run file; by this computer's while there is none."""
        try:
            unix, mono = Path(self._way.root, "clock.txt").read_text().split()
            return int(unix) + mono_ns - int(mono)
        except (OSError, ValueError):
            return time.time_ns() + mono_ns - int(nims_sensor.now_ns())

    def _send(self, cdr: _Cdr, size: int, taken_ns: int) -> None:
        if size > self._most_bytes or size == 0:
            raise nims_sensor.SensorError(f"`{self._way.channel}` has a content of {size} bytes; accepted: 1 to {self._most_bytes}, its most_bytes")
        self._way.publish(bytes(cdr.body), taken_ns)

    def close(self) -> None:
        """Ends the publisher; the channel stays while others have it open."""
        self._way.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _taken(taken_ns: int | None) -> int:
    return nims_sensor.now_ns() if taken_ns is None else taken_ns


class Pictures(_Blobs):
    """Pictures as JPEG or PNG files."""

    MESSAGE = _Message("sensor_msgs/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data\n", [HEADER, TIME])

    def send(self, file: Any, format: str = "jpeg", taken_ns: int | None = None) -> None:
        """Publishes a file, as bytes; `taken_ns`: when it was taken, on CLOCK_MONOTONIC; default: now."""
        taken_ns = _taken(taken_ns)
        cdr = self._begin(taken_ns)
        cdr.text(format)
        cdr.bytes(file)
        self._send(cdr, memoryview(file).nbytes, taken_ns)


class Images(_Blobs):
    """Pictures as rows of pixels."""

    MESSAGE = _Message(
        "sensor_msgs/Image",
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n",
        [HEADER, TIME],
    )

    def send(self, pixels: Any, height: int, width: int, encoding: str, taken_ns: int | None = None) -> None:
        """Publishes rows of pixels, as bytes or as an array; `encoding`: e.g. `rgb8` or `mono16`."""
        taken_ns, size = _taken(taken_ns), memoryview(pixels).nbytes
        cdr = self._begin(taken_ns)
        cdr.numbers("I", height, width)
        cdr.text(encoding)
        cdr.numbers("B", 0)
        cdr.numbers("I", size // max(height, 1))
        cdr.bytes(pixels)
        self._send(cdr, size, taken_ns)


class Scans(_Blobs):
    """Distances in a plane."""

    MESSAGE = _Message(
        "sensor_msgs/LaserScan",
        "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\nfloat32 time_increment\n"
        "float32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\nfloat32[] intensities\n",
        [HEADER, TIME],
    )

    def send(
        self,
        distances_m: Sequence[float],
        angles_rad: tuple[float, float],
        limits_m: tuple[float, float],
        duration_s: float,
        taken_ns: int | None = None,
    ) -> None:
        """Publishes distances; `angles_rad`: of the first and the last; `limits_m`: between which the device measures."""
        taken_ns, steps = _taken(taken_ns), max(len(distances_m) - 1, 1)
        cdr = self._begin(taken_ns)
        first, last = angles_rad
        cdr.numbers("f", first, last, (last - first) / steps, duration_s / steps, duration_s, *limits_m)
        cdr.numbers("I", len(distances_m))
        cdr.numbers("f", *distances_m)
        cdr.numbers("I", 0)
        self._send(cdr, 4 * len(distances_m), taken_ns)


class Grids(_Blobs):
    """Cells with -1 for unknown, 0 to 100 else."""

    MESSAGE = _Message(
        "nav_msgs/OccupancyGrid",
        "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data\n",
        [HEADER, TIME, META, POSE, POINT, QUATERNION],
    )

    def send(
        self, cells: Sequence[int], columns: int, cell_m: float, origin_m: tuple[float, float, float], taken_ns: int | None = None
    ) -> None:
        """Publishes cells row by row from the lowest y; `origin_m`: the corner with the lowest x and y."""
        taken_ns, data = _taken(taken_ns), struct.pack(f"{len(cells)}b", *cells)
        cdr = self._begin(taken_ns)
        cdr.time(self._unix_ns(taken_ns))
        cdr.numbers("f", cell_m)
        cdr.numbers("I", columns, len(data) // max(columns, 1))
        cdr.numbers("d", *origin_m, 0.0, 0.0, 0.0, 1.0)
        cdr.bytes(data)
        self._send(cdr, len(data), taken_ns)
