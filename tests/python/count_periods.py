"""Counts the periods of missions from motor/input and motor/authority of a run, by the rules of docs/counters.md.

Usage: count_periods.py RUN_FOLDER_OR_FILE

It judges every cycle by itself, without `period` and the counts of motor/authority, and then compares: each cycle with `period`, each sum
with the counts. Prints what it found as JSON; exit code 1 where something differs.
"""

import json
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

NO_MISSION, STEERED, PAUSED, COMPUTER, DRIVE, RESYNC, ANSWER = range(7)
NAMES = ["no_mission", "steered", "paused", "computer", "drive", "resync", "answer"]
MODE_FOLLOWING = 3
UNIT_ABSENT, UNIT_OK, UNIT_RESYNC, UNIT_LOST, UNIT_REBOOTED, UNIT_LATE, UNIT_SILENT = range(7)
FAULT_COMMAND_LOST, FAULT_ESTIMATE_LOST, FAULT_LONG_GAP, FAULT_SUPERVISOR_LOST = 512, 2048, 8192, 32768
FAULT_PLANNER_LOST, FAULT_COMMAND_REFUSED, FAULT_COMPUTER = 65536, 131072, 524288
BY_ABSENCE = FAULT_SUPERVISOR_LOST | FAULT_PLANNER_LOST
STOPS = FAULT_LONG_GAP | FAULT_COMPUTER | BY_ABSENCE | FAULT_COMMAND_LOST | FAULT_ESTIMATE_LOST | FAULT_COMMAND_REFUSED
LATE_SHARE, CHAIN_SHARE = 0.5, 0.3
EXCHANGE_SHARE = 1.0 - CHAIN_SHARE


