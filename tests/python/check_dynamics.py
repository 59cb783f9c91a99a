"""Flies the node of a recorded flight again, in numpy, from nothing but the unstretched cables over time.

usage: check_dynamics.py FILE

FILE is JSON: the true robot, the node's velocity at the beginning, and the plant's time, unstretched cables and
position every few milliseconds. This program integrates Newton's law for the node from the first position on. Forces
are the numerical gradient of the energy of the stretched cables, so it shares with the plant neither the directions of
the cables nor the integration; the wheels' tangent follows from the power of a point.

Prints the difference of both positions beside the swing about the place of rest; exits 1 if the difference exceeds its
tolerance, or if the node hardly swings, so that there is nothing to compare.
"""

import json
import sys

import numpy as np

TOLERANCE_RMS_MM = 1.0
LEAST_SWING_MM = 5.0
STEP_S = 0.001
# Half of the interval of the numerical gradient, m.
BESIDE_M = 1e-5


def lengths(flight, nodes):
    """Length of each cable from its anchor over the wheel to each of the nodes, (nodes, cables)."""
    to_node = nodes[:, None, :] - flight["anchors_m"][None, :, :]
    outward = np.hypot(to_node[..., 0], to_node[..., 1]) - flight["radius_m"]
    down = -to_node[..., 2]
    free = np.sqrt(outward**2 + down**2 - flight["radius_m"] ** 2)
    # The angle at the wheel's centre between the anchor and the point where the cable leaves, over the top.
    to_leave = np.arctan2(free, flight["radius_m"])
    wrapped = np.pi + np.arctan2(down, outward) - to_leave
    return free + flight["radius_m"] * wrapped


def accelerations(flight, node, velocity, unstretched, unstretched_rate):
    """Acceleration of the node, m/s²."""
    beside = node + BESIDE_M * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
    there = lengths(flight, beside)
    gradient = (there[1:4] - there[4:7]) / (2 * BESIDE_M)
    total = there[0] + flight["routed_m"]
    strain = total / unstretched - 1
    strain_rate = (velocity @ gradient - unstretched_rate * total / unstretched) / unstretched
    tensions = np.maximum(flight["stiffness_n"] * (strain + flight["damping_s"] * strain_rate), 0)
    drag = -flight["drag_n_s2_m2"] * np.linalg.norm(velocity) * velocity
    return (drag - gradient @ tensions) / flight["node_mass_kg"] - np.array([0, 0, flight["gravity_m_s2"]])


def hang(flight, node, unstretched):
    """Where the node rests on these cables, by Newton steps from a place near it."""
    for _ in range(50):
        force = accelerations(flight, node, np.zeros(3), unstretched, np.zeros_like(unstretched))
        columns = []
        for axis in np.eye(3):
            beside = accelerations(flight, node + 1e-4 * axis, np.zeros(3), unstretched, np.zeros_like(unstretched))
            columns.append((beside - force) / 1e-4)
        step = np.linalg.solve(np.array(columns).T, force)
        node = node - step
        if np.linalg.norm(step) < 1e-9:
            return node
    raise AssertionError("the node does not come to rest")


def spline(times, rows, at):
    """Values and rates of cubics through the rows with the slopes of the neighbours."""
    slopes = np.gradient(rows, times, axis=0)
    k = np.clip(np.searchsorted(times, at, side="right") - 1, 0, times.size - 2)
    width = (times[k + 1] - times[k])[:, None]
    t = (at - times[k])[:, None] / width
    a, b, da, db = rows[k], rows[k + 1], slopes[k] * width, slopes[k + 1] * width
    value = a + t * (da + t * (3 * (b - a) - 2 * da - db + t * (2 * (a - b) + da + db)))
    rate = da + t * (2 * (3 * (b - a) - 2 * da - db) + 3 * t * (2 * (a - b) + da + db))
    return value, rate / width


def main():
    with open(sys.argv[1]) as file:
        flight = {key: np.array(value) for key, value in json.load(file).items()}
    times = flight["time_s"] - flight["time_s"][0]
    steps = int(times[-1] / STEP_S)
    # Unstretched cables at half steps, for the classic scheme of fourth order.
    halves, rates = spline(times, flight["unstretched_m"] + flight["routed_m"], 0.5 * STEP_S * np.arange(2 * steps + 1))
    node, velocity = flight["position_m"][0], flight["velocity_m_s"]
    track = [node]
    for k in range(0, 2 * steps, 2):

        def slope(node, velocity, half):
            return velocity, accelerations(flight, node, velocity, halves[half], rates[half])

        v1, a1 = slope(node, velocity, k)
        v2, a2 = slope(node + 0.5 * STEP_S * v1, velocity + 0.5 * STEP_S * a1, k + 1)
        v3, a3 = slope(node + 0.5 * STEP_S * v2, velocity + 0.5 * STEP_S * a2, k + 1)
        v4, a4 = slope(node + STEP_S * v3, velocity + STEP_S * a3, k + 2)
        node = node + STEP_S / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
        velocity = velocity + STEP_S / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        track.append(node)
    track = np.array(track)
    at = np.arange(steps + 1) * STEP_S
    found = np.array([np.interp(times, at, track[:, axis]) for axis in range(3)]).T
    inside = times <= at[-1]
    off_mm = 1e3 * np.linalg.norm((found - flight["position_m"])[inside], axis=1)
    # Each tenth sample: the place of rest for the cables of the same time.
    places = np.arange(times.size)[inside][::10]
    cables, _ = spline(times, flight["unstretched_m"] + flight["routed_m"], times[places])
    rests = np.array([hang(flight, found[p], c) for p, c in zip(places, cables, strict=True)])
    swing_mm = 1e3 * np.linalg.norm(flight["position_m"][places] - rests, axis=1).max()
    rms_mm = np.sqrt(np.mean(off_mm**2))
    moved_m = np.linalg.norm(flight["position_m"][-1] - flight["position_m"][0])
    print(
        f"{times[-1]:.1f} s, {moved_m:.2f} m: {rms_mm:.3f} mm RMS, {off_mm.max():.3f} mm at most,"
        f" while the node swings by up to {swing_mm:.1f} mm"
    )
    sys.exit(bool(rms_mm > TOLERANCE_RMS_MM or swing_mm < LEAST_SWING_MM))


main()
