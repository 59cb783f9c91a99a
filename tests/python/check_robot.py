"""The package `nims` at a running robot: check_robot.py SOCKET X,Y,Z. Requests, their refusals, and subscriptions."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import nims

SOCKET, GOAL = sys.argv[1], [float(word) for word in sys.argv[2].split(",")]
LONGEST_S = 60.0


def refused(call):
    try:
        call()
    except nims.Refused as refusal:
        assert refusal.reason and "\n" not in str(refusal), refusal
        return refusal
    raise AssertionError("not refused")


def until(subscription, holds):
    """The first sample for which this is true."""
    while True:
        sample = subscription.receive(LONGEST_S)
        if holds(sample):
            return sample


with nims.Robot(SOCKET) as robot:
    assert robot.role == "owner" and {"motor/state", "motor/authority"} <= set(robot.channels())
    with robot.subscribe("motor/authority") as authority:
        first, second = authority.receive(LONGEST_S), authority.receive(LONGEST_S)
        assert first["header"]["cycle"] < second["header"]["cycle"]
        modes = {name: value for value, name in authority.names("mode").items()}
        robot.disarm()
        until(authority, lambda sample: sample["mode"] == modes["MODE_DISARMED"])
        assert not refused(lambda: robot.goto(GOAL)).is_bad_input
        robot.arm()
        until(authority, lambda sample: sample["mode"] == modes["MODE_HOLDING"])
        refused(lambda: robot.goto(GOAL, speed_m_s=50.0))
        robot.goto(np.array(GOAL), speed_m_s=0.3)
        until(authority, lambda sample: sample["mode"] == modes["MODE_FOLLOWING"])
        robot.set("controller.horizon_cycles", 25)
        refused(lambda: robot.set("controller.no_such_key", 1))
        until(authority, lambda sample: sample["mode"] == modes["MODE_HOLDING"])
    with robot.subscribe("node/estimate/a", rate_hz=20) as estimates:
        estimate = estimates.receive(LONGEST_S)
        assert np.linalg.norm(estimate["position_m"] - GOAL) < 0.05, estimate["position_m"]
    with robot.subscribe("no/such/channel") as nothing:
        try:
            nothing.receive(0.5)
            raise AssertionError("a sample of a channel that does not exist")
        except TimeoutError:
            pass
    with tempfile.TemporaryDirectory() as folder:
        mission = Path(folder, "wrong.toml")
        mission.write_text("not a mission")
        assert refused(lambda: robot.run(mission)).is_bad_input
    robot.hold()
try:
    nims.Robot("/nowhere.sock")
    raise AssertionError("a gateway that does not exist")
except nims.RobotError as error:
    assert "/nowhere.sock" in str(error)
