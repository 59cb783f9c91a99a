"""The drive maker's own Python client against the virtual motor box.

usage: conformance_basicmicro.py PORT BAUD CYCLES

Talks to two units (0x80 with two cables, 0x81 with one) through `basicmicro`, as installed, and exits 0 if everything it
was told agrees with everything else. Prints one line of JSON with what was seen.
"""

import json
import sys
import time

from basicmicro import Basicmicro
from basicmicro.exceptions import PacketTimeoutError

FIRST, SECOND, NOBODY = 0x80, 0x81, 0x87


def signed(value):
    """The client returns 32-bit counts as unsigned numbers."""
    return value - (1 << 32) if value & 0x8000_0000 else value


def check(condition, what, *seen):
    if not condition:
        raise SystemExit(f"{what}: {seen}")


def encoders(drive, address):
    ok, first, second = drive.GetEncoders(address)
    check(ok, "GetEncoders failed", address)
    return signed(first), signed(second)


def keep_talking(drive, address, seconds):
    """Waits with the unit's watchdog kept quiet."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        encoders(drive, address)
        time.sleep(0.02)


def wait_for_rest(drive, address):
    """Returns the encoder counts once they have stopped changing."""
    last = encoders(drive, address)
    for _ in range(50):
        time.sleep(0.1)
        now = encoders(drive, address)
        if all(abs(a - b) <= 2 for a, b in zip(last, now, strict=True)):
            return now
        last = now
    raise SystemExit(f"unit {address:#x} does not come to rest: {last}")


def identify(drive):
    for address in (FIRST, SECOND):
        ok, version = drive.ReadVersion(address)
        check(ok and version.endswith("\n") and "oboclaw" in version.lower(), "version", version)
        ok, volts = drive.ReadMainBatteryVoltage(address)
        check(ok and 100 <= volts <= 300, "main battery in tenths of a volt", volts)
        ok, volts = drive.ReadLogicBatteryVoltage(address)
        check(ok and 40 <= volts <= 60, "logic battery in tenths of a volt", volts)
        ok, tenths = drive.ReadTemp(address)
        check(ok and 100 <= tenths <= 600, "temperature in tenths of a degree", tenths)
        ok, status = drive.ReadError(address)
        check(ok and status == 0, "status", hex(status))
    try:
        drive.ReadMainBatteryVoltage(NOBODY)
    except PacketTimeoutError:
        pass
    else:
        raise SystemExit("a unit that does not exist answered")


def settings(drive):
    check(drive.SetTimeout(FIRST, 0.5), "SetTimeout")
    check(drive.GetTimeout(FIRST) == (True, 0.5), "GetTimeout", drive.GetTimeout(FIRST))
    ok, p, i, d, qpps = drive.ReadM1VelocityPID(FIRST)
    check(ok and p > 0 and qpps > 0, "velocity PID as delivered", p, i, d, qpps)
    check(drive.SetM1VelocityPID(FIRST, 0.75, 0.125, 0.0625, qpps), "SetM1VelocityPID")
    check(drive.ReadM1VelocityPID(FIRST) == (True, 0.75, 0.125, 0.0625, qpps), "velocity PID read back")
    check(drive.SetM1VelocityPID(FIRST, p, i, d, qpps), "SetM1VelocityPID back")
    check(drive.SetM1MaxCurrent(FIRST, 1200, 0), "SetM1MaxCurrent")
    check(drive.ReadM1MaxCurrent(FIRST)[:2] == (True, 1200), "max current read back", drive.ReadM1MaxCurrent(FIRST))
    check(drive.SetM1MaxCurrent(FIRST, 1500, 0), "SetM1MaxCurrent back")
    check(drive.WriteNVM(FIRST), "WriteNVM")


def move(drive):
    """One cable out, the other in, and everything that can be read meanwhile."""
    check(drive.ResetEncoders(FIRST), "ResetEncoders")
    check(drive.SetEncM1(FIRST, 123456) and drive.SetEncM2(FIRST, -5 & 0xFFFF_FFFF), "SetEnc")
    at = encoders(drive, FIRST)
    check(abs(at[0] - 123456) <= 2 and abs(at[1] + 5) <= 2, "preset counts", at)
    speed = 400
    check(drive.SpeedM1M2(FIRST, speed, -speed), "SpeedM1M2")
    begin = time.monotonic()
    seen, currents = [], []
    while time.monotonic() - begin < 1.5:
        ok, first, second = drive.ReadCurrents(FIRST)
        check(ok, "ReadCurrents")
        currents.append((first, second))
        seen.append((time.monotonic(), *encoders(drive, FIRST)))
        time.sleep(0.01)
    ok, fast, direction = drive.ReadSpeedM1(FIRST)
    check(ok and direction == 0 and 300 < fast < 500, "speed of M1", fast, direction)
    ok, slow, direction = drive.ReadSpeedM2(FIRST)
    check(ok and direction == 1 and -500 < signed(slow) < -300, "speed of M2", signed(slow), direction)
    ok, raw, _ = drive.ReadISpeedM1(FIRST)
    check(ok and abs(signed(raw) - speed) <= 2 * 300, "raw speed of M1 in steps of 300", signed(raw))
    ok, first, second = drive.GetISpeeds(FIRST)
    check(ok and signed(first) > -300 and signed(second) < 300, "raw speeds", signed(first), signed(second))
    ok, first, second = drive.ReadPWMs(FIRST)
    check(ok and abs(first) < 10000 and -10000 < second < 0, "duty of 32767", first, second)
    check(drive.SpeedM1M2(FIRST, 0, 0), "stop")

    # The rate over the last second is the rate asked for, whatever the two clocks did before.
    late = [row for row in seen if row[0] - begin > 0.5]
    for column, sign in ((1, 1), (2, -1)):
        rate = (late[-1][column] - late[0][column]) / (late[-1][0] - late[0][0])
        check(abs(rate * sign - speed) < 0.35 * speed, "encoder rate", column, rate)
    check(any(abs(a) > 1 and abs(b) > 1 for a, b in currents), "some current flows in both motors", currents[-1])

    ok, count, status = drive.ReadEncM1(FIRST)
    check(ok and signed(count) > 123456 + speed and not status & 2, "ReadEncM1", signed(count), status)
    ok, count, status = drive.ReadEncM2(FIRST)
    check(ok and signed(count) < -5 - speed and status & 2, "ReadEncM2", signed(count), status)
    out = wait_for_rest(drive, FIRST)

    # And back, with a ramp, the other way round.
    check(drive.SpeedAccelM1M2(FIRST, 2000, -speed, speed), "SpeedAccelM1M2")
    keep_talking(drive, FIRST, 1.0)
    check(drive.SpeedAccelM1M2_2(FIRST, 2000, 0, 3000, 0), "SpeedAccelM1M2_2")
    back = wait_for_rest(drive, FIRST)
    check(back[0] < out[0] - speed / 2 and back[1] > out[1] + speed / 2, "back again", out, back)

    # The second unit moves by itself.
    before = encoders(drive, SECOND)
    check(drive.SpeedM1(SECOND, -speed), "SpeedM1")
    keep_talking(drive, SECOND, 0.5)
    check(drive.SpeedM1(SECOND, 0), "SpeedM1 0")
    after = wait_for_rest(drive, SECOND)
    check(after[0] < before[0] - 50, "second unit", before, after)
    return {"rate_samples": len(seen), "moved": [out[0] - 123456, out[1] + 5]}


def duty(drive):
    """Open loop winds in; nothing at all shorts the motors."""
    before = encoders(drive, FIRST)
    check(drive.DutyM1M2(FIRST, -6000, -6000), "DutyM1M2")
    time.sleep(0.2)
    ok, first, second = drive.ReadPWMs(FIRST)
    check(ok and abs(first + 6000) < 100 and abs(second + 6000) < 100, "duty of 32767", first, second)
    check(drive.DutyM1M2(FIRST, 0, 0), "release")
    after = wait_for_rest(drive, FIRST)
    check(after[0] < before[0] and after[1] < before[1], "duty moved the cables in", before, after)


def silence(drive):
    """The unit stops its motors when no command arrives; how long that took."""
    check(drive.SetTimeout(FIRST, 0.2), "SetTimeout")
    check(drive.SpeedM1M2(FIRST, 400, 400), "SpeedM1M2")
    time.sleep(1.5)
    stopped = encoders(drive, FIRST)
    time.sleep(0.1)
    later = encoders(drive, FIRST)
    check(all(abs(a - b) <= 2 for a, b in zip(stopped, later, strict=True)), "the watchdog did not stop the motors", stopped, later)
    check(drive.SetTimeout(FIRST, 0.0), "watchdog off")


def talk(drive, cycles):
    """Control cycles as fast as the wire goes."""
    begin = time.monotonic()
    for cycle in range(cycles):
        speed = 200 if cycle // 100 % 2 == 0 else -200
        check(drive.SpeedM1M2(FIRST, speed, -speed), "SpeedM1M2 in cycle", cycle)
        ok, _, _ = drive.GetEncoders(FIRST)
        check(ok, "GetEncoders in cycle", cycle)
    elapsed = time.monotonic() - begin
    check(drive.SpeedM1M2(FIRST, 0, 0), "stop")
    check(drive.DutyM1M2(FIRST, 0, 0), "release")
    return {"cycles": cycles, "cycle_ms": round(elapsed / cycles * 1e3, 3)}


class Joined:
    """A port on which a packet leaves at once when the client reads. The client writes its parts one by one, and a
    pause of 10 ms between two of them, in which a busy computer runs another program, ends the packet for a drive."""

    def __init__(self, port):
        self._port, self._parts = port, b""

    def write(self, data):
        self._parts += bytes(data)
        return len(data)

    def read(self, size=1):
        self.flush()
        return self._port.read(size)

    def flush(self):
        parts, self._parts = self._parts, b""
        if parts:
            self._port.write(parts)
        self._port.flush()

    def __getattr__(self, name):
        return getattr(self._port, name)


def main():
    port, baud, cycles = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    # Longer than a virtual machine stands still: an answer that is lost is still noticed.
    drive = Basicmicro(port, baud, timeout=1.0, retries=1)
    check(drive.Open(), "cannot open", port)
    drive._port = Joined(drive._port)
    try:
        identify(drive)
        settings(drive)
        seen = move(drive)
        duty(drive)
        silence(drive)
        seen |= talk(drive, cycles)
    finally:
        drive.close()
    print(json.dumps(seen))


if __name__ == "__main__":
    main()
