"""Publishes the samples of a sensor to nims from Python: one file, no build.

    from ctypes import c_double
    from nims_bus import Sample, Sensor

    class Soil(Sample):
        _fields_ = [("moisture_percent", c_double), ("temperature_c", c_double)]

    with Sensor("soil", Soil) as sensor:
        while sensor.running():
            moisture, temperature = read_the_probe()
            sensor.send(moisture_percent=moisture, temperature_c=temperature)

The struct is the message: its definition for run files and its type name are derived from it, so the recorder and
`nims channel echo` have the names of its fields. Needs the package `iceoryx2` in exactly the version of the robot's
programs.

The domain of the robot is the first of: the argument `domain`, `--domain NAME`, the variable NIMS_DOMAIN, the only
running robot. `nims plug NAME -- python3 FILE` starts the file as one of the robot's processes, and sets NIMS_DOMAIN
and NIMS_NAME.
"""

import ctypes
import keyword
import math
import os
import re
import signal
import sys
import time
from pathlib import Path

import iceoryx2

ICEORYX2 = "0.10.0"
SHARED_MEMORY = "/dev/shm"
# Bytes of an attribute, and attributes of a channel or an event. The definition of a message begins in the attributes
# of the channel, after its hash, and continues in those of events that exist only for it.
ATTRIBUTE_BYTES, ATTRIBUTES = 256, 8
# The same as for every channel of a sensor (shared/runtime/messages/src/channels.rs).
BUFFER, HISTORY, PUBLISHERS, SUBSCRIBERS, NODES, BORROWS, EVENT_PORTS, PROCESSES = 256, 128, 2, 12, 48, 1, 64, 1024
# The buffer holds BUFFER samples or KEPT_BYTES, whichever is less, and at least LEAST samples. Unlike in Rust, a
# publisher here needs memory for each sample of each subscriber, so a channel created here has fewer subscribers, and
# still fewer from LARGE_BYTES on.
KEPT_BYTES, LEAST, LARGE_BYTES, LARGE_SUBSCRIBERS = 16 << 20, 4, 128 << 10, 5
# Largest lag of a subscriber, s.
LAG_S = 2.5
# Shared memory reserved for the robot, and what a channel needs beside its samples, bytes.
MARGIN_BYTES, CHANNEL_BYTES = 4 << 20, 1 << 20
PRIMITIVES = {
    ctypes.c_double: "float64", ctypes.c_float: "float32",
    ctypes.c_int8: "int8", ctypes.c_int16: "int16", ctypes.c_int32: "int32", ctypes.c_int64: "int64",
    ctypes.c_uint8: "uint8", ctypes.c_uint16: "uint16", ctypes.c_uint32: "uint32", ctypes.c_uint64: "uint64",
}
# Names of fields that readers of run files reject.
RESERVED = {"name", "type", "fields", "encode", "decode"}


class SensorError(Exception):
    """One sentence: what is wrong, and what to do."""


