"""A sensor as a plug-in: publishes readings through the gateway of a robot, in Python without packages.

    import nims_gateway

    with nims_gateway.Sensor() as sensor:
        while True:
            sensor.send([read_the_probe()])
            time.sleep(0.5)

The system file declares it as a [[plugin]], with the names and units of its values. systemd starts it as another user
than the robot's, and sets NIMS_GATEWAY and NIMS_NAME.
"""

import json
import math
import os
import socket
import struct
import time


class Refused(Exception):
    """The gateway has refused a reading; `reason` is the number of its reason."""

    def __init__(self, answer):
        super().__init__(answer.get("sentence", str(answer)))
        self.reason = answer.get("reason")


NO_ROBOT = 452  # reason while no robot runs


class Sensor:
    """Connects to the gateway, and again when it was started again."""

    def __init__(self, name=None, gateway=None):
        self.name = name or os.environ["NIMS_NAME"]
        self.gateway = gateway or os.environ["NIMS_GATEWAY"]
        self.link = None
        self.number = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Ends the connection; the channel stays for the next one."""
        if self.link:
            self.link.close()
        self.link = None

    def send(self, values, quality="good", age_s=0.0):
        """Publishes one reading; returns False while no robot or no gateway runs.

        `values` has the declared number of values, None or NaN where the device reports none; `quality` is good, doubtful
        or invalid; `age_s` is the time since the measurement, s.
        """
        self.number += 1
        # JSON has no numbers that are not finite, and the gateway would end the connection.
        plain = [None if value is None or not math.isfinite(value) else float(value) for value in values]
        reading = {"sensor": self.name, "values": plain, "quality": quality, "age_s": float(age_s)}
        try:
            answer = self._call({"call": "publish", "id": self.number, "reading": reading})
        except OSError:
            self.close()
            time.sleep(0.5)
            return False
        if answer["reply"] == "done":
            return True
        if answer.get("reason") == NO_ROBOT:
            return False
        raise Refused(answer)

    def _call(self, call):
        if not self.link:
            self.link = socket.socket(socket.AF_UNIX)
            self.link.settimeout(10)
            self.link.connect(self.gateway)
            answer = self._exchange({"call": "hello", "version": 1, "origin": "python"})
            if answer["reply"] != "welcome":
                self.close()
                raise Refused(answer)
        return self._exchange(call)

    def _exchange(self, call):
        header = json.dumps(call).encode()
        self.link.sendall(struct.pack("<II", len(header), 0) + header)
        header, body = struct.unpack("<II", self._exactly(8))
        answer = json.loads(self._exactly(header))
        self._exactly(body)
        return answer

    def _exactly(self, count):
        data = b""
        while len(data) < count:
            piece = self.link.recv(count - len(data))
            if not piece:
                raise ConnectionError("the gateway has closed the connection")
            data += piece
        return data
