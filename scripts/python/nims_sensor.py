"""A sensor in Python: one file, no build, no packages.

    from ctypes import c_double
    from nims_sensor import Sample, Sensor

    class Soil(Sample):
        "A probe in the ground."

        _fields_ = [
            ("moisture_percent", c_double, "Water by volume, %."),
            ("temperature_c", c_double, "Temperature, degC."),
        ]

    with Sensor("soil", Soil) as sensor:
        while sensor.running():
            moisture, temperature = read_the_probe()
            sensor.send(moisture_percent=moisture, temperature_c=temperature)

A field is a number, a truth value (`c_bool`), an `enum.IntEnum` (its values become constants of the message), a text
(`c_char * 32`, UTF-8), an array (`c_double * 8`), also of two dimensions (`(c_double * 8) * 4`, 4 rows of 8), or a
struct of those.

The struct is the message: its definition for run files and its type name are derived from it, so the recorder and
`nims channel info|echo` have the names of its fields, and what they mean.

The samples go through the gateway of the robot. Its socket is the first of: the argument `gateway`, `--gateway PATH`,
the variable NIMS_GATEWAY, the gateway that has joined the robot of the domain, the only one in /run/nims-gateway. With
`--shared-memory` (or the argument `shared_memory`) the sensor is one of the robot's own processes and publishes in shared
memory; that needs the package `iceoryx2` in exactly the version of the robot's programs.

The domain is the first of: the argument `domain`, `--domain NAME`, the variable NIMS_DOMAIN, the only running robot.
`nims plug NAME -- python3 FILE` starts the file with the robot, and sets NIMS_DOMAIN and NIMS_NAME.
"""

import ctypes
import enum
import json
import keyword
import math
import operator
import os
import re
import signal
import socket
import struct
import sys
import threading
import time
from pathlib import Path

ICEORYX2 = "0.10.0"
# In the error of iceoryx2 for an event that as many processes have open as it has places for.
FULL = "ExceedsMaxNumberOfNodes"
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
    ctypes.c_bool: "bool",
    ctypes.c_double: "float64", ctypes.c_float: "float32",
    ctypes.c_int8: "int8", ctypes.c_int16: "int16", ctypes.c_int32: "int32", ctypes.c_int64: "int64",
    ctypes.c_uint8: "uint8", ctypes.c_uint16: "uint16", ctypes.c_uint32: "uint32", ctypes.c_uint64: "uint64",
}
# Smallest and largest integer of each type: ctypes keeps the lowest bits of others without a word.
LIMITS = {
    kind: (0, 2**bits - 1) if ros.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for kind, ros in PRIMITIVES.items()
    for bits in [8 * ctypes.sizeof(kind)]
    if "int" in ros
}
# The folder of the gateways' sockets, and reasons of a gateway: no robot runs; the sensor is taken; samples, and
# connections, come too often.
GATEWAYS = "/run/nims-gateway"
NO_ROBOT, TAKEN, TOO_OFTEN, TAKEN_TOO_OFTEN = 452, 466, 467, 473
# Time for which a sensor waits for a gateway, and for its predecessor to leave, s.
PATIENCE_S = 5.0
# Names of fields that readers of run files reject.
RESERVED = {"name", "type", "fields", "encode", "decode"}


class SensorError(Exception):
    """One sentence: what is wrong, and what to do."""


class NoGateway(SensorError):
    """No gateway runs, or one of several has to be chosen."""


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
    """Adds the header before the fields, and explicit padding after them in place of hidden padding; takes the comments
    of the fields out of what ctypes sees."""

    def __new__(mcs, name, bases, body):
        if "_fields_" in body:
            given = body["_fields_"]
            body["_comments_"] = {field[0]: field[2] for field in given if len(field) > 2 and isinstance(field[2], str)}
            body["_enums_"] = {field[0]: field[1] for field in given if isinstance(field[1], type) and issubclass(field[1], enum.IntEnum)}
            fields = [(field[0], _integer(field[1]) if field[0] in body["_enums_"] else field[1]) for field in given]
            if bases != (ctypes.Structure,):
                fields.insert(0, ("header", Header))
                size = sum(ctypes.sizeof(field[1]) for field in fields)
                if size % 8:
                    fields.append(("pad0", ctypes.c_uint8 * (8 - size % 8)))
            body["_fields_"] = fields
        return super().__new__(mcs, name, bases, body)