def cycles_of(run):
    """Pairs of motor/input and motor/authority, in order; cycles of which one is missing are left out."""
    files = sorted(run.glob("run*.mcap")) if run.is_dir() else [run]
    found = {"/motor/input": {}, "/motor/authority": {}}
    for file in files:
        with open(file, "rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            for _, channel, _, message in reader.iter_decoded_messages(topics=list(found)):
                found[channel.topic][(message.header.life, message.header.cycle)] = message
    inputs, authorities = found.values()
    return [(inputs[at], authorities[at]) for at in sorted(inputs.keys() & authorities.keys())]


def skipped(now, before, period_s):
    """Periods between two ticks that never ran."""
    periods = max(now.tick_ns - before.tick_ns, 0) * 1e-9 / period_s
    return max(int(periods + 0.5) - 1, 0)


def overrun(now, before, period_s):
    """Of how many of them the tick fell into the exchange before."""
    periods = lambda until_ns: int(max(until_ns - before.tick_ns, 0) * 1e-9 / period_s)
    return min(max(periods(before.end_ns) - periods(before.begin_ns), 0), skipped(now, before, period_s))


def is_fresh(told, authority):
    """An answer to the cycle before is used; what motor-io says of it has to be in its input."""
    if authority.command_age_ns == 0:
        return False
    command = told.command[authority.active_controller]
    fits = command.header.life == told.header.life and command.based_on_cycle + 1 == told.header.cycle
    if not (fits and command.valid[authority.active_estimator] == 1):
        raise SystemExit(f"cycle {told.header.cycle} claims a fresh command, and its input has none")
    return True


class Life:
    """The rules for the cycles of one life of motor-io."""

    def __init__(self):
        self.told = self.authority = None
        self.period, self.cause, self.trouble = NO_MISSION, 0, None
        self.late_tick = False

    def judge(self, told, authority):
        """What the cycle is; and what the periods before it that never ran are, and how many."""
        before, period_s = self.told, authority.period_s
        grown = lambda now, then: (now - then) * 1e-9 > CHAIN_SHARE * period_s
        waited = lambda now, then: then != 0 and grown(now, then)
        under_way = self.authority is not None and self.authority.motion != 0
        fresh = is_fresh(told, authority)
        could_ns = max(told.tick_ns, before.end_ns if before is not None else 0)
        late_tick = (told.begin_ns - could_ns) * 1e-9 > LATE_SHARE * period_s
        kept = before is not None and (
            waited(told.run_delay_ns, before.run_delay_ns) or grown(told.box_left_out_ns, before.box_left_out_ns)
        )
        late = late_tick or ((kept or self.late_tick) and not grown(told.begin_ns, before.end_ns))
        held_up = late_tick or kept
        units = list(told.unit)[: told.unit_count]
        if any(unit in (UNIT_ABSENT, UNIT_LOST, UNIT_REBOOTED) for unit in units):
            trouble = DRIVE
        elif UNIT_SILENT in units:
            trouble = COMPUTER if held_up else DRIVE
        elif UNIT_RESYNC in units:
            trouble = self.trouble or (COMPUTER if held_up else RESYNC)
        elif UNIT_LATE in units:
            trouble = COMPUTER
        else:
            trouble = None

        stops = authority.faults & STOPS
        at_rest = authority.mode != MODE_FOLLOWING
        if at_rest and not fresh and stops:
            if stops & FAULT_LONG_GAP:
                cause = COMPUTER
            elif stops & BY_ABSENCE or self.cause == 0:
                cause = ANSWER
            else:
                cause = self.cause
        elif trouble or self.trouble:
            cause = trouble or self.trouble
        else:
            controller, estimator = authority.in_charge
            starved = before is not None and any(
                waited(told.chain_delay_ns[seat], before.chain_delay_ns[seat]) for seat in (controller, 2 + estimator)
            )
            slow = before is not None and (before.end_ns - before.begin_ns) * 1e-9 > EXCHANGE_SHARE * period_s
            cause = COMPUTER if late or starved else DRIVE if slow else ANSWER

        if not under_way:
            period = NO_MISSION
        elif fresh and trouble is None:
            period = STEERED
        elif at_rest and authority.plan_rate == 0.0 and not stops:
            period = PAUSED
        else:
            period = cause
            if not (self.period >= COMPUTER and self.cause == ANSWER and cause == COMPUTER):
                self.cause = cause
        if not under_way:
            self.cause = 0
        gaps = []
        if under_way:
            gap, over = skipped(told, before, period_s), overrun(told, before, period_s)
            slow = self.trouble or (COMPUTER if held_up else DRIVE)
            paused = self.period == PAUSED
            gaps = [(PAUSED if paused else COMPUTER, gap - over), (PAUSED if paused else slow, over)]
        self.told, self.authority, self.period, self.trouble = told, authority, period, trouble
        self.late_tick = late_tick
        return period, gaps


def main(run):
    total, lives, different = [0] * 7, 0, []
    life, mine, carried = None, [0] * 7, None
    cycles = cycles_of(Path(run))
    for told, authority in cycles:
        if life is None or told.header.life != life.told.header.life:
            if life is not None and life.authority.motion != 0:
                # The life ended with its mission on.
                total[ANSWER] += skipped(told, life.told, authority.period_s)
                carried = life.told.mission
            life, mine, lives = Life(), [0] * 7, lives + 1
        before = life.told
        period, gaps = life.judge(told, authority)
        for counts in (total, mine):
            counts[period] += 1
            for what, gap in gaps:
                counts[what] += gap
        if carried is not None:
            if period == NO_MISSION and told.mission == carried and carried != 0:
                total[ANSWER] += 1 + (0 if before is None else skipped(told, before, authority.period_s))
            else:
                carried = None
        counted = [authority.steered, authority.paused, authority.lost_computer, authority.lost_drive]
        counted += [authority.lost_resync, authority.lost_answer]
        if period != authority.period or mine[1:] != counted or sum(counted) != authority.periods:
            where = {"life": told.header.life, "cycle": told.header.cycle}
            different.append({**where, "period": [period, authority.period], "counts": [mine[1:], counted]})
    found = dict(zip(NAMES[1:], total[1:], strict=True))
    found["unsteered"] = sum(total[COMPUTER:])
    found["all"] = found["steered"] + found["unsteered"]
    print(json.dumps({**found, "lives": lives, "cycles": len(cycles), "different": len(different), "first": different[:3]}))
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
