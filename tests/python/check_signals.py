"""Publishers of one program end together. Usage: check_signals.py PYTHON_FOLDER FOLDER SIGNAL"""

import os
import signal
import sys
import threading
from ctypes import c_double

sys.path.insert(0, sys.argv[1])
from nims import blob
from nims_sensor import Sample, Sensor


class Soil(Sample):
    """A probe."""

    _fields_ = [("moisture_percent", c_double, "Water by volume, %.")]


class Memory:
    """In place of the channel in shared memory."""

    def __init__(self, *_):
        pass

    def look(self):
        pass


blob._Memory = Memory
socket, made = sys.argv[2] + "/socket", []


def make():
    made.append(Sensor("soil", Soil, gateway=socket))
    made.append(blob.Pictures("camera", most_bytes=100, rate_hz=1.0))


thread = threading.Thread(target=make)
thread.start()
thread.join()
assert len(made) == 2, "a publisher cannot be made in another thread"
assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
make()
make()
assert len(made) == 6 and all(one.running() for one in made)
os.kill(os.getpid(), getattr(signal, sys.argv[3]))
assert not any(one.running() for one in made), [one.running() for one in made]
print("ok")