def _integer(choices):
    """The smallest integer that holds every value of an enum."""
    values = [int(choice) for choice in choices]
    kinds = [ctypes.c_uint8, ctypes.c_uint16, ctypes.c_uint32] if min(values) >= 0 else [ctypes.c_int8, ctypes.c_int16, ctypes.c_int32]
    for kind in kinds:
        bits = 8 * ctypes.sizeof(kind)
        low, high = (0, 2**bits) if min(values) >= 0 else (-(2 ** (bits - 1)), 2 ** (bits - 1))
        if low <= min(values) and max(values) < high:
            return kind
    raise SensorError(f"`{choices.__name__}` has values beyond 32 bits: use smaller ones")


class Part(ctypes.Structure, metaclass=_WithHeader):
    """Base of a struct inside of a message that has comments too; without them a ctypes.Structure does."""


class Sample(ctypes.Structure, metaclass=_WithHeader):
    """Base of your message: a `_fields_` of numbers, fixed arrays of numbers, and structs of those, each with a comment
    that says what it is and in which unit. The documentation of the class is that of the message."""

    @classmethod
    def definition(cls):
        """The ROS 2 definition of the struct, with its comments."""
        nested = {}
        own = _lines(cls, nested)
        return own + "".join(f"{'=' * 80}\nMSG: nims_msgs/{name}\n{text}" for name, text in nested.items())

    @classmethod
    def type_name(cls):
        """The type name that both ends of a channel compare; it ends in a hash of the definition without comments."""
        return f"nims_msgs/{cls.__name__}/{_hash(_plain(cls.definition())):08x}"


def _lines(struct_type, nested):
    name_of = struct_type.__name__
    if not re.fullmatch(r"[A-Z][A-Za-z0-9]*", name_of):
        raise SensorError(f"the name of the struct `{name_of}` is not in CamelCase: rename it")
    documented = struct_type.__dict__.get("__doc__") if isinstance(struct_type, _WithHeader) else None
    comments = getattr(struct_type, "_comments_", {})
    text, end = _comment(documented, name_of), 0
    for name, kind in struct_type._fields_:
        if not re.fullmatch(r"[a-z](?:[a-z0-9]|_(?=[a-z0-9]))*", name) or keyword.iskeyword(name) or name in RESERVED:
            raise SensorError(f"the field `{name}` of `{name_of}` has a name that readers reject: use another lower_case name")
        at = getattr(struct_type, name).offset
        if at != end:
            raise SensorError(
                f"there are {at - end} hidden bytes before `{name}` of `{name_of}`: put wide fields first, or add pad0 = c_uint8 * {at - end} there"
            )
        end = at + ctypes.sizeof(kind)
        element, shape = kind, []
        while hasattr(element, "_length_"):
            element, shape = element._type_, [*shape, element._length_]
        length = f"[{math.prod(shape)}]" if shape else ""
        comment = comments.get(name)
        if len(shape) > 1:
            # ROS 2 has arrays of one dimension.
            rows = f"{' x '.join(str(count) for count in shape)}, row by row."
            comment = f"{comment}\n{rows}" if comment else rows
        if element is ctypes.c_char:
            ros = "uint8"
        elif element in PRIMITIVES:
            ros = PRIMITIVES[element]
        elif isinstance(element, type) and issubclass(element, ctypes.Structure):
            ros = f"nims_msgs/{element.__name__}"
            if element.__name__ not in nested:
                nested[element.__name__] = ""
                nested[element.__name__] = _lines(element, nested)
        else:
            raise SensorError(f"the field `{name}` of `{name_of}` is not a number, array of numbers or struct of those")
        choices = getattr(struct_type, "_enums_", {}).get(name, ())
        constants = "".join(f"{ros} {name.upper()}_{choice.name.upper()}={int(choice)}\n" for choice in choices)
        text += f"{constants}{_comment(comment, f'{name_of}.{name}')}{ros}{length} {name}\n"
    if end != ctypes.sizeof(struct_type):
        raise SensorError(f"there are {ctypes.sizeof(struct_type) - end} hidden bytes at the end of `{name_of}`: fill them with a field pad0")
    return text


def _comment(words, of):
    """The lines of a comment. A channel stores ASCII only, so that every program can read it."""
    if not words:
        return ""
    lines = [line.strip() for line in words.strip().splitlines()]
    for line in lines:
        foreign = [character for character in line if not character.isascii() or not character.isprintable()]
        if foreign:
            raise SensorError(f"the comment of `{of}` has the character `{foreign[0]}`: use ASCII, e.g. degC, um or m2")
    return "".join(f"# {line}".rstrip() + "\n" for line in lines)


def _plain(text):
    """A definition without its comments."""
    return "".join(line for line in text.splitlines(keepends=True) if not line.startswith("#"))


