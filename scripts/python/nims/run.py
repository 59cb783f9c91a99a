"""A run, for analysis: channels as NumPy or pandas, with units, legs, faults and causes.

    import nims

    run = nims.Run("runs/2026-05-04T09-30-00Z-demo3")
    state = run.frame("motor/state")             # pandas; state.attrs["units"]["length_m_1"] == "m"
    print(run.legs(), run.faults(), run.causes())
"""

from __future__ import annotations

import itertools
import re
from typing import TYPE_CHECKING, Any

import numpy as np
from nims_run import Run as _Run
from nims_run import _free
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

# How the names of fields end, and what a column of that name is in; the longest end counts.
UNITS = {
    "_n_s2_m2": "N s2/m2", "_n_s_m": "N s/m", "_counts_s": "1/s", "_m_per_s": "m/s", "_per_m": "1/m", "_per_s": "1/s", "_m_s2": "m/s2", "_m_s": "m/s", "_m2": "m2",
    "_rad_s2": "rad/s2", "_rad_s": "rad/s", "_deg_s2": "deg/s2", "_deg_s": "deg/s", "_mm_s": "mm/s", "_n_m": "N/m", "_w_m2": "W/m2", "_kg_m3": "kg/m3",
    "_kg_m": "kg/m", "_n_a": "N/A", "_nm_a": "N m/A", "_per_k": "1/K", "_deg_c": "degC", "_percent": "%", "_counts": "counts", "_bytes": "bytes", "_deg": "deg", "_rad": "rad", "_ohm": "ohm", "_pa": "Pa", "_hz": "Hz", "_kg": "kg",
    "_ns": "ns", "_ms": "ms", "_us": "us", "_nm": "N m", "_m": "m", "_s": "s", "_n": "N", "_a": "A", "_v": "V", "_w": "W", "_j": "J", "_c": "degC", "_k": "K",
}
# Units that, before another one, are a part of a unit that is not in the list above.
PARTS = {"m", "s", "v", "a", "hz", "ohm", "counts", "deg", "rad", "mm", "cm", "um", "km", "n", "kn", "kg", "g", "mg", "w", "j", "l", "ml", "nm", "pa", "kpa", "hpa", "ma", "mv", "percent", "per"}
CAUSES = ("computer", "drive", "resync", "answer")
# Least speed of a setpoint that moves, m/s, as in `nims report`: slower ones are the ends of a profile.
MOVING_M_S = 1e-3


def unit_of(column: str) -> str:
    """The unit of a column by its name, such as `length_m_2`; empty if it has none, or one that is not in the list."""
    name = re.sub(r"(_\d+)+$", "", column.rstrip("_"))
    end = max((end for end in UNITS if name.endswith(end)), key=len, default="")
    before = name.removesuffix(end).rpartition("_")[2]
    # The knots of a profile are named by the symbols s and v.
    return UNITS[end] if end and (before not in PARTS or name.startswith("knot_")) else ""


