"""A running robot, through its gateway: its channels, and requests.

    import nims

    with nims.Robot() as robot:
        robot.arm()
        robot.goto([4.0, 3.0, 1.2], speed_m_s=0.2)
        for state in robot.subscribe("motor/state", rate_hz=10):
            print(state["header"]["cycle"], state["length_m"][:3])

The gateway checks who may do what, and refuses as the command `nims` does: `Refused` has the number of the reason and
its parameters. Its socket is found as by sensors (`nims_sensor`): the argument, NIMS_GATEWAY, the only one that runs.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import struct
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

VERSION = 1
LONGEST_S = 60.0

Vector = Sequence[float] | NDArray[Any]


class RobotError(Exception):
    """One sentence: what is wrong, and what to do."""


class Refused(RobotError):
    """A request that was refused: the robot's sentence, its number, and its parameters."""

    def __init__(self, answer: Mapping[str, Any]) -> None:
        super().__init__(answer.get("sentence", str(answer)))
        self.reason: int = answer.get("reason", 0)
        self.is_bad_input: bool = answer.get("accepted") == "bad-input"
        """It makes no sense, whenever it is requested; otherwise it cannot be done now."""
        self.numbers: list[int] = answer.get("numbers", [])
        self.values: list[float | None] = answer.get("values", [])
        self.detail: str = answer.get("detail", "")


class Link:
    """One connection to a gateway."""

    def __init__(self, path: str, token: str | None, timeout_s: float | None) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(timeout_s)
        self._read = bytearray()
        """What has been read of the next frames: a timeout within a frame loses nothing."""
        self._number = 0
        try:
            self.socket.connect(path)
            self.send({"call": "hello", "version": VERSION, "origin": "python"} | ({"token": token} if token else {}))
            self.welcome, _ = self.receive()
            if self.welcome.get("reply") != "welcome":
                raise Refused(self.welcome)
        except OSError as error:
            self.socket.close()
            raise RobotError(f"the gateway {path} is out of reach ({error.strerror or error}): is the robot running?") from None
        except BaseException:
            self.socket.close()
            raise

    def send(self, call: Mapping[str, Any], body: bytes = b"") -> None:
        try:
            header = json.dumps(call, default=_plain, allow_nan=False).encode()
        except ValueError:
            raise RobotError(f"{call} has a number that is not finite; accepted: finite numbers") from None
        self.socket.sendall(struct.pack("<II", len(header), len(body)) + header + body)

    def call(self, call: Mapping[str, Any], body: bytes = b"") -> dict[str, Any]:
        """Sends a call and returns its reply; raises what was refused."""
        self._number += 1
        self.send({**call, "id": self._number}, body)
        while True:
            reply, _ = self.receive()
            if reply.get("id") == self._number:
                break
        if reply["reply"] == "answer" and reply["accepted"] != "accepted":
            raise Refused(reply)
        return reply

    def receive(self) -> tuple[dict[str, Any], bytes]:
        self._read_up_to(8)
        header, body = struct.unpack_from("<II", self._read)
        self._read_up_to(8 + header + body)
        reply, data = bytes(self._read[8 : 8 + header]), bytes(self._read[8 + header : 8 + header + body])
        del self._read[: 8 + header + body]
        return json.loads(reply), data

    def _read_up_to(self, count: int) -> None:
        while len(self._read) < count:
            piece = self.socket.recv(max(count - len(self._read), 65536))
            if not piece:
                raise RobotError("the gateway has closed the connection")
            self._read += piece

    def close(self) -> None:
        self.socket.close()


