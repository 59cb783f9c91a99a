# A run, step by step: from the run file to figures and pictures, with pandas.
#
#     python scripts/python/look_at_run.py runs/2026-05-04T09-30-00Z-demo3 [--out DIR]
#
# Editors can run the cells, marked with `# %%`, one by one. Needs numpy, mcap, zstandard, pandas and matplotlib.

# %% Channels and their numbers of samples
import argparse
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd

from nims_run import Run

matplotlib.use("Agg")
from matplotlib import pyplot as plt

arguments = argparse.ArgumentParser(description="From a run of nims to figures and pictures.")
arguments.add_argument("run", type=Path, help="run folder, or .mcap file")
arguments.add_argument("--out", type=Path, default=Path("."), help="folder for the pictures")
arguments = arguments.parse_args()
run = Run(arguments.run)
overview = pd.Series(run.counts, name="samples").to_frame()
overview["type"] = [run.definitions[name].name for name in overview.index]
print(overview.sort_index().to_string())

# %% One table for each channel; samples of one control cycle share its number, which each life of motor-io begins again
CYCLE = ["life", "cycle"]
state = pd.DataFrame(run.columns("motor/state")).set_index(CYCLE)
state = state[state["position_known"] > 0]  # lengths are not valid before
authority = pd.DataFrame(run.columns("motor/authority")).set_index(CYCLE)
estimate = pd.DataFrame(run.columns("node/estimate/a")).set_index(CYCLE)
control = pd.DataFrame(run.columns("control/status/a")).set_index(CYCLE)
cables = int(authority["cable_count"].max())
modes = run.names("motor/authority", "mode")
authority["mode_name"] = authority["mode"].map(lambda mode: modes.get(mode, str(mode)).removeprefix("MODE_").lower())
print(authority.groupby("mode_name", sort=False).size().mul(authority["period_s"].iloc[0]).rename("seconds").to_string())

# %% Distance from the setpoint while the node moves
moving = control[(control["valid"] == 1) & (control["segment"] != 0)]
moving = moving[authority["plan_rate"].reindex(moving.index).fillna(0.0) > 0.0]
error_mm = 1e3 * moving["error_norm_m"]
print(f"estimate from setpoint: RMS {np.sqrt((error_mm**2).mean()):.2f} mm, 95 % below {error_mm.quantile(0.95):.2f} mm")

# %% Age of the oldest reading when the command based on it is sent
age_ms = 1e-6 * authority.loc[authority["command_age_ns"] > 0, "command_age_ns"]
print(f"oldest reading to command: median {age_ms.median():.2f} ms, 99 % below {age_ms.quantile(0.99):.2f} ms")
last = authority.iloc[-1]
causes = {cause: int(last[f"lost_{cause}"]) for cause in ("computer", "drive", "resync", "answer")}
print(f"{sum(causes.values())} of {int(last['periods'] - last['paused'])} periods not steered: {causes}")

# %% Pictures
arguments.out.mkdir(parents=True, exist_ok=True)
figure, (above, aside) = plt.subplots(1, 2, figsize=(10, 4.5))
known = estimate[estimate["valid"] == 1]
for axes, x, y in ((above, 1, 2), (aside, 1, 3)):
    axes.plot(known[f"position_m_{x}"], known[f"position_m_{y}"], linewidth=1)
    axes.set(xlabel=f"{'xyz'[x - 1]} [m]", ylabel=f"{'xyz'[y - 1]} [m]", aspect="equal")
above.set_title("from above")
aside.set_title("from the side")
figure.tight_layout()
figure.savefig(arguments.out / "path.png", dpi=120)

figure, rows = plt.subplots(4, 1, figsize=(10, 9), sharex=True)
for cable in range(1, cables + 1):
    rows[0].plot(state["t_s"], state[f"length_m_{cable}"], label=f"cable {cable}")
    rows[1].plot(state["t_s"], state[f"velocity_m_s_{cable}"])
    rows[2].plot(known["t_s"], known[f"tension_n_{cable}"])
rows[3].plot(moving["t_s"], error_mm)
for axes, label in zip(rows, ("length [m]", "velocity [m/s]", "tension [N]", "off the setpoint [mm]"), strict=True):
    axes.set_ylabel(label)
rows[0].legend(loc="upper right")
rows[3].set_xlabel("time [s]")
figure.tight_layout()
figure.savefig(arguments.out / "lines.png", dpi=120)
print(f"pictures: {arguments.out / 'path.png'}, {arguments.out / 'lines.png'}")