class Run(_Run):  # type: ignore[misc]
    """A run folder or one run file: all of `nims_run.Run`, and the tables of an analyst."""

    def units(self, name: str) -> dict[str, str]:
        """The unit of each column of `columns(name)`."""
        return {column: unit_of(column) for column in self.columns(name)}

    def frame(self, name: str) -> pd.DataFrame:
        """A channel as a table of pandas, by the time since the run began (`t_s`) and with UTC; `attrs` has units and the
        names of values.
        """
        import pandas as pd

        columns: dict[str, NDArray[Any]] = {}
        for key, values in self.columns(name).items():
            columns[_free(key, {"utc", *columns})] = values
        frame = pd.DataFrame({key: np.asarray(values).astype(values.dtype.newbyteorder("=")) for key, values in columns.items()})
        frame.insert(1, "utc", pd.to_datetime(self.begin_ns + np.round(columns["t_s"] * 1e9).astype(np.int64), utc=True))
        frame.attrs["units"] = {column: unit_of(column) for column in columns}
        frame.attrs["names"] = self.definition(name).constants if self.counts.get(name) else {}
        return frame.set_index("t_s")

    def modes(self) -> list[tuple[float, float, str]]:
        """Begin, end and name of each mode of motor-io, s."""
        names = {value: name.removeprefix("MODE_").lower() for value, name in self.names("motor/authority", "mode").items()}
        samples = self["motor/authority"]
        return [(begin, end, names.get(value, str(value))) for begin, end, value in _spans(self.seconds(samples), samples["mode"]) ]

    def legs(self) -> list[dict[str, Any]]:
        """Each leg that was flown: its number in the mission, segment, begin and end in s since the run began, RMS and
        largest distance of the estimate from the setpoint while that moves, m.

        As in `nims report`: the controller in charge counts in each cycle, and a pause does not end a leg.
        """
        authority, status = self._in_charge()
        seconds = self.seconds(authority)
        plan = self["plan/status"] if "plan/status" in self.definitions else None
        # It contains the rate of the plan clock.
        moves = np.linalg.norm(status["setpoint_velocity_m_s"], axis=1) > MOVING_M_S
        counts, legs = moves & (status["valid"] == 1), []
        # That of the setpoint: motor-io still names the last segment in the cycle in which the next one begins.
        # 0: no answer.
        segments = np.where(status["segment"] != 0, status["segment"], authority["segment"])
        keys = [authority["header"]["life"], authority["epoch"], authority["motion"], segments]
        for first, last in _stretches(*keys):
            begin, end = float(seconds[first]), float(seconds[last])
            leg = None
            if plan is not None and len(plan) and "leg" in plan.dtype.names:
                leg = int(plan["leg"][max(np.searchsorted(self.seconds(plan), end, "right") - 1, 0)])
            error = status["error_norm_m"][first : last + 1][counts[first : last + 1]]
            rms, most = (float(np.sqrt((error**2).mean())), float(error.max())) if len(error) else (float("nan"), float("nan"))
            segment = int(segments[first])
            legs.append({"leg": leg, "segment": segment, "begin_s": begin, "end_s": end, "error_rms_m": rms, "error_max_m": most})
        return legs

    def _in_charge(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """The cycles that follow a segment, in order: `motor/authority` and the `control/status` of the slot in charge."""
        authority = self["motor/authority"]
        modes = {name: value for value, name in self.names("motor/authority", "mode").items()}
        follows = (authority["mode"] == modes.get("MODE_FOLLOWING", 3)) & (authority["segment"] != 0)
        rows, answers = [], []
        for number, slot in enumerate("ab"):
            name = f"control/status/{slot}"
            if name in self.definitions:
                status = self[name]
                of_slot = np.flatnonzero(follows & (authority["active_controller"] == number))
                of_authority, of_status = _same_cycles(authority["header"][of_slot], status["header"])
                rows.append(of_slot[of_authority])
                answers.append(status[of_status])
        if not rows:
            return authority[:0], np.zeros(0, [("valid", "u1"), ("segment", "<u4"), ("error_norm_m", "<f8"), ("setpoint_velocity_m_s", "<f8", 3)])
        whole = np.concatenate(rows)
        order = np.argsort(whole, kind="stable")
        return authority[whole[order]], np.concatenate(answers)[order]

    def faults(self) -> list[dict[str, Any]]:
        """Each fault: when it began and ended, s since the run began, and its names."""
        authority = self["motor/authority"]
        names = self.names("motor/authority", "faults")
        faults = []
        for begin, end, bits in _spans(self.seconds(authority), authority["faults"]):
            if bits:
                faults.append({"begin_s": begin, "end_s": end, "faults": [name.removeprefix("FAULT_").lower() for bit, name in names.items() if int(bits) & bit]})
        return faults

    def causes(self) -> list[dict[str, Any]]:
        """Each stretch of a mission that was not steered, by its cause: begin, s since the run began, periods, cause.

        Over all lives of motor-io, with what was lost between them. What the first life lost before the first sample of
        the run (of a later file that is read alone) has no time in it and is left out.
        """
        authority = self["motor/authority"]
        seconds, found = self.seconds(authority), []
        later = np.flatnonzero(np.diff(authority["header"]["life"])) + 1
        for cause in CAUSES:
            counts = authority[f"lost_{cause}"].astype(np.int64)
            lost = np.diff(counts, prepend=counts[:1])
            # Each later life counts from 0.
            lost[later] = counts[later]
            for at in np.flatnonzero(lost > 0):
                found.append({"begin_s": float(seconds[at]), "periods": int(lost[at]), "cause": cause})
        return sorted(found + self._between_lives(authority), key=lambda one: one["begin_s"])

    def _between_lives(self, authority: NDArray[Any]) -> list[dict[str, Any]]:
        """What was lost because a life of motor-io ended during a motion: `docs/counters.md`, *Over lives*."""
        if "motor/input" not in self.definitions:
            return []
        of_authority, of_input = _same_cycles(authority["header"], self["motor/input"]["header"])
        decided, told = authority[of_authority], self["motor/input"][of_input]
        seconds = self.seconds(decided)
        none = {name: value for value, name in self.names("motor/authority", "period").items()}.get("PERIOD_NO_MISSION", 0)
        # Periods between each tick and the one before it.
        ticks = np.diff(told["tick_ns"].astype(np.int64), prepend=told["tick_ns"][:1].astype(np.int64)) * 1e-9
        skipped = np.maximum((ticks / decided["period_s"] + 0.5).astype(np.int64) - 1, 0)
        lives = _stretches(decided["header"]["life"])
        mission, found = 0, []
        for (_, last), (first, end) in itertools.pairwise(lives):
            periods = 0
            if decided["motion"][last]:
                periods, mission = int(skipped[first]), int(told["mission"][last])
            rests = (decided["period"][first : end + 1] == none) & (told["mission"][first : end + 1] == mission) & (mission != 0)
            # Cycles of the new life until something else is flown.
            waits = int(np.argmin(rests)) if not rests.all() else len(rests)
            periods += waits + int(skipped[first + 1 : first + waits].sum())
            if periods:
                found.append({"begin_s": float(seconds[last]), "periods": periods, "cause": "answer"})
            mission = mission if rests.all() else 0
        return found


def _same_cycles(one: NDArray[Any], other: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The indices of headers of the same life and cycle, in their order."""
    keys = [np.empty(len(header), [("life", "<u8"), ("cycle", "<u8")]) for header in (one, other)]
    for key, header in zip(keys, (one, other), strict=True):
        key["life"], key["cycle"] = header["life"], header["cycle"]
    _, of_one, of_other = np.intersect1d(keys[0], keys[1], return_indices=True)
    return of_one, of_other


def _stretches(*values: NDArray[Any]) -> list[tuple[int, int]]:
    """First and last index of each stretch in which all these values are equal."""
    count = len(values[0])
    if not count:
        return []
    changes = np.any([one[1:] != one[:-1] for one in values], axis=0)
    begins = [0, *(np.flatnonzero(changes) + 1).tolist()]
    return list(zip(begins, [*(begin - 1 for begin in begins[1:]), count - 1], strict=True))


def _spans(seconds: NDArray[Any], values: NDArray[Any]) -> list[tuple[float, float, Any]]:
    """Begin and end of each stretch of equal values."""
    return [(float(seconds[first]), float(seconds[last]), values[first].item()) for first, last in _stretches(values)]
