"""Subscriptions of the package `nims` at a gateway that sends slowly, and samples with texts and lists."""

import json
import socket
import struct
import tempfile
import threading
from pathlib import Path

import nims

FIXED = "uint64 cycle\nfloat64[2] length_m\n"
OPEN = "string frame\nuint8[] data\n"


def frame(reply, body=b""):
    header = json.dumps(reply).encode()
    return struct.pack("<II", len(header), len(body)) + header + body


def sample(body):
    return frame({"reply": "sample", "dropped": 0, "missed": 0}, body)


class Gateway:
    """Answers a welcome and a subscription; further bytes are those of the test."""

    def __init__(self, path):
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(str(path))
        self.listener.listen()
        self.thread = threading.Thread(target=self.accept)
        self.thread.start()

    def accept(self):
        self.link, _ = self.listener.accept()
        calls = self.link.makefile("rb")
        for reply in ({"reply": "welcome", "robot": "r", "role": "look"}, {"reply": "done", "id": 1}):
            header, body = struct.unpack("<II", calls.read(8))
            calls.read(header + body)
            self.link.sendall(frame(reply))


def subscribed(folder, name):
    gateway = Gateway(Path(folder, name))
    link = nims.robot.Link(str(Path(folder, name)), None, 60.0)
    subscription = nims.Subscription(link, "a/channel", None)
    gateway.thread.join()
    return gateway.link, subscription


def times_out(subscription):
    try:
        subscription.receive(0.02)
    except TimeoutError:
        return
    raise AssertionError("a whole sample")


with tempfile.TemporaryDirectory() as folder:
    link, subscription = subscribed(folder, "slow.sock")
    definition = frame({"reply": "definition", "schema": FIXED, "size_bytes": 24})
    bodies = [struct.pack("<Qdd", cycle, 1.5, 2.5) for cycle in (7, 8)]
    data = definition + sample(bodies[0])
    # A timeout after each part of a frame: within its lengths, its header and its body.
    for begin in range(0, len(data), 5):
        times_out(subscription)
        link.sendall(data[begin : begin + 5])
    link.sendall(sample(bodies[1]))
    for cycle in (7, 8):
        received = subscription.receive(60.0)
        assert received["cycle"] == cycle and received["length_m"].tolist() == [1.5, 2.5], received
    times_out(subscription)

    link, subscription = subscribed(folder, "open.sock")
    pictures = [b"\x02\x00\x00\x00a\x00" + bytes(many) for many in (3, 70000)]
    link.sendall(frame({"reply": "definition", "schema": OPEN, "size_bytes": 1}))
    threading.Thread(target=link.sendall, args=(b"".join(map(sample, pictures)),)).start()
    assert [subscription.receive(60.0) for _ in pictures] == pictures
    assert subscription.definition is None and subscription.schema == OPEN and subscription.names("data") == {}

    link, subscription = subscribed(folder, "wrong.sock")
    link.sendall(frame({"reply": "definition", "schema": FIXED, "size_bytes": 8}))
    try:
        subscription.receive(60.0)
        raise AssertionError("a definition of another size")
    except nims.RobotError as error:
        assert "24" in str(error), error
