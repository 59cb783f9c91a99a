"""A virtual robot, flown by your own cable velocities, much faster than real time.

    import nims

    with nims.Sim("configs/systems/demo3.toml") as sim:
        seen = sim.reset(seed=3)
        while not sim.ended:
            errors = seen["desired_lengths_m"] - seen["lengths_m"]
            seen = sim.step(seen["desired_velocities_m_s"] + 1.5 * errors)
        print(sim.ended, sim.why)

It is the robot of `nims sim`: the decisions of motor-io, estimator and planner against the virtual world, cycle by
cycle; the velocities take the place of the controller's answer, so motor-io checks and limits them as always.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

# What passes in nearly every cycle is neither written nor read as JSON.
ONE, STEPPED_LINE, STEPPED = b'{"step":1}\n', b'{"steps":1}\n', {"steps": 1}

Ended = Literal["done", "aborted", "fault", "longest"]


class SimError(Exception):
    """One sentence: what is wrong, and what to do."""


def find_program(name: str, given: str | os.PathLike[str] | None = None) -> str:
    """The path of a program of nims: the given one, that of the variable `NIMS_SIM` and so on, or the one in PATH."""
    variable = name.upper().replace("-", "_")
    path = os.fspath(given) if given else os.environ.get(variable) or shutil.which(name)
    if not path:
        raise SimError(f"the program {name} is not in PATH: install nims, or name its path in the variable {variable}")
    return path


class Sim:
    """A virtual robot in a process of its own.

    An observation is a structured NumPy value. Of the estimate: `position_m`, `velocity_m_s`, `lengths_m` (unstretched),
    `tensions_n`. Of the motion: `setpoint_m`, `setpoint_m_s`, `setpoint_m_s2`, the setpoint after the controller's
    horizon `ahead_m`, `ahead_m_s`, and for the unstretched cables `desired_lengths_m`, `desired_velocities_m_s` (not a
    number where the cables cannot hold the node). Of motor-io: `cycle`, `t_s`, `mode`, `plan_time_s`, the velocities
    after its limits `sent_m_s`, `energy_j`. For evaluation only: `truth_m`, `truth_m_s`, `truth_tensions_n`.
    """

    def __init__(
        self,
        system: str | os.PathLike[str],
        *,
        mission: str | os.PathLike[str] | None = None,
        sets: Mapping[str, object] | None = None,
        spread: float | None = None,
        wind_m_s: float | None = None,
        warming_k: float | None = None,
        longest_s: float | None = None,
        out: str | os.PathLike[str] | None = None,
        program: str | os.PathLike[str] | None = None,
    ) -> None:
        """`sets` are values of the system or robot file, such as `{"robot.node_mass_kg": 2.5}`; `spread`, `wind_m_s` and
        `warming_k` say how worlds are drawn; `out` is a folder for a run folder of each flight.
        """
        words = [find_program("nims-sim", program), os.fspath(system), "--steps"]
        options: dict[str, str | os.PathLike[str] | float | None]
        options = {"mission": mission, "spread": spread, "wind": wind_m_s, "warming": warming_k, "longest": longest_s, "out": out}
        words += [f"--{option}={value}" for option, value in options.items() if value is not None]
        for key, value in (sets or {}).items():
            words.append(f"--set={key}={_toml(value)}")
        self._child = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.cables = 0
        """Number of cables, known after `reset`."""
        self.period_s = 0.0
        """Duration of a control cycle, s."""
        self.cable_speed_limit_m_s = 0.0
        """Most that motor-io lets a cable move, m/s."""
        self.folder: Path | None = None
        """Folder with the files of this flight, and with its run if `out` was given."""
        self.ended: Ended | None = None
        """Why the flight is over: flown, given up by the robot, a fault, or longer than `longest_s`."""
        self.why = ""
        """The same as a sentence."""
        self.dtype: np.dtype[Any] = np.dtype([])
        """The type of an observation."""

    def reset(self, seed: int | None = None) -> np.void:
        """Begins a flight of the mission, at rest and armed; returns the first observation.

        With a seed, in the world that `nims truth --seed` draws; without one, in that of the system file. The same seed
        gives the same flight, bit for bit.
        """
        opened = self._ask({"reset": {"seed": None if seed is None else int(seed)}})
        self.cables, self.period_s = opened["cables"], opened["period_s"]
        self.cable_speed_limit_m_s = opened["cable_speed_limit_m_s"]
        self.folder, self.ended, self.why = Path(opened["folder"]), None, ""
        shapes = [(name, "<f8") if count == 1 else (name, "<f8", (count,)) for name, count in opened["fields"]]
        self.dtype = np.dtype(shapes)
        return self._observations(1)[0]  # type: ignore[no-any-return]

    def step(self, velocities_m_s: ArrayLike) -> Any:
        """Flies a cycle with these cable velocities dL/dt, m/s, above 0 pays out; returns the observation after it.

        With one row per cycle it flies all of them at once, much faster than one by one, and returns one observation per
        cycle that was flown: fewer if the flight ended. A row that is not a number is no answer in that cycle.
        """
        rows: NDArray[np.float64] = np.ascontiguousarray(velocities_m_s, "<f8")
        if rows.shape[-1:] != (self.cables,) or rows.ndim > 2:
            raise SimError(f"velocities have the shape {rows.shape}; accepted: ({self.cables},), or a row of that for each cycle")
        stepped = self._ask({"step": len(rows)} if rows.ndim == 2 else ONE, rows.tobytes())
        if stepped is not STEPPED:
            self.ended, self.why = stepped.get("ended"), stepped.get("why", "")
        seen = self._observations(stepped["steps"])
        return seen if rows.ndim == 2 else seen[0]

    def _observations(self, count: int) -> NDArray[Any]:
        return np.frombuffer(self._read(count * self.dtype.itemsize), self.dtype)

    def _ask(self, request: object, body: bytes = b"") -> dict[str, Any]:
        assert self._child.stdin and self._child.stdout
        line = request if isinstance(request, bytes) else json.dumps(request).encode() + b"\n"
        try:
            self._child.stdin.write(line + body)
            self._child.stdin.flush()
        except (BrokenPipeError, ValueError):
            raise self._gone() from None
        line = self._child.stdout.readline()
        if line == STEPPED_LINE:
            return STEPPED
        if not line:
            raise self._gone()
        answer: dict[str, Any] = json.loads(line)
        if "failed" in answer:
            raise SimError(answer["failed"])
        return answer

    def _read(self, count: int) -> bytes:
        assert self._child.stdout
        data = self._child.stdout.read(count)
        if len(data) < count:
            raise self._gone()
        return data

    def _gone(self) -> SimError:
        """What the program said when it ended."""
        if self._child.stdin and self._child.stdin.closed:
            return SimError("the simulation is closed: make another Sim")
        _, said = self._child.communicate()
        return SimError(said.decode(errors="replace").strip().removeprefix("nims: ") or "nims-sim has ended: start it by hand to see why")

    def close(self) -> None:
        """Ends the flight and the program; a run that it records is complete then."""
        if self._child.stdin and not self._child.stdin.closed:
            try:
                self._child.stdin.close()
            except BrokenPipeError:
                pass
        try:
            self._child.wait(60)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        for stream in (self._child.stdout, self._child.stderr):
            if stream:
                stream.close()

    def __enter__(self) -> Sim:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _toml(value: object) -> str:
    """A value as TOML; a text may do without quotes."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str | int | float):
        return str(value)
    if isinstance(value, Sequence):
        return "[" + ", ".join(json.dumps(item) if isinstance(item, str) else _toml(item) for item in value) + "]"
    raise SimError(f"{value!r} is no value of a configuration file; accepted: texts, numbers, truth values and lists of them")