def _hash(text):
    """32-bit FNV-1a."""
    value = 0x811C9DC5
    for byte in text.encode():
        value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
    return value


# Whether SIGINT or SIGTERM has come. It is one for the whole program: each publisher ends with it.
_end = threading.Event()


def _ended():
    return _end.is_set()


def _on_signal(*_):
    _end.set()


def _watch_signals():
    """Installs the handler. Python accepts one from the main thread only; elsewhere the program's own stays."""
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, _on_signal)


class Sensor:
    """Publishes samples of one type on `sensor/NAME`."""

    def __init__(self, name, message, domain=None, gateway=None, rate_hz=None, shared_memory=False):
        """`rate_hz`: samples per second, if known; in shared memory it limits the buffer of the channel."""
        self._message, self._kinds = message, dict(message._fields_)
        _watch_signals()
        if shared_memory or "--shared-memory" in sys.argv[1:]:
            self._way = _SharedMemory(name, message, domain, rate_hz)
        else:
            self._way = _Gateway(name, message, domain, gateway)

    def running(self):
        """False after SIGINT or SIGTERM, for every sensor of the program. A sensor made in the main thread installs the
        handler; a program whose sensors are all made in other threads handles the signals itself."""
        self._way.look()
        return not _ended()

    def send(self, stamp_ns=None, **fields):
        """Publishes one sample; returns False while no robot or no gateway takes it.

        `stamp_ns`: when it was true, on CLOCK_MONOTONIC; default: now. Arrays take any sequence."""
        sample = self._message()
        for name, value in fields.items():
            kind = self._kinds.get(name)
            if kind is None:
                raise SensorError(f"`{self._message.__name__}` has no field `{name}`")
            if hasattr(kind, "_length_"):
                self._set_array(sample, name, kind, value)
            else:
                setattr(sample, name, _whole(value, kind, name) if kind in LIMITS else value)
        return self._way.publish(sample, now_ns() if stamp_ns is None else stamp_ns)

    def _set_array(self, sample, name, kind, value):
        if kind._type_ is ctypes.c_char:
            text = value.encode() if isinstance(value, str) else bytes(value)
            if len(text) > kind._length_:
                raise SensorError(f"the text of `{name}` has {len(text)} bytes, and {kind._length_} fit: shorten it, or make the field longer")
            setattr(sample, name, text)
        elif hasattr(kind._type_, "_length_"):
            if len(value) != kind._length_:
                raise SensorError(f"the field `{name}` has {kind._length_} rows, but {len(value)} were given")
            for row, values in zip(getattr(sample, name), value, strict=True):
                _fill(row, values, name)
        else:
            _fill(getattr(sample, name), value, name)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._way.close()


class _Gateway:
    """The way through the gateway, which needs nothing but its socket. It connects again when the gateway was started
    again, and declares the message on each connection."""

    def __init__(self, name, message, domain, gateway):
        self._name, self._message, self._definition = name, message, message.definition()
        self._given, self._domain = gateway, domain
        self._link, self._declared, self._number, self._told = None, False, 0, set()
        give_up = time.monotonic() + PATIENCE_S
        while True:
            try:
                self._socket()
                return
            except NoGateway:
                if time.monotonic() > give_up:
                    raise
                time.sleep(0.2)  # it may be starting too

    def _socket(self):
        given = self._given or _argument("--gateway") or os.environ.get("NIMS_GATEWAY")
        return given or _gateway_of(self._domain)

    def look(self):
        """Nothing to do between two samples."""

    def publish(self, sample, stamp_ns):
        try:
            if not self._declare():
                return False
            answer = self._call({"call": "sample", "sensor": self._name, "stamp_ns": stamp_ns}, bytes(sample))
        except (OSError, NoGateway) as error:
            return self._lost(error)
        if answer["reply"] == "done":
            self._told.clear()
            return True
        if answer.get("reason") == NO_ROBOT:
            return False
        if answer.get("reason") != TOO_OFTEN:
            raise SensorError(_sentence(answer))
        self._tell(_sentence(answer))
        return False

    def _declare(self):
        """Declares the message once for each connection; False while no robot runs."""
        give_up = time.monotonic() + PATIENCE_S
        while not self._declared:
            call = {"call": "declare", "sensor": self._name, "message": self._message.__name__}
            answer = self._call(call, self._definition.encode())
            if answer["reply"] == "done":
                self._declared = True
            elif answer.get("reason") == NO_ROBOT:
                # Stored by the gateway; the channel is opened with the first sample of the next robot.
                self._declared = True
                return False
            elif answer.get("reason") in (TAKEN, TAKEN_TOO_OFTEN) and time.monotonic() < give_up:
                time.sleep(0.2)  # its predecessor is just ending
            else:
                raise SensorError(_sentence(answer))
        return True

    def _lost(self, why):
        self.close()
        self._tell(f"the gateway is out of reach ({why}); samples are lost until it is back")
        return False

    def _tell(self, sentence):
        """Prints a sentence, once until samples are taken again."""
        if sentence not in self._told:
            self._told.add(sentence)
            print(f"{self._name}: {sentence}", file=sys.stderr, flush=True)

    def _call(self, call, body):
        if self._link is None:
            self._link = socket.socket(socket.AF_UNIX)
            self._link.settimeout(10)
            self._link.connect(self._socket())
            answer = self._exchange({"call": "hello", "version": 1, "origin": "python"}, b"")
            if answer["reply"] != "welcome":
                self.close()
                raise SensorError(_sentence(answer))
        self._number += 1
        return self._exchange({**call, "id": self._number}, body)

    def _exchange(self, call, body):
        header = json.dumps(call).encode()
        self._link.sendall(struct.pack("<II", len(header), len(body)) + header + body)
        header, body = struct.unpack("<II", self._exactly(8))
        answer = json.loads(self._exactly(header))
        self._exactly(body)
        return answer

    def _exactly(self, count):
        data = bytearray()
        while len(data) < count:
            piece = self._link.recv(count - len(data))
            if not piece:
                raise ConnectionError("it has closed the connection")
            data += piece
        return bytes(data)

    def close(self):
        if self._link is not None:
            self._link.close()
        self._link, self._declared = None, False