class Subscription:
    """Samples of one channel, each a structured NumPy value of the channel's own definition.

    If the definition has texts or lists (pictures, scans, frames), each sample is its `bytes`, as `schema` defines them.
    It waits for a channel that does not exist yet, and goes on with the next robot.
    """

    def __init__(self, link: Link, channel: str, rate_hz: float | None) -> None:
        self.channel = channel
        self.dropped = 0
        """Samples left out so far: by the rate, or because this program reads too slowly."""
        self.missed = 0
        """Samples that the gateway itself has missed."""
        self.definition: Any = None
        """The definition of the samples (`nims_run.Definition`), once a sample has come; None if it has texts or lists."""
        self.schema = ""
        """The ROS 2 definition as text, once a sample has come."""
        self._link = link
        link.call({"call": "subscribe", "channel": channel} | ({"rate_hz": rate_hz} if rate_hz else {}))

    def __iter__(self) -> Iterator[Any]:
        return self

    def __next__(self) -> Any:
        return self.receive()

    def receive(self, timeout_s: float | None = None) -> Any:
        """The next sample; raises `TimeoutError` if none comes in time."""
        until_s = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            # What has come is read also after the time; 0 would mean not to wait at all.
            self._link.socket.settimeout(None if until_s is None else max(until_s - time.monotonic(), 0.001))
            reply, body = self._link.receive()
            if reply["reply"] == "definition":
                self.definition, self.schema = _definition(reply, self.channel), reply["schema"]
            elif reply["reply"] == "sample" and self.schema:
                self.dropped, self.missed = reply["dropped"], reply["missed"]
                return body if self.definition is None else np.frombuffer(body, self.definition.dtype)[0]
            elif reply["reply"] == "answer":
                raise Refused(reply)

    def names(self, field: str) -> dict[int, str]:
        """The names of a field's values, once a sample has come."""
        return dict(self.definition.constants.get(field, {})) if self.definition else {}

    def close(self) -> None:
        self._link.close()

    def __enter__(self) -> Subscription:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class Robot:
    """A robot that runs on this machine."""

    def __init__(self, gateway: str | os.PathLike[str] | None = None, *, domain: str | None = None, token: str | None = None) -> None:
        """`gateway` is the path of its socket, `token` the secret of a person (`nims token add`)."""
        self._path = os.fspath(gateway) if gateway else _found(domain)
        self._token = token or os.environ.get("NIMS_TOKEN")
        self._link = Link(self._path, self._token, LONGEST_S)
        self.name: str = self._link.welcome["robot"]
        self.role: str = self._link.welcome["role"]
        """What this user may do: look, stop, fly or owner."""

    def channels(self) -> list[str]:
        """Names of the channels."""
        return [row["name"] for row in self._link.call({"call": "channels"})["channels"]]

    def subscribe(self, channel: str, rate_hz: float | None = None) -> Subscription:
        """Subscribes to a channel by name; with a rate, the newest sample so often."""
        link = Link(self._path, self._token, LONGEST_S)
        try:
            return Subscription(link, channel, rate_hz)
        except BaseException:
            link.close()
            raise

    def ask(self, verb: str, body: bytes = b"", **parameters: Any) -> str:
        """Sends a request (docs/gateway.md has the verbs); returns the robot's answer, or raises `Refused`."""
        sentence: str = self._link.call({"call": "ask", "request": {"verb": verb, **parameters}}, body)["sentence"]
        return sentence

    def arm(self) -> str:
        """Powers the motors and holds the node."""
        return self.ask("arm")

    def disarm(self) -> str:
        """Releases the motors."""
        return self.ask("disarm")

    def hold(self) -> str:
        """Comes to rest on the path and holds."""
        return self.ask("hold")

    def stop(self) -> str:
        """Comes to rest on the path and ends the mission."""
        return self.ask("stop")

    def mark(self, text: str) -> str:
        """Marks this instant in the run file, to find it again in the report."""
        return self.ask("mark", text=text)

    def estop(self) -> str:
        """Stops at once."""
        return self.ask("estop")

    def reset(self) -> str:
        """Leaves a fault or an emergency stop."""
        return self.ask("reset")

    def pause(self) -> str:
        """Pauses the mission."""
        return self.ask("pause")

    def resume(self) -> str:
        """Continues the mission."""
        return self.ask("resume")

    def confirm_position(self) -> str:
        """Confirms the stored position after a restart."""
        return self.ask("confirm-position")

    def zero_at(self, position_m: Vector) -> str:
        """States where the node is."""
        return self.ask("zero-at", position_m=position_m)

    def goto(self, to_m: Vector, *, path: Literal["line", "parabola", "lateral"] = "line", mu_per_m: float | None = None, speed_m_s: float | None = None) -> str:
        """Flies to a point."""
        shape = {"shape": path} | ({"mu_per_m": mu_per_m} if path == "parabola" else {})
        return self.ask("goto", to_m=to_m, path=shape, speed_m_s=speed_m_s)

    def run(self, mission: str | os.PathLike[str], *, continues: bool = False) -> str:
        """Flies the mission in this file; `continues`: the rest of one that was interrupted."""
        file = Path(mission)
        text = file.read_bytes()
        return self.ask("run", text, mission=file.stem, hash=hashlib.sha256(text).hexdigest(), continues=continues)

    def speed(self, rate: float) -> str:
        """Flies at this share of the planned speed, 0 to 1."""
        return self.ask("speed", rate=rate)

    def set(self, key: str, value: float | int | bool | str) -> str:
        """Sets a parameter of the running robot, such as `controller.length_gain_per_s`."""
        text = str(value).lower() if isinstance(value, bool) else json.dumps(value, default=_plain)
        return self.ask("set", key=key, value=text)

    def swap(self, role: Literal["controller", "estimator"], slot: Literal["a", "b"]) -> str:
        """Puts the controller or estimator of this slot in charge."""
        return self.ask("swap", role=role, slot=slot)

    def close(self) -> None:
        """Ends the connection; the robot goes on."""
        self._link.close()

    def __enter__(self) -> Robot:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays, also in lists, as JSON has them."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{value!r} is no value of JSON; accepted: texts, numbers, truth values, and lists and dictionaries of them")


def _definition(reply: Mapping[str, Any], channel: str) -> Any:
    from nims_run import Definition, RunError, has_texts_or_lists

    if not reply["schema"]:
        raise RobotError(f"the channel `{channel}` has no definition: its program is older than this one")
    if has_texts_or_lists(reply["schema"]):
        return None
    try:
        definition = Definition(reply["schema"])
    except RunError as error:
        raise RobotError(f"the channel `{channel}`: {error}") from None
    if definition.dtype.itemsize != reply["size_bytes"]:
        raise RobotError(f"samples of `{channel}` have {reply['size_bytes']} bytes, and its definition {definition.dtype.itemsize}")
    return definition


def _found(domain: str | None) -> str:
    from nims_sensor import SensorError, _gateway_of

    given = os.environ.get("NIMS_GATEWAY")
    try:
        return given or str(_gateway_of(domain))
    except SensorError as error:
        raise RobotError(str(error)) from None
