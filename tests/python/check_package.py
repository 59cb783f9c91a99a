"""The package `nims` with simulated flights: check_package.py SYSTEM NIMS_SIM FOLDER. Prints what it leaves out.

A flight whose velocities Python gives is compared bit for bit with the same law inside of `nims sim`, flown by another
process, and with itself in batches. The tables of an analyst are compared with counts of the samples.
"""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

import nims

SYSTEM, PROGRAM, FOLDER = sys.argv[1], sys.argv[2], Path(sys.argv[3])
GAIN = 1.5
SEED = 3
HOLDING = 1


def law(seen):
    return seen["desired_velocities_m_s"] + GAIN * (seen["desired_lengths_m"] - seen["lengths_m"])


def refused(call, *named):
    """The call is refused with a sentence that has these words."""
    try:
        call()
    except nims.SimError as error:
        assert all(word in str(error) for word in named), error
        assert "\n" not in str(error)
        return
    raise AssertionError(f"not refused: {named}")


def fly(sim, seed):
    """All observations of a flight and the velocities that made them."""
    seen, velocities = [sim.reset(seed)], []
    while not sim.ended:
        velocities.append(law(seen[-1]))
        seen.append(sim.step(velocities[-1]))
    return np.array(seen), np.array(velocities)


def check_flights():
    inside = [PROGRAM, SYSTEM, "--law", "p-feedforward", "--set", f"controller.length_gain_per_s={GAIN}", "--world", str(SEED)]
    subprocess.run([*inside, "--out", FOLDER / "inside"], check=True, stdout=subprocess.DEVNULL)
    with nims.Sim(SYSTEM, program=PROGRAM, out=FOLDER / "outside") as sim:
        refused(lambda: sim.step([0.0]), "(1,)", "(0,)")
        seen, velocities = fly(sim, SEED)
        assert sim.ended == "done", (sim.ended, sim.why)
        refused(lambda: sim.step(velocities[0]), "reset")
        run_folder = sim.folder
        # The same in batches: the last one is cut where the flight ends.
        assert sim.reset(SEED) == seen[0]
        rows = np.concatenate((velocities, velocities[:50]))
        pieces = [sim.step(rows[:7]), sim.step(rows[7:1000]), sim.step(rows[1000:])]
        assert np.array_equal(np.concatenate(pieces), seen[1:]) and sim.ended == "done"
        again, _ = fly(sim, None)
        assert not np.array_equal(again["truth_m"], seen["truth_m"][: len(again)]), "a drawn world is another one"
        # No answer brings the robot to rest, a wrong one is stopped by motor-io.
        sim.reset(SEED)
        sim.step(velocities[:300])
        silent = sim.step(np.full((300, sim.cables), np.nan))
        assert not silent["sent_m_s"][-1].any() and silent["mode"][-1] == HOLDING, silent[-1]
        sim.reset(SEED)
        sim.step(-2.0 * velocities[:3000])
        assert sim.ended == "fault" and sim.why, sim.ended
    inside, outside = (nims.Run(folder) for folder in (next((FOLDER / "inside").glob("001-*")), run_folder))
    for channel in ("truth/node", "motor/state"):
        one, other = inside[channel], outside[channel]
        # The last cycle is the same too.
        assert len(one) == len(other), (channel, len(one), len(other))
        for field in set(one.dtype.names) - {"log_time_ns"}:
            assert one[field].tobytes() == other[field].tobytes(), (channel, field)
    refused(lambda: sim.step(velocities[0]), "closed")
    with nims.Sim("no-such-system.toml", program=PROGRAM) as wrong:
        refused(wrong.reset, "no-such-system.toml")
    with nims.Sim(SYSTEM, program=PROGRAM, sets={"controller.no_such_key": 1}) as wrong:
        refused(wrong.reset, "no_such_key")
    return outside


def check_tables(run):
    legs = run.legs()
    assert len(legs) >= 2 and all(leg["end_s"] > leg["begin_s"] for leg in legs), legs
    # Where the node rests, no distance counts.
    moves = [leg for leg in legs if not np.isnan(leg["error_rms_m"])]
    assert len(moves) >= 2 and all(leg["error_max_m"] >= leg["error_rms_m"] >= 0 for leg in moves), legs
    check_legs(run.files[0].parent, legs)
    assert not run.faults() and sum(one["periods"] for one in run.causes()) == lost(run)
    assert run.units("motor/state")["length_m_1"] == "m" and run.units("truth/node")["tension_n_1"] == "N"
    assert {name for _, _, name in run.modes()} >= {"disarmed", "holding", "following"}
    failed = nims.Run(sorted((FOLDER / "outside").glob("*"))[-1])
    faults = failed.faults()
    assert faults and faults[0]["faults"], failed.modes()
    if importlib.util.find_spec("pandas"):
        frame = run.frame("motor/state")
        assert frame.attrs["units"]["length_m_1"] == "m" and frame.index.name == "t_s"
        assert np.array_equal(frame["cycle"], run["motor/state"]["header"]["cycle"]) and str(frame["utc"].iloc[0].tz) == "UTC"
    else:
        print("left out: tables of pandas, which is not installed")


def check_legs(folder, legs):
    """The figures of `nims report`, whose program lies beside that of `nims sim`."""
    report = [Path(PROGRAM).with_name("nims"), "report", folder, "--json"]
    rows = json.loads(subprocess.run(report, check=True, capture_output=True).stdout)["runs"][0]["legs"]
    assert len(rows) == len(legs), (len(rows), len(legs))
    for row, leg in zip(rows, legs, strict=True):
        error = row["estimate"] or {"rms_m": np.nan, "max_m": np.nan}
        ours = [leg["begin_s"], leg["end_s"], leg["error_rms_m"], leg["error_max_m"]]
        theirs = [row["begin_s"], row["begin_s"] + row["duration_s"], error["rms_m"], error["max_m"]]
        assert np.allclose(ours, theirs, rtol=1e-9, atol=1e-9, equal_nan=True), (leg, row)


def lost(run):
    last = run["motor/authority"][-1]
    return sum(int(last[f"lost_{cause}"]) for cause in ("computer", "drive", "resync", "answer"))


def check_environment():
    if not importlib.util.find_spec("gymnasium"):
        print("left out: the environment of gymnasium, which is not installed")
        return
    assert "gymnasium" not in sys.modules, "it is imported without being asked for"
    import warnings

    import nims.env
    from gymnasium.utils.env_checker import check_env

    env = nims.env.CablesEnv(SYSTEM, longest_s=4.0, cycles=5, program=PROGRAM)
    with warnings.catch_warnings():
        # Positions have no bounds.
        warnings.filterwarnings("ignore", message=".*Box observation space m.*infinity")
        check_env(env, skip_render_check=True)
    env = nims.env.CablesEnv(SYSTEM, longest_s=4.0, program=PROGRAM)
    env.reset(seed=1)
    ended, steps = False, 0
    while not ended:
        _, reward, terminated, ended, info = env.step(np.zeros(env.action_space.shape, np.float32))
        steps += 1
        assert reward <= 0 and not terminated, info
    assert steps == round(4.0 / env.sim.period_s), steps
    env.close()


check_tables(check_flights())
check_environment()