class Header(ctypes.Structure):
    """The first field of every sample."""

    _fields_ = [
        ("life", ctypes.c_uint64),
        ("cycle", ctypes.c_uint64),
        ("seq", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("published_ns", ctypes.c_uint64),
        ("oldest_input_ns", ctypes.c_uint64),
    ]


class _WithHeader(type(ctypes.Structure)):
    """Adds the header before the fields, and explicit padding after them in place of hidden padding."""

    def __new__(mcs, name, bases, body):
        if bases != (ctypes.Structure,) and "_fields_" in body:
            fields = [("header", Header), *body["_fields_"]]
            size = sum(ctypes.sizeof(kind) for _, kind in fields)
            if size % 8:
                fields.append(("pad0", ctypes.c_uint8 * (8 - size % 8)))
            body["_fields_"] = fields
        return super().__new__(mcs, name, bases, body)


class Sample(ctypes.Structure, metaclass=_WithHeader):
    """Base of your message: a `_fields_` of numbers, fixed arrays of numbers, and structs of those."""

    @classmethod
    def definition(cls):
        """The ROS 2 definition of the struct."""
        nested = {}
        own = _lines(cls, nested)
        return own + "".join(f"{'=' * 80}\nMSG: nims_msgs/{name}\n{text}" for name, text in nested.items())

    @classmethod
    def type_name(cls):
        """The type name that both ends of a channel compare; it ends in a hash of the definition."""
        return f"nims_msgs/{cls.__name__}/{_hash(cls.definition()):08x}"


def _lines(struct, nested):
    text, end = "", 0
    if not re.fullmatch(r"[A-Z][A-Za-z0-9]*", struct.__name__):
        raise SensorError(f"the name of the struct `{struct.__name__}` is not in CamelCase: rename it")
    for name, kind in struct._fields_:
        if not re.fullmatch(r"[a-z](?:[a-z0-9]|_(?=[a-z0-9]))*", name) or keyword.iskeyword(name) or name in RESERVED:
            raise SensorError(f"the field `{name}` of `{struct.__name__}` has a name that readers reject: use another lower_case name")
        at = getattr(struct, name).offset
        if at != end:
            raise SensorError(
                f"there are {at - end} hidden bytes before `{name}` of `{struct.__name__}`: put wide fields first, or add pad0 = c_uint8 * {at - end} there"
            )
        end = at + ctypes.sizeof(kind)
        element, length = (kind._type_, f"[{kind._length_}]") if hasattr(kind, "_length_") else (kind, "")
        if element in PRIMITIVES:
            ros = PRIMITIVES[element]
        elif isinstance(element, type) and issubclass(element, ctypes.Structure):
            ros = f"nims_msgs/{element.__name__}"
            if element.__name__ not in nested:
                nested[element.__name__] = ""
                nested[element.__name__] = _lines(element, nested)
        else:
            raise SensorError(f"the field `{name}` of `{struct.__name__}` is not a number, array of numbers or struct of those")
        text += f"{ros}{length} {name}\n"
    if end != ctypes.sizeof(struct):
        raise SensorError(f"there are {ctypes.sizeof(struct) - end} hidden bytes at the end of `{struct.__name__}`: fill them with a field pad0")
    return text


def _hash(text):
    """32-bit FNV-1a."""
    value = 0x811C9DC5
    for byte in text.encode():
        value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
    return value


class Sensor:
    """Publishes samples of one type on `sensor/NAME`."""

    def __init__(self, name, message, domain=None, rate_hz=None):
        """`rate_hz`: samples per second, if known; limits the buffer of the channel."""
        _need_version()
        self.channel = f"sensor/{name}"
        self._message, self._seq, self._ended = message, 0, False
        self._kinds = dict(message._fields_)
        self._buffer, self._history, self._subscribers = _quality(ctypes.sizeof(message), rate_hz)
        self._bytes = (self._subscribers * (self._buffer + BORROWS) + self._history + 1) * ctypes.sizeof(message)
        _need_room(self.channel, self._bytes)
        root = _root(domain)
        self._prefix, self._reserved, self._reserve_at = f"nims{_hash(root):08x}_", set(), 0.0
        config = iceoryx2.config.default()
        scope = config.global_cfg
        scope.prefix = iceoryx2.FileName.new(self._prefix)
        scope.root_path = iceoryx2.Path.new(root)
        # The robot's own programs clean up after dead processes, in the necessary order.
        scope.node.cleanup_dead_nodes_on_creation = False
        scope.node.cleanup_dead_nodes_on_destruction = False
        scope.service.cleanup_dead_nodes_on_open = False
        iceoryx2.set_log_level(iceoryx2.LogLevel.Fatal)
        self._node = (
            iceoryx2.NodeBuilder.new()
            .name(iceoryx2.NodeName.new(name))
            .config(config)
            .signal_handling_mode(iceoryx2.SignalHandlingMode.Disabled)
            .create(iceoryx2.ServiceType.Ipc)
        )
        try:
            service = self._open()
            self._publisher = _patiently(lambda: service.publisher_builder().max_loaned_samples(1).create())
            self._reserve()
            self._notifier = self._event(self.channel)
            self._reserve()
        except Exception as error:
            if "IncompatibleTypes" in str(error):
                raise SensorError(
                    f"`{self.channel}` has other fields than `{message.type_name()}`: a changed type needs a new name, because the old channel"
                    f" is still open, e.g. in the recorder: use e.g. `{name}-2`"
                ) from None
            raise SensorError(f"`{self.channel}` cannot be published: {error}; other sensors of this name may run") from None
        # Wakes the processes that look for new channels, above all the recorder.
        self._event("system/channels").notify()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._end)

    def _builder(self):
        return (
            self._node.service_builder(iceoryx2.ServiceName.new(self.channel))
            .publish_subscribe(self._message)
            .enable_safe_overflow(True)
            .subscriber_max_borrowed_samples(BORROWS)
            .max_publishers(PUBLISHERS)
            .max_subscribers(self._subscribers)
            .max_nodes(NODES)
        )

    def _sized(self):
        return self._builder().subscriber_max_buffer_size(self._buffer).history_size(self._history)

    def _reserve(self):
        """Allocates the memory of new files: a page that is missing on access ends this process and its subscribers.

        Between the creation and this call, for about a millisecond, another user can still take the memory."""
        for entry in os.scandir(SHARED_MEMORY):
            if not entry.name.startswith(self._prefix) or entry.name in self._reserved:
                continue
            self._reserved.add(entry.name)
            try:
                found = entry.stat(follow_symlinks=False)
                if found.st_blocks * 512 >= found.st_size:
                    continue
                file = os.open(entry.path, os.O_RDWR | os.O_NOFOLLOW)
                try:
                    os.posix_fallocate(file, 0, found.st_size)
                finally:
                    os.close(file)
            except FileNotFoundError:
                pass  # just removed by its owner
            except PermissionError:
                self._reserved.discard(entry.name)  # being created; reserved by its creator, or by the next call
            except OSError as error:
                raise SensorError(f"`{self.channel}` cannot be published: shared memory has no room for it ({error.strerror})") from None

    def _open(self):
        text = self._message.definition()
        first = (ATTRIBUTES - 1) * ATTRIBUTE_BYTES
        self._sheets = [
            self._sheet(f"schema/{_hash(text):08x}/{number}", text[at : at + ATTRIBUTES * ATTRIBUTE_BYTES])
            for number, at in enumerate(range(first, len(text), ATTRIBUTES * ATTRIBUTE_BYTES), 1)
        ]
        attributes = _attributes(text[:first], [("schema.hash", f"{_hash(text):08x}")])
        last = None
        for _ in range(200):  # another process may be creating or removing the channel at the same time
            for attempt in (lambda: self._builder().open(), lambda: self._sized().create_with_attributes(attributes)):
                try:
                    return attempt()
                except iceoryx2.PublishSubscribeOpenError as error:
                    last = error
                except iceoryx2.PublishSubscribeCreateError as error:
                    last = last or error
            if "IncompatibleTypes" in str(last):
                break
            time.sleep(0.01)
        raise last

    def _event(self, channel):
        places = PROCESSES if channel == "system/channels" else EVENT_PORTS
        service = (
            self._node.service_builder(iceoryx2.ServiceName.new(channel))
            .event()
            .max_notifiers(places)
            .max_listeners(EVENT_PORTS)
            .max_nodes(places)
            .open_or_create()
        )
        return service.notifier_builder().create()

    def _sheet(self, name, text):
        """A continuation of the definition, held open while the sensor runs."""
        builder = lambda: self._node.service_builder(iceoryx2.ServiceName.new(name)).event().max_notifiers(1).max_listeners(1).max_nodes(PROCESSES)
        last = None
        for _ in range(200):
            for attempt in (lambda: builder().open(), lambda: builder().create_with_attributes(_attributes(text))):
                try:
                    return attempt()
                except (iceoryx2.EventOpenError, iceoryx2.EventCreateError) as error:
                    last = error
            time.sleep(0.01)
        raise last

    def running(self):
        """False after SIGINT or SIGTERM."""
        self._publisher.update_connections()
        if time.monotonic() > self._reserve_at:
            self._reserve_at = time.monotonic() + 1.0
            self._reserve()
        return not self._ended

    def send(self, stamp_ns=None, **fields):
        """Publishes one sample. `stamp_ns`: when it was true, on CLOCK_MONOTONIC; default: now. Arrays take any sequence."""
        self._seq += 1
        stamp_ns = now_ns() if stamp_ns is None else stamp_ns
        sample = self._message()
        header = sample.header
        header.seq, header.stamp_ns, header.oldest_input_ns, header.published_ns = self._seq, stamp_ns, stamp_ns, now_ns()
        for name, value in fields.items():
            kind = self._kinds.get(name)
            if kind is None:
                raise SensorError(f"`{self._message.__name__}` has no field `{name}`")
            if hasattr(kind, "_length_"):
                _fill(getattr(sample, name), value, name)
            else:
                setattr(sample, name, value)
        self._publisher.loan_uninit().write_payload(sample).send()
        self._notifier.notify()

    def _end(self, *_):
        self._ended = True

    def __enter__(self):
        return self

    def __exit__(self, *_):
        del self._publisher, self._notifier, self._sheets, self._node


