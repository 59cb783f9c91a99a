"""Looks at a robot over Foxglove's WebSocket protocol, with nothing but the standard library.

look.py ADDRESS PORT SAMPLES [CONNECTIONS [VERSIONS [REQUESTS REPLIES]]]

Connects, subscribes to every channel and ends after so many samples, or when the server ends the connection; the result
is one object of JSON. It also sends the requests, an array of JSON, and waits for so many replies. With several connections, all are open before the first one is read.
"""

import base64
import json
import os
import socket
import struct
import sys

address, port, wanted = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
count = int(sys.argv[4]) if len(sys.argv) > 4 else 1
versions = sys.argv[5] if len(sys.argv) > 5 else "foxglove.sdk.v1"
requests = json.loads(sys.argv[6]) if len(sys.argv) > 6 else []
replies = int(sys.argv[7]) if len(sys.argv) > 7 else 0
REQUEST = (
    f"GET / HTTP/1.1\r\nHost: {address}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}\r\nSec-WebSocket-Version: 13\r\n"
    f"Sec-WebSocket-Protocol: {versions}\r\n\r\n"
).encode()


def connect():
    """A connection on which the request is sent, if the server has not ended it before."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    connection = socket.socket(family, socket.SOCK_STREAM)
    connection.settimeout(60)
    connection.connect((address, port))
    try:
        connection.sendall(REQUEST)
    except OSError:
        pass
    return connection


class Ended(Exception):
    """The server has ended the connection."""


class Reader:
    """Reads exact numbers of bytes."""

    def __init__(self, connection):
        self.connection, self.buffer = connection, b""

    def more(self):
        try:
            data = self.connection.recv(65536)
        except (ConnectionError, BrokenPipeError):
            data = b""
        if not data:
            raise Ended
        self.buffer += data

    def take(self, length):
        while len(self.buffer) < length:
            self.more()
        taken, self.buffer = self.buffer[:length], self.buffer[length:]
        return taken

    def head(self):
        while b"\r\n\r\n" not in self.buffer:
            self.more()
        head, self.buffer = self.buffer.split(b"\r\n\r\n", 1)
        return head.decode("latin1")

    def frame(self):
        """The kind and the content of a frame; the server sends no fragments of what is small."""
        kind, length = self.take(2)
        if length == 126:
            length = struct.unpack(">H", self.take(2))[0]
        elif length == 127:
            length = struct.unpack(">Q", self.take(8))[0]
        return kind & 0x0F, self.take(length)


def send(connection, message):
    body, mask = json.dumps(message).encode(), os.urandom(4)
    size = struct.pack(">BB", 0x81, 0x80 | len(body)) if len(body) < 126 else struct.pack(">BBH", 0x81, 0xFE, len(body))
    connection.sendall(size + mask + bytes(byte ^ mask[at % 4] for at, byte in enumerate(body)))


connections = [connect() for _ in range(count)]
result = {"answer": "", "protocol": "", "messages": 0, "samples": 0, "topics": [], "info": None, "ended": 0, "replies": []}
for connection in connections:
    reader = Reader(connection)
    try:
        head = reader.head()
        for line in head.splitlines():
            if line.lower().startswith("sec-websocket-protocol:"):
                result["protocol"] = line.split(":", 1)[1].strip()
        if not head.startswith("HTTP/1.1 101"):
            while True:
                result["answer"] = head + reader.buffer.decode("latin1")
                reader.more()
        for request in requests:
            send(connection, request)
        while result["samples"] < wanted or len(result["replies"]) < replies:
            kind, content = reader.frame()
            result["messages"] += 1
            result["samples"] += kind == 2
            message = json.loads(content) if kind == 1 else {}
            if message.get("op") == "serverInfo":
                result["info"] = message
            if message.get("op") in ("parameterValues", "connectionGraphUpdate", "status"):
                result["replies"].append(message)
            if message.get("op") == "advertise":
                result["topics"] += [channel["topic"] for channel in message["channels"]]
                asked = [{"id": channel["id"] + 7, "channelId": channel["id"]} for channel in message["channels"]]
                send(connection, {"op": "subscribe", "subscriptions": asked})
    except Ended:
        result["ended"] += 1
        if reader.buffer and not result["answer"]:
            result["answer"] = reader.buffer.decode("latin1")
print(json.dumps(result))
