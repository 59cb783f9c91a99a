"""The drive maker's own Python client against the virtual motor box.

usage: conformance_moteus.py PORT ADDRESS CYCLES

Talks to one unit on a UART through `moteus`, as installed, and exits 0 if everything it was told agrees with everything
else. Prints one line of JSON with what was seen.
"""

import asyncio
import json
import math
import sys
import time

import moteus

WATCHDOG_S = 0.5
RESOLUTION = moteus.QueryResolution()
RESOLUTION.mode = moteus.INT8
RESOLUTION.position = moteus.F32
RESOLUTION.velocity = moteus.F32
RESOLUTION.q_current = moteus.F32
RESOLUTION.voltage = moteus.F32
RESOLUTION.temperature = moteus.F32
RESOLUTION.fault = moteus.INT8
RESOLUTION.aux2_gpio = moteus.INT8

R = moteus.Register


def check(condition, what, *seen):
    if not condition:
        raise SystemExit(f"{what}: {seen}")


async def query(unit):
    reply = await unit.query()
    check(reply is not None, "no answer to a query")
    return reply.values


async def move(unit, turns_s, timeout_s=WATCHDOG_S):
    """A velocity from where the motor is."""
    reply = await unit.set_position(
        position=math.nan, velocity=turns_s, watchdog_timeout=timeout_s, query=True
    )
    check(reply is not None, "no answer to a command")
    return reply.values


async def wait(unit, turns_s, seconds):
    """Commands a velocity for a while; returns pairs of time and position."""
    begin, seen = time.monotonic(), []
    while time.monotonic() - begin < seconds:
        values = await move(unit, turns_s)
        seen.append((time.monotonic(), values[R.POSITION]))
        await asyncio.sleep(0.01)
    return seen


async def identify(unit):
    reply = await unit.custom_query({0x101: moteus.INT32, 0x102: moteus.INT32})
    firmware, layout = reply.values[R.FIRMWARE_VERSION], reply.values[R.REGISTER_MAP_VERSION]
    check(firmware >= 0x10000 and layout == 5, "firmware and layout of the registers", hex(firmware), layout)
    await unit.set_stop(query=True)
    values = await query(unit)
    check(values[R.MODE] == moteus.Mode.STOPPED and values[R.FAULT] == 0, "stopped", values)
    check(10 < values[R.VOLTAGE] < 30 and 10 < values[R.TEMPERATURE] < 60, "supply and board", values)
    check(values[R.AUX2_GPIO_STATUS] == 0, "the stop button is not pressed", values)


async def clock(unit):
    """The millisecond counter follows this computer's clock, less what the box left out."""
    readings = []
    for _ in range(5):
        reply = await unit.custom_query({0x70: moteus.INT32})
        readings.append((time.monotonic(), reply.values[R.MILLISECOND_COUNTER]))
        await asyncio.sleep(0.05)
    check(all(b[1] > a[1] for a, b in zip(readings, readings[1:], strict=False)), "the counter advances", readings)
    passed_ms = readings[-1][1] - readings[0][1]
    check(passed_ms <= (readings[-1][0] - readings[0][0]) * 1e3 + 20, "the counter is not fast", readings)


async def motion(unit):
    moved = []
    for turns_s in (0.5, -0.5):
        before = (await query(unit))[R.POSITION]
        seen = await wait(unit, turns_s, 1.5)
        values = await query(unit)
        check(values[R.MODE] == moteus.Mode.POSITION, "position mode", values)
        check(0.2 < values[R.VELOCITY] / turns_s < 1.8, "velocity", turns_s, values)
        late = [row for row in seen if row[0] - seen[0][0] > 0.5]
        rate = (late[-1][1] - late[0][1]) / (late[-1][0] - late[0][0])
        check(abs(rate - turns_s) < 0.35 * abs(turns_s), "rate of the position", turns_s, rate)
        moved.append(round(values[R.POSITION] - before, 4))
        await wait(unit, 0.0, 0.5)
        rest = await query(unit)
        check(abs(rest[R.VELOCITY]) < 0.05, "rest", rest)
    check(moved[0] > 0.3 and moved[1] < -0.3, "there and back", moved)
    commanded = await unit.custom_query({0x20: moteus.F32, 0x21: moteus.F32, 0x27: moteus.F32})
    check(math.isnan(commanded.values[R.COMMAND_POSITION]), "no position was commanded", commanded)
    check(abs(commanded.values[R.COMMAND_TIMEOUT] - WATCHDOG_S) < 1e-6, "time limit read back", commanded)
    return moved


async def watchdog(unit):
    """The motor brakes when no command arrives, and moves again only after a stop."""
    for _ in range(20):
        await move(unit, 0.5, 0.2)
        await asyncio.sleep(0.01)
    await asyncio.sleep(1.0)
    values = await query(unit)
    check(values[R.MODE] == moteus.Mode.TIMEOUT and abs(values[R.VELOCITY]) < 0.05, "timeout", values)
    await move(unit, 0.5)
    values = await query(unit)
    check(values[R.MODE] == moteus.Mode.TIMEOUT, "a command does not end the timeout", values)
    await unit.set_stop(query=True)
    await move(unit, 0.0)
    values = await query(unit)
    check(values[R.MODE] == moteus.Mode.POSITION, "after a stop", values)


async def talk(unit, cycles):
    """Control cycles as fast as the wire goes."""
    begin = time.monotonic()
    for cycle in range(cycles):
        values = await move(unit, 0.1 if cycle // 100 % 2 == 0 else -0.1)
        check(values[R.FAULT] == 0, "fault in cycle", cycle, values)
    elapsed = time.monotonic() - begin
    await unit.set_stop(query=True)
    return {"cycles": cycles, "cycle_ms": round(elapsed / cycles * 1e3, 3)}


async def main():
    port, address, cycles = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    # A pseudo-terminal counts as a UART: the client sends checksums and requires them. The time limits are longer than
    # a virtual machine stands still.
    transport = moteus.Fdcanusb(port, command_timeout=2.0, response_timeout=2.0)
    unit = moteus.Controller(id=address, transport=transport, query_resolution=RESOLUTION)
    await identify(unit)
    await clock(unit)
    moved = await motion(unit)
    await watchdog(unit)
    print(json.dumps({"moved_turns": moved} | await talk(unit, cycles)))


asyncio.run(main())