def _sentence(answer):
    return answer.get("sentence", str(answer))


class _SharedMemory:
    """The way through shared memory, as one of the robot's own processes."""

    _GROUP, _PUBLISHERS = "sensor", PUBLISHERS

    def _size(self):
        """Bytes of the largest sample."""
        return ctypes.sizeof(self._message)

    def _quality(self, size, rate_hz):
        return _quality(size, rate_hz)

    def _typed(self, builder):
        """The builder of the channel with the types of its samples."""
        return builder.publish_subscribe(self._message)

    def _made(self, builder):
        """The builder of the publisher with what it needs in addition."""
        return builder

    def _more(self):
        """Attributes of the channel in addition to the definition."""
        return []

    def __init__(self, name, message, domain, rate_hz):
        global iceoryx2
        _need_version()
        import iceoryx2

        self.channel = f"{self._GROUP}/{name}"
        self._message, self._seq = message, 0
        size = self._size()
        self._buffer, self._history, self._subscribers = self._quality(size, rate_hz)
        self._bytes = (self._subscribers * (self._buffer + BORROWS) + self._history + 1) * size
        _need_room(self.channel, self._bytes)
        root = self.root = _root(domain)
        self._processes = _processes(root)
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
            self._publisher = _patiently(lambda: self._made(service.publisher_builder().max_loaned_samples(1)).create())
            self._reserve()
            self._notifier = self._event(self.channel)
            self._reserve()
        except SensorError:
            raise
        except Exception as error:
            if "IncompatibleTypes" in str(error):
                raise SensorError(
                    f"`{self.channel}` has other fields than `{message.type_name()}`: a changed type needs a new name, because the old channel"
                    f" is still open, e.g. in the recorder: use e.g. `{name}-2`"
                ) from None
            raise SensorError(f"`{self.channel}` cannot be published: {error}; other sensors of this name may run") from None
        # Wakes the processes that look for new channels, above all the recorder. They also look without it.
        try:
            self._event("system/channels").notify()
        except (iceoryx2.EventOpenError, iceoryx2.EventCreateError, iceoryx2.NotifierCreateError) as error:
            if FULL not in str(error) and "ExceedsMaxSupportedNotifiers" not in str(error):
                raise SensorError(f"`{self.channel}` cannot be announced: {error}") from None
            print(f"{name}: {self._full()}; until then `{self.channel}` is found up to a second later", file=sys.stderr, flush=True)

    def _full(self):
        return (
            f"the robot already has its {self._processes} processes: end one of them and start this one again, or raise `processes` of [bus]"
            " in the system file and start the robot again"
        )

    def _builder(self):
        return (
            self._typed(self._node.service_builder(iceoryx2.ServiceName.new(self.channel)))
            .enable_safe_overflow(True)
            .subscriber_max_borrowed_samples(BORROWS)
            .max_publishers(self._PUBLISHERS)
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
        attributes = _attributes(text[:first], [("schema.hash", f"{_hash(text):08x}"), *self._more()])
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
        places = self._processes if channel == "system/channels" else EVENT_PORTS
        service = self._event_with(channel, places, EVENT_PORTS, places, lambda sized: sized.create())
        return service.notifier_builder().create()

    def _sheet(self, name, text):
        """A continuation of the definition, held open while the sensor runs."""
        try:
            return self._event_with(name, 1, 1, self._processes, lambda sized: sized.create_with_attributes(_attributes(text)))
        except iceoryx2.EventOpenError as error:
            if FULL not in str(error):
                raise
            raise SensorError(f"`{self.channel}` cannot be published: {self._full()}") from None

    def _event_with(self, name, notifiers, listeners, nodes, create):
        """Opens an event with as many places as it has, or creates it with these."""
        builder = lambda: self._node.service_builder(iceoryx2.ServiceName.new(name)).event()
        sized = lambda: builder().max_notifiers(notifiers).max_listeners(listeners).max_nodes(nodes)
        last = None
        for _ in range(200):
            for attempt in (lambda: builder().open(), lambda: create(sized())):
                try:
                    return attempt()
                except iceoryx2.EventOpenError as error:
                    last = error
                    if FULL in str(error):
                        raise
                except iceoryx2.EventCreateError as error:
                    if "AlreadyExists" not in str(error):
                        last = error
            time.sleep(0.01)
        raise last

    def look(self):
        """Connects to new subscribers."""
        self._publisher.update_connections()
        if time.monotonic() > self._reserve_at:
            self._reserve_at = time.monotonic() + 1.0
            self._reserve()

    def publish(self, sample, stamp_ns):
        self._seq += 1
        header = sample.header
        header.seq, header.stamp_ns, header.oldest_input_ns, header.published_ns = self._seq, stamp_ns, stamp_ns, now_ns()
        self._publisher.loan_uninit().write_payload(sample).send()
        self._notifier.notify()
        return True

    def close(self):
        del self._publisher, self._notifier, self._sheets, self._node


def _processes(root):
    """The number of processes for which the robot has places, as its supervisor states it."""
    try:
        return int(Path(root, "processes.txt").read_text())
    except (OSError, ValueError):
        return PROCESSES


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


def _whole(value, kind, name):
    """An integer that its type holds."""
    whole, (low, high) = operator.index(value), LIMITS[kind]
    if not low <= whole <= high:
        raise SensorError(f"the field `{name}` holds {low} to {high}, but {whole} was given: use a wider type")
    return whole


def _fill(array, values, name):
    """Copies values into an array of a sample: at once for bytes and arrays of the same type (numpy, array, ctypes)."""
    kind = array._type_
    if getattr(values, "ndim", 1) > 1 and hasattr(values, "ravel"):
        values = values.ravel()  # a part of an array, a transposed one or one of another byte order has no plain memory
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
        # Of several dimensions, the numbers in their order.
        numbers = view.cast("B").cast(view.format) if plain and view.ndim > 1 else values
        array[:given] = [_whole(number, kind, name) if kind in LIMITS else number for number in numbers]


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
    from importlib.metadata import PackageNotFoundError, version

    try:
        found = version("iceoryx2")
    except PackageNotFoundError:
        raise SensorError(
            f"shared memory needs the package iceoryx2: pip install iceoryx2=={ICEORYX2}, or leave --shared-memory out and publish through the gateway"
        ) from None
    if found != ICEORYX2:
        raise SensorError(f"the package iceoryx2 is {found}, but the robot's programs need {ICEORYX2}: pip install iceoryx2=={ICEORYX2}")


def _argument(option):
    """The value of an option of the command line."""
    return sys.argv[sys.argv.index(option) + 1] if option in sys.argv[1:-1] else None


def _gateway_of(domain):
    """The socket of the gateway of a robot on this machine."""
    start = "start one with `nims plug gateway -- gateway`, or name its socket with --gateway PATH"
    try:
        known = Path(_root(domain), "gateway.txt").read_text().strip()
        if os.path.exists(known):
            return known
    except (SensorError, OSError):
        pass  # the robot of another user
    found = [str(path) for path in Path(GATEWAYS).glob("*.sock")] if os.path.isdir(GATEWAYS) else []
    if len(found) != 1:
        raise NoGateway(f"several gateways run ({', '.join(found)}): choose one with --gateway PATH" if found else f"no gateway runs here: {start}")
    return found[0]


def _root(domain):
    domain = domain or _argument("--domain") or os.environ.get("NIMS_DOMAIN")
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
