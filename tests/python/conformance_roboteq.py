"""A Python client that others wrote for Roboteq controllers, against the virtual motor box.

usage: conformance_roboteq.py PORT CYCLES

Talks to one controller through the package `roboteq`, as installed, and exits 0 if everything it was told agrees with
everything else. The client sends lines and returns bytes; what they mean is read here. Prints one line of JSON with what
was seen.
"""

import json
import re
import sys
import time

import roboteq
from roboteq.roboteq_constants import _G as GO

# Longer than a virtual machine stands still.
PATIENCE_S = 5.0
WATCHDOG_MS = 500


def check(condition, what, *seen):
    if not condition:
        raise SystemExit(f"{what}: {seen}")


def received(device):
    """The client returns the representation of each byte."""
    bytes_seen = re.findall(r"b'((?:\\.|[^'])*)'", device.getdata())
    return "".join(bytes_seen).encode().decode("unicode_escape")


def lines(device, count):
    """So many lines that arrive."""
    text, begin = "", time.monotonic()
    while text.count("\r") < count:
        check(time.monotonic() - begin < PATIENCE_S, "no answer", count, text)
        text += received(device)
        time.sleep(0.0005)
    check(text.endswith("\r") and text.count("\r") == count, "lines", count, text)
    return text.split("\r")[:-1]


def ask(device, line):
    device.send_command(line)
    return lines(device, 1)[0]


def numbers(device, line):
    name, values = ask(device, line).split("=")
    check(
        name == line[1:].split(" ")[0],
        "an answer has the name of its question",
        line,
        name,
    )
    return [int(value) for value in values.split(":")]


def command(device, motor, thousandths):
    device.command_motor(GO, motor, thousandths)
    check(lines(device, 1) == ["+"], "a command is acknowledged", motor, thousandths)


def identify(device):
    # What is received is sent back until that is switched off.
    device.send_command("?TRN")
    echo, answer = lines(device, 2)
    check(echo == "?TRN" and answer.startswith("TRN="), "echo and answer", echo, answer)
    device.set_config("^ECHOF", 1, "")
    check(lines(device, 2)[1] == "+", "echo is switched off")
    check(ask(device, "?FID").startswith("FID=Roboteq "), "firmware")
    check(
        numbers(device, "?FF") == [0] and numbers(device, "?FM") == [0, 0], "no faults"
    )
    check(100 < numbers(device, "?V")[1] < 300, "supply, V times ten")
    check(ask(device, "?NONE") == "-", "an unknown question is refused")
    check(numbers(device, "~MMOD") == [1, 1], "closed-loop speed")
    device.set_config("^MMOD", 1, 1)
    check(lines(device, 1) == ["+"], "the mode is set")
    return numbers(device, "~MXRPM")[0], numbers(device, "~EPPR")[0]


def motion(device, max_rpm, pulses):
    moved = []
    for thousandths in (300, -300):
        before = numbers(device, "?C 1")[0]
        command(device, 1, thousandths)
        check(numbers(device, "?CIS") == [thousandths, 0], "the command is read back")
        readings, begin = [], time.monotonic()
        while time.monotonic() - begin < 1.5:
            readings.append((time.monotonic(), numbers(device, "?C")[0]))
            command(device, 1, thousandths)
        late = [row for row in readings if row[0] - readings[0][0] > 0.5]
        rate = (late[-1][1] - late[0][1]) / (late[-1][0] - late[0][0])
        wanted = thousandths / 1000 * max_rpm / 60 * pulses * 4
        check(
            abs(rate - wanted) < 0.35 * abs(wanted), "rate of the counter", wanted, rate
        )
        rpm = numbers(device, "?S")[0]
        check(0.2 < rpm / (thousandths / 1000 * max_rpm) < 1.8, "speed", rpm)
        moved.append(numbers(device, "?C 1")[0] - before)
        command(device, 1, 0)
        time.sleep(0.5)
        check(abs(numbers(device, "?S")[0]) < 0.05 * max_rpm, "rest")
    check(moved[0] > 0 > moved[1], "there and back", moved)
    return moved


def watchdog(device, max_rpm):
    """The motors stop when no command arrives, and the next one resumes the speeds of before."""
    device.set_config("^RWD", WATCHDOG_MS, "")
    check(
        lines(device, 1) == ["+"] and numbers(device, "~RWD") == [WATCHDOG_MS],
        "watchdog read back",
    )
    command(device, 1, 300)
    time.sleep(3 * WATCHDOG_MS / 1000)
    check(abs(numbers(device, "?S")[0]) < 0.05 * max_rpm, "stopped by the watchdog")
    begin = time.monotonic()
    while time.monotonic() - begin < 0.5:
        command(device, 2, 0)
    check(
        numbers(device, "?S")[0] > 0.05 * max_rpm, "another command resumes the speed"
    )
    command(device, 1, 0)


def talk(device, cycles):
    """Control cycles as fast as the wire goes."""
    begin = time.monotonic()
    for cycle in range(cycles):
        thousandths = 50 if cycle // 100 % 2 == 0 else -50
        command(device, 1, thousandths)
        check(
            numbers(device, "?CIS") == [thousandths, 0], "the command of cycle", cycle
        )
    elapsed = time.monotonic() - begin
    command(device, 1, 0)
    return {"cycles": cycles, "cycle_ms": round(elapsed / cycles * 1e3, 3)}


def main():
    port, cycles = sys.argv[1], int(sys.argv[2])
    device = roboteq.RoboteqDevice()
    check(device.connect(port), "the port opens", port)
    max_rpm, pulses = identify(device)
    seen = {"moved": motion(device, max_rpm, pulses)}
    watchdog(device, max_rpm)
    seen |= talk(device, cycles)
    print(json.dumps(seen))


main()