def _attributes(text, more=()):
    attributes = iceoryx2.AttributeSpecifier.new()
    parts = [text[at : at + ATTRIBUTE_BYTES] for at in range(0, len(text), ATTRIBUTE_BYTES)]
    for key, value in [*more, *((f"schema.{i}", part) for i, part in enumerate(parts))]:
        attributes = attributes.define(iceoryx2.AttributeKey.new(key), iceoryx2.AttributeValue.new(value))
    return attributes


def _quality(size, rate_hz):
    """Buffer, history and subscribers of a channel whose samples have this size."""
    subscribers = SUBSCRIBERS if size < LARGE_BYTES else LARGE_SUBSCRIBERS
    buffer = min(BUFFER, max(KEPT_BYTES // (size * subscribers), LEAST))
    if rate_hz is not None:
        buffer = min(buffer, max(math.ceil(rate_hz * LAG_S), LEAST))
    return buffer, min(HISTORY, buffer // 2), subscribers


def _need_room(channel, size):
    """Raises an error if shared memory has no room for the channel, before anything is created."""
    room = os.statvfs(SHARED_MEMORY)
    free, needed = room.f_bavail * room.f_frsize, size + CHANNEL_BYTES + MARGIN_BYTES
    if room.f_blocks and free < needed:
        raise SensorError(
            f"`{channel}` needs {needed / 1e6:.1f} MB of shared memory, and {free / 1e6:.1f} MB are free: make the samples smaller, give their"
            " rate_hz, or make /dev/shm larger"
        )


def _fill(array, values, name):
    """Copies values into an array of a sample: at once for bytes and arrays of the same type (numpy, array, ctypes)."""
    kind = array._type_
    try:
        view = memoryview(values)
    except TypeError:
        view = None
    plain = view is not None and view.c_contiguous
    same = plain and kind in PRIMITIVES and _same_number(view, kind)
    given = view.nbytes // view.itemsize if plain and view.itemsize else len(values)
    if given > len(array):
        raise SensorError(f"the field `{name}` holds {len(array)} numbers, but {given} were given")
    if same:
        ctypes.memmove(array, (ctypes.c_char * view.nbytes).from_buffer(view) if not view.readonly else bytes(view), view.nbytes)
    else:
        array[:given] = list(values) if plain and view.ndim <= 1 else [number for number in values]


def _same_number(view, kind):
    """Whether the numbers of a buffer have the memory layout of this type."""
    code = view.format.lstrip("@=<")
    if len(code) != 1 or view.itemsize != ctypes.sizeof(kind):
        return False
    ros = PRIMITIVES[kind]
    wanted = "fd" if ros.startswith("float") else "BHILQN" if ros.startswith("u") else "bhilqn"
    return code in wanted or (view.itemsize == 1 and code == "c")


def _patiently(make):
    """Retries: a killed predecessor keeps its place until the supervisor has cleaned up."""
    for _ in range(200):
        try:
            return make()
        except iceoryx2.PublisherCreateError:
            time.sleep(0.01)
    return make()


def now_ns():
    """The clock of all stamps: CLOCK_MONOTONIC."""
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


def _need_version():
    from importlib.metadata import version

    found = version("iceoryx2")
    if found != ICEORYX2:
        raise SensorError(f"the package iceoryx2 is {found}, but the robot's programs need {ICEORYX2}: pip install iceoryx2=={ICEORYX2}")


def _root(domain):
    if domain is None and "--domain" in sys.argv[1:-1]:
        domain = sys.argv[sys.argv.index("--domain") + 1]
    domain = domain or os.environ.get("NIMS_DOMAIN")
    beginning = f"{SHARED_MEMORY}/nims-{os.geteuid()}-"
    if domain:
        root = domain if domain.startswith("/") else beginning + domain
        if not Path(root).is_dir():
            raise SensorError(f"no robot runs in the domain `{domain}`: start it with `nims up SYSTEM.toml`")
        return root
    running = [str(path.parent) for path in Path(SHARED_MEMORY).glob(f"nims-{os.geteuid()}-*/running.json")]
    if len(running) != 1:
        found = ", ".join(path.removeprefix(beginning) for path in running)
        raise SensorError(f"several robots run ({found}): choose one with --domain NAME" if running else "no robot runs here: start one with `nims up SYSTEM.toml`")
    return running[0]
