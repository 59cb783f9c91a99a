"""A run, for analysis: channels as NumPy or pandas, with units, legs, faults and causes.

    import nims

    run = nims.Run("runs/2026-05-04T09-30-00Z-demo3")
    state = run.frame("motor/state")             # pandas; state.attrs["units"]["length_m_1"] == "m"
    print(run.legs(), run.faults(), run.causes())
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np
from nims_run import Run as _Run
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

# How the names of fields end, the longest first, and what a column of that name is in.
UNITS = {
    "_n_s2_m2": "N s2/m2", "_n_s_m": "N s/m", "_counts_s": "1/s", "_per_m": "1/m", "_per_s": "1/s", "_m_s2": "m/s2", "_m_s": "m/s", "_m2": "m2",
    "_rad_s": "rad/s", "_percent": "%", "_counts": "counts", "_bytes": "bytes", "_deg": "deg", "_rad": "rad", "_ohm": "ohm", "_pa": "Pa", "_hz": "Hz", "_kg": "kg",
    "_ns": "ns", "_ms": "ms", "_us": "us", "_nm": "N m", "_m": "m", "_s": "s", "_n": "N", "_a": "A", "_v": "V", "_w": "W", "_j": "J", "_c": "degC", "_k": "K",
}
CAUSES = ("computer", "drive", "resync", "answer")


def unit_of(column: str) -> str:
    """The unit of a column by its name, such as `length_m_2`; empty if it has none."""
    name = re.sub(r"(_\d+)+$", "", column)
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), "")


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

        columns = self.columns(name)
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
        """Each leg that was flown: its number in the mission, segment, begin and end in s since the run began, mean and
        largest distance of the estimate from the setpoint, m.
        """
        status = self._first_of("control/status/")
        plan = self["plan/status"] if "plan/status" in self.definitions else None
        seconds, distances, legs = self.seconds(status), status["error_norm_m"], []
        for begin, end, segment in _spans(seconds, status["segment"]):
            if not segment:
                continue
            within = (seconds >= begin) & (seconds <= end) & (status["valid"] == 1)
            leg = None
            if plan is not None and len(plan) and "leg" in plan.dtype.names:
                leg = int(plan["leg"][max(np.searchsorted(self.seconds(plan), end, "right") - 1, 0)])
            error = distances[within]
            mean, most = (float(np.sqrt((error**2).mean())), float(error.max())) if len(error) else (float("nan"), float("nan"))
            legs.append({"leg": leg, "segment": int(segment), "begin_s": begin, "end_s": end, "error_rms_m": mean, "error_max_m": most})
        return legs

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
        """Each stretch of a mission that was not steered, by its cause: begin, s since the run began, periods, cause."""
        authority = self["motor/authority"]
        seconds, found = self.seconds(authority), []
        for cause in CAUSES:
            lost = np.diff(authority[f"lost_{cause}"].astype(np.int64), prepend=authority[f"lost_{cause}"][:1].astype(np.int64))
            # Another life of motor-io counts from 0.
            lost[lost < 0] = 0
            for at in np.flatnonzero(lost):
                found.append({"begin_s": float(seconds[at]), "periods": int(lost[at]), "cause": cause})
        return sorted(found, key=lambda one: one["begin_s"])

    def _first_of(self, prefix: str) -> NDArray[Any]:
        """The samples of the first channel whose name begins so: slot a, if it is there."""
        found = [name for name in self.channels if name.startswith(prefix)]
        return self[found[0] if found else prefix + "a"]  # type: ignore[no-any-return]


def _spans(seconds: NDArray[Any], values: NDArray[Any]) -> list[tuple[float, float, Any]]:
    """Begin and end of each stretch of equal values."""
    if not len(values):
        return []
    begins = np.concatenate(([0], np.flatnonzero(values[1:] != values[:-1]) + 1))
    ends = np.concatenate((begins[1:] - 1, [len(values) - 1]))
    return [(float(seconds[begin]), float(seconds[end]), values[begin].item()) for begin, end in zip(begins, ends, strict=True)]
