"""A virtual robot as an environment of Gymnasium: `pip install nims[gym]`.

    import gymnasium
    import nims.env

    env = gymnasium.make("nims/Cables-v0", system="configs/systems/demo3.toml")

The action is the velocity of each cable as a share of its limit, -1 to 1, above 0 pays out. It is added to the desired
velocity of the motion, so an action of 0 is feedforward alone (`feedforward=False`: it is the velocity itself).
The observation is a dictionary of spaces; the truth is in `info`, because nothing in the loop may read it. The reward of
a cycle is the negative distance of the true node from its setpoint, m; a fault costs 10 more.
"""

from __future__ import annotations

import os
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from nims.sim import Sim

FAULT_COST = 10.0
SEEN = (
    "position_m", "velocity_m_s", "lengths_m", "tensions_n", "setpoint_m", "setpoint_m_s", "ahead_m", "ahead_m_s", "desired_lengths_m",
    "desired_velocities_m_s", "sent_m_s",
)
TRUTH = ("truth_m", "truth_m_s", "truth_tensions_n")

Observation = dict[str, Any]


class CablesEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A mission, flown with cable velocities. `cycles` is the number of control cycles for which an action holds."""

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, system: str | os.PathLike[str], *, cycles: int = 1, feedforward: bool = True, drawn: bool = True, **options: Any) -> None:
        """`drawn`: a seed draws a world, as `nims truth` does; `options` are those of `nims.Sim`."""
        self.sim = Sim(system, **options)
        self._cycles, self._feedforward, self._drawn = cycles, feedforward, drawn
        first = self.sim.reset()
        self._last = first
        every: dict[str, spaces.Space[Any]] = {name: spaces.Box(-np.inf, np.inf, first[name].shape, np.float64) for name in SEEN}
        self.observation_space = spaces.Dict(every)
        self.action_space = spaces.Box(-1.0, 1.0, (self.sim.cables,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """Begins a flight; with a seed, and later ones that follow from it, each in another drawn world."""
        super().reset(seed=seed)
        world = int(self.np_random.integers(1, 2**31)) if self._drawn else None
        self._last = self.sim.reset(world)
        return self._seen(), self._info() | {"world": world}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Flies the cycles of an action."""
        velocities = np.asarray(action, np.float64) * self.sim.cable_speed_limit_m_s
        reward = 0.0
        for _ in range(self._cycles):
            desired = np.nan_to_num(self._last["desired_velocities_m_s"])
            self._last = self.sim.step(velocities + desired if self._feedforward else velocities)
            reward -= float(np.linalg.norm(self._last["truth_m"] - self._last["setpoint_m"]))
            if self.sim.ended:
                break
        if self.sim.ended == "fault":
            reward -= FAULT_COST
        truncated = self.sim.ended == "longest"
        return self._seen(), reward, self.sim.ended is not None and not truncated, truncated, self._info()

    def close(self) -> None:
        """Ends the simulation."""
        self.sim.close()

    def _seen(self) -> Observation:
        return {name: np.nan_to_num(self._last[name]) for name in SEEN}

    def _info(self) -> dict[str, Any]:
        return {name: self._last[name].copy() for name in TRUTH} | {"ended": self.sim.ended, "why": self.sim.why, "t_s": float(self._last["t_s"])}


gymnasium.register("nims/Cables-v0", entry_point="nims.env:CablesEnv", disable_env_checker=True)
