"""Checks `nims solve` against numpy: every operation on random cases, and every kind of error.

usage: check_solve.py PROGRAM [CASES PER OPERATION]

Prints one line per operation; exits 1 if anything disagrees. The oracles share nothing with the program: pseudo-inverses by
singular values, tensions by trying every combination of limits, the control law as one linear system.
"""

import functools
import itertools
import json
import math
import subprocess
import sys

import numpy as np
from solve_fits import check_fits

rng = np.random.default_rng(20090415)
G = 9.80665


class Solver:
    def __init__(self, program):
        self.process = subprocess.Popen([program, "solve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.count = 0

    def __call__(self, op, **arguments):
        self.count += 1
        plain = json.dumps({"id": self.count, "op": op, **arguments}, default=lambda v: v.tolist())
        self.process.stdin.write(plain + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        assert answer["id"] == self.count, answer
        assert ("result" in answer) != ("error" in answer), answer
        return answer

    def result(self, op, **arguments):
        answer = self(op, **arguments)
        assert "result" in answer, (op, arguments, answer)
        return answer["result"]

    def kind(self, op, **arguments):
        answer = self(op, **arguments)
        assert "error" in answer, (op, arguments, answer)
        message = answer["error"]["message"]
        assert len(message) > 20 and "\n" not in message, answer
        return answer["error"]["kind"]


def near(got, expected, tolerance=1e-9):
    got, expected = np.asarray(got, float), np.asarray(expected, float)
    assert got.shape == expected.shape, (got, expected)
    scale = 1 + np.abs(expected).max(initial=0)
    assert np.abs(got - expected).max(initial=0) <= tolerance * scale, (got, expected)


def anchors3(n):
    angle = 2 * np.pi * (np.arange(n) + rng.uniform(-0.2, 0.2, n)) / n
    radius = rng.uniform(5, 7, n)
    return np.c_[5 + radius * np.cos(angle), 5 + radius * np.sin(angle), rng.uniform(3.5, 6.5, n)]


def anchors2(n):
    corners = np.array([[0, 0.0], [12, 0.0], [12, 5.0], [0, 5.0], [6, 5.5], [6, -0.5], [0, 2.5], [12, 2.5]])
    return corners[:n] + rng.uniform(-0.3, 0.3, (n, 2))


def pose(planar=False):
    return rng.uniform([2, 1], [10, 4]) if planar else np.array([*rng.uniform(3.5, 6.5, 2), rng.uniform(0.2, 2.5)])


def rows(anchors, at):
    d = at - anchors
    return d / np.linalg.norm(d, axis=1)[:, None]


def hold(structure, force, limits):
    """Least norm, least sum and the candidates, by trying every combination of limits."""
    n, m = structure.shape
    low, high = limits[0], math.inf if limits[1] is None else limits[1]
    best, least_sum = None, math.inf
    for places in itertools.product((0, 1, 2), repeat=m):
        if high == math.inf and 1 in places:
            continue
        t = np.array([low if p == 0 else high if p == 1 else 0.0 for p in places])
        free = [i for i, p in enumerate(places) if p == 2]
        if free:
            t[free] = np.linalg.pinv(structure[:, free]) @ (force - structure @ t)
        scale = 1 + np.abs(t).max()
        if np.abs(structure @ t - force).max() > 1e-9 * scale or t.min() < low - 1e-9 * scale or t.max() > high + 1e-9 * scale:
            continue
        least_sum = min(least_sum, t.sum())
        if best is None or t @ t < best @ best:
            best = t
    return best, least_sum


def one_line(structure, force, limits):
    """Particular solution, null vector and interval for one redundant cable."""
    particular = np.linalg.pinv(structure) @ force
    null = np.linalg.svd(structure)[2][-1]
    low, high = limits[0], math.inf if limits[1] is None else limits[1]
    ends = np.sort(np.array([(low - particular) / null, (high - particular) / null]), axis=0)
    return particular, null, ends[0].max(), ends[1].min()


def four(structure, force, limits, method):
    particular, null, a, b = one_line(structure, force, limits)
    if a > b:
        return None
    if method == "least_norm":
        at = min(max(0, a), b)
    elif method == "min_sum":
        c = null.sum()
        at = a if c > 1e-12 else b if c < -1e-12 else min(max(0, a), b)
    else:
        margin = lambda x: min((particular + x * null - limits[0]).min(), (limits[1] - particular - x * null).min())
        for _ in range(200):
            third = (b - a) / 3
            a, b = (a + third, b) if margin(a + third) < margin(b - third) else (a, b - third)
        at = (a + b) / 2
    return particular + at * null


def check_geometry(solve):
    for planar in (False, True):
        n = int(rng.integers(2 if planar else 3, 9))
        anchors, at = (anchors2(n) if planar else anchors3(n)), pose(planar)
        lengths = np.linalg.norm(anchors - at, axis=1)
        near(solve.result("inverse_kinematics", anchors_m=anchors, position_m=at)["lengths_m"], lengths)
        if not planar or n > 2:
            found = solve.result("forward_kinematics", anchors_m=anchors, lengths_m=lengths)
            near(found["position_m"], at, 1e-7)
            assert ("mirror_m" in found) == (n == 3 and not planar) and ("residual_rms_m" in found) == (planar or n > 3)
        found = solve.result("forward_kinematics", anchors_m=anchors, lengths_m=lengths, near_m=at + 0.1)
        near(found["position_m"], at, 1e-7)
        if "mirror_m" in found:
            near(np.linalg.norm(anchors - np.array(found["mirror_m"]), axis=1), lengths, 1e-7)
        j = rows(anchors, at)
        found = solve.result("jacobian", anchors_m=anchors, position_m=at)
        near(found["cable_jacobian"], j)
        near(found["node_jacobian"], np.linalg.pinv(j), 1e-8)
        v, u = rng.normal(size=at.size), rng.normal(size=n)
        near(solve.result("cable_velocity", anchors_m=anchors, position_m=at, velocity_m_s=v)["cable_velocity_m_s"], j @ v)
        got = solve.result("node_velocity", anchors_m=anchors, position_m=at, cable_velocity_m_s=u)["velocity_m_s"]
        near(got, np.linalg.pinv(j) @ u, 1e-8)
        t, mass = rng.uniform(0, 60, n), rng.uniform(0.5, 4)
        got = solve.result("node_acceleration", anchors_m=anchors, position_m=at, tensions_n=t, node_mass_kg=mass, gravity_m_s2=9.81)
        gravity = np.zeros(at.size)
        gravity[-1] = 9.81
        near(got["acceleration_m_s2"], -j.T @ t / mass - gravity)


def over_pulleys(anchors, radii, at):
    """Lengths by the two angles of the tangent, and unit vectors from the touching points."""
    flat = anchors[:, :-1] - at[:-1]
    p, h = np.linalg.norm(flat, axis=1), anchors[:, -1] - at[-1]
    outward = -flat / p[:, None]
    c = np.hypot(p - radii, h)
    angle = np.pi + np.arctan2(h, p - radii) - np.arccos(radii / c)
    touching = anchors + np.c_[outward * (radii * (1 - np.cos(angle)))[:, None], radii * np.sin(angle)]
    return np.sqrt(c**2 - radii**2) + radii * angle, rows(touching, at)


def check_pulleys(solve):
    for planar in (False, True):
        n = int(rng.integers(3, 9))
        anchors, at = (anchors2(n) if planar else anchors3(n)), pose(planar)
        radii = rng.uniform(0.005, 0.1, n) * (rng.uniform(size=n) < 0.8)
        if np.abs(anchors[:, 0] - at[0]).min() < 0.25:
            continue
        common = dict(anchors_m=anchors, pulley_radius_m=radii)
        lengths, j = over_pulleys(anchors, radii, at)
        near(solve.result("inverse_kinematics", position_m=at, **common)["lengths_m"], lengths)
        found = solve.result("forward_kinematics", lengths_m=lengths, near_m=at + 0.05, **common)
        near(found["position_m"], at, 1e-7)
        near(solve.result("jacobian", position_m=at, **common)["cable_jacobian"], j)
        asked = dict(position_m=at, limits_n=[0, None], method="least_norm", node_mass_kg=2.0, **common)
        answer = solve("tensions", **asked)
        if n > at.size and "result" in answer:
            t = np.array(answer["result"]["tensions_n"])
            near(-j.T @ t, np.r_[np.zeros(at.size - 1), 2.0 * 9.80665], 1e-6)


def check_calibration(solve):
    anchors = anchors3(3)
    anchors[:, :2] -= anchors[0, :2]
    turn = math.atan2(anchors[1, 1], anchors[1, 0])
    anchors[:, :2] = anchors[:, :2] @ np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    xy = anchors[:, :2]
    d = lambda i, j: np.linalg.norm(xy[i] - xy[j])
    side = 1 if xy[2, 1] > 0 else -1
    near(solve.result("survey_anchors", ranges_m=[d(0, 2), d(0, 1), d(1, 2)], side=side)["anchors_xy_m"], xy, 1e-8)
    extra = rng.uniform(-3, 9, 2)
    if abs(extra[1]) > 0.5:
        ranges = np.linalg.norm(xy - extra, axis=1)
        near(solve.result("fourth_anchor", anchors_xy_m=xy, ranges_m=ranges)["anchor_xy_m"], extra, 1e-7)
        side = 1 if extra[1] > 0 else -1
        near(solve.result("fourth_anchor", anchors_xy_m=xy, ranges_m=ranges[:2], side=side)["anchor_xy_m"], extra, 1e-7)
    n = int(rng.integers(3, 7))
    anchors = anchors3(n)
    centre = anchors[:, :2].mean(axis=0)
    points = centre + rng.uniform(-2.5, 2.5, (int(rng.integers(4, 12)), 2))
    lengths = np.sqrt(((anchors[:, None, :2] - points) ** 2).sum(axis=2) + anchors[:, None, 2] ** 2)
    if np.linalg.svd(points - points.mean(axis=0))[1][1] > 1.5:
        found = solve.result("calibrate_heights", anchors_xy_m=anchors[:, :2], lengths_m=lengths)
        near(found["heights_m"], anchors[:, 2], 1e-6)
        near(found["points_xy_m"], points, 1e-6)
        assert found["cost_m4"] < 1e-12
        found = solve.result("calibrate_joint", anchors_xy_m=anchors[:, :2], lengths_m=lengths, sigma_length_m=0.005)
        near(found["heights_m"], anchors[:, 2], 1e-6)
        assert found["scale"] == 1 and np.asarray(found["anchor_std_m"]).shape == (n, 3)
        found = solve.result("calibrate_joint", anchors_xy_m=anchors[:, :2], lengths_m=lengths * 1.004, sigma_length_m=1e-4,
                             fit_scale=True, sigma_scale=0.05)
        assert abs(found["scale"] - 1.004) < 2e-3, found["scale"]
        radii = rng.uniform(0.01, 0.08, n)
        over = np.array([over_pulleys(anchors, radii, np.r_[c, 0.0])[0] for c in points]).T
        common = dict(anchors_xy_m=anchors[:, :2], lengths_m=over, pulley_radius_m=radii)
        # A place below a wheel has no tangent.
        if np.linalg.norm(anchors[:, None, :2] - points, axis=2).min() > 0.3:
            near(solve.result("calibrate_heights", **common)["heights_m"], anchors[:, 2], 1e-5)
            near(solve.result("calibrate_joint", sigma_length_m=0.005, **common)["heights_m"], anchors[:, 2], 1e-5)
    floor = np.c_[rng.uniform(0, 10, (3, 2)), np.zeros(3)]
    if abs(np.cross(floor[1] - floor[0], floor[2] - floor[0])[2]) > 4:
        anchor = np.array([*rng.uniform(0, 10, 2), rng.uniform(2, 6)])
        found = solve.result("gps_anchor", points_m=floor, lengths_m=np.linalg.norm(floor - anchor, axis=1))
        near(found["anchor_m"], anchor, 1e-7)


def check_tensions(solve):
    mass, a = rng.uniform(0.5, 4), rng.normal(size=3) * 0.5
    b = mass * (a + [0, 0, 9.81])
    limits = [rng.choice([0.0, 1.0, 2.0]), rng.choice([20.0, 40.0, 150.0])]
    common = dict(node_mass_kg=mass, acceleration_m_s2=a, gravity_m_s2=9.81)
    anchors, at = anchors3(3), pose()
    t = np.linalg.solve(-rows(anchors, at).T, b)
    found = solve.result("tensions", anchors_m=anchors, position_m=at, limits_n=limits, method="unique", **common)
    near(found["tensions_n"], t, 1e-8)
    near([found["sum_n"], found["norm_sq_n2"], found["margin_n"]], [t.sum(), t @ t, min(t.min() - limits[0], limits[1] - t.max())], 1e-8)
    anchors, at = anchors3(4), np.array([*rng.uniform(0, 10, 2), rng.uniform(0.2, 3.2)])
    structure = -rows(anchors, at).T
    for method in ("least_norm", "min_sum", "safest"):
        expected = four(structure, b, limits, method)
        asked = dict(anchors_m=anchors, position_m=at, limits_n=limits, method=method, **common)
        if expected is None:
            assert solve.kind("tensions", **asked) == "infeasible"
            continue
        found = solve.result("tensions", **asked)
        near(found["tensions_n"], expected, 1e-7)
        particular, null, low, high = one_line(structure, b, limits)
        last = sorted([particular[3] + low * null[3], particular[3] + high * null[3]])
        near(found["interval_n"], last, 1e-7)
        near([found["unconstrained_n"], found["c"]], [particular[3], null.sum() / null[3]], 1e-6)
    m = int(rng.integers(5, 7))
    anchors = anchors3(m)
    structure = -rows(anchors, at).T
    check_redundant(solve, structure, b, limits, lambda method: dict(anchors_m=anchors, position_m=at, limits_n=limits, method=method, **common))


def check_redundant(solve, structure, b, limits, asked, op="tensions"):
    best, least_sum = hold(structure, b, limits)
    if best is None:
        kind = solve.kind(op, **asked("least_norm"))
        assert kind == "infeasible", kind
        return
    found = solve.result(op, **asked("least_norm"))
    near(found["tensions_n"], best, 1e-6)
    near(structure @ np.array(found["tensions_n"]), b, 1e-8)
    found = solve.result(op, **asked("min_sum"))
    near(structure @ np.array(found["tensions_n"]), b, 1e-8)
    near(found["sum_n"], least_sum, 1e-7)


def check_distribute(solve):
    # NIMS-AQ, and structure matrices that no robot has.
    anchors, at = anchors2(4), pose(True)
    structure = -rows(anchors, at).T
    limits = [rng.choice([0.0, 2.0, 5.0]), rng.choice([30.0, 80.0])]
    b = rng.choice([0.0, 10.0]) * rng.normal(size=2)
    check_redundant(solve, structure, b, limits, lambda method: dict(structure_matrix=structure, wrench_n=b, limits_n=limits, method=method), "distribute")
    n = int(rng.integers(1, 4))
    m = n + int(rng.integers(0, 4))
    lattice = rng.random() < 0.5
    structure = rng.integers(-2, 3, (n, m)).astype(float) if lattice else rng.normal(size=(n, m))
    limits = [rng.choice([0.0, 1.0]), [None, 5.0, 9.0][rng.integers(3)]]
    b = structure @ rng.uniform(0, 6, m) if rng.random() < 0.7 else rng.normal(size=n) * 6
    smallest = np.linalg.svd(structure)[1].min()
    asked = lambda method: dict(structure_matrix=structure, wrench_n=b, limits_n=limits, method=method)
    if smallest < 1e-9:
        assert solve.kind("distribute", **asked("least_norm")) == "singular"
    elif smallest > 0.05:
        check_redundant(solve, structure, b, limits, asked, "distribute")


def check_control(solve):
    n = int(rng.integers(8, 30))
    desired, actual = rng.normal(size=n), rng.normal(size=n)
    window = int(rng.integers(2, n - 2))
    v = np.c_[desired[-window - 1:], actual[-window - 2:-1]]
    psi = actual[-window - 1:]
    near(solve.result("fit_motor", desired_m_s=desired, actual_m_s=actual, window=window)["phi"], np.linalg.lstsq(v, psi, rcond=None)[0], 1e-7)
    ridge, prior = 0.1, np.array([0.6, 0.4])
    expected = np.linalg.solve(v.T @ v + ridge * np.eye(2), v.T @ psi + ridge * prior)
    near(solve.result("fit_motor", desired_m_s=desired, actual_m_s=actual, window=window, ridge=ridge, prior=prior)["phi"], expected, 1e-8)

    d, delta, ts = int(rng.integers(2, 4)), int(rng.integers(1, 8)), rng.uniform(0.01, 0.2)
    m = int(rng.integers(d, 6))
    b = rng.normal(size=(d, m))
    q0, r0 = rng.normal(size=(d, d)), rng.normal(size=(m, m))
    q, r = q0 @ q0.T, r0 @ r0.T + np.eye(m)
    if rng.random() < 0.5:
        q, r = rng.uniform(0, 9), rng.uniform(0.1, 3)
    q_full, r_full = (np.eye(d) * q, np.eye(m) * r) if np.ndim(q) == 0 else (q, r)
    # All inputs at once: minimise the sum with the end fixed, as one linear system in inputs and multipliers.
    hessian = np.kron(np.eye(delta), r_full)
    gradient = np.zeros((m * delta, d))
    for k in range(1, delta):
        step = np.hstack([-ts * b if j < k else np.zeros((d, m)) for j in range(delta)])
        hessian += step.T @ q_full @ step
        gradient += step.T @ q_full
    end = np.hstack([ts * b] * delta)
    system = np.block([[hessian, end.T], [end, np.zeros((d, d))]])
    expected = np.linalg.solve(system, np.vstack([-gradient, np.eye(d)]))[:m]
    near(solve.result("lq_gain", node_jacobian=b, period_s=ts, state_weight=q, input_weight=r, horizon=delta)["gain"], expected, 1e-6)


MOTORS = [
    dict(force_constant_n_a=40.0, resistance_ohm=1.2, gear_friction=0.85, coulomb_n=3.0, viscous_n_s_m=20.0, transition_m_s=0.02),
    dict(force_constant_n_a=40.0, resistance_ohm=1.2, gear_friction=0.0, coulomb_n=0.0, viscous_n_s_m=0.0, transition_m_s=0.02),
]


def current(motor, t, v):
    s = np.tanh(v / motor["transition_m_s"])
    return (t * (1 + motor["gear_friction"] * s) + motor["coulomb_n"] * s + motor["viscous_n_s_m"] * v) / motor["force_constant_n_a"]


def shape(a, b, mu, u):
    flat = (b - a) * np.array([1, 1, 0]) if a.size == 3 else (b - a) * np.array([1, 0])
    up = np.zeros(a.size)
    up[-1] = 1
    xf = np.linalg.norm(flat)
    zeta = (b[-1] - a[-1]) / xf - mu * xf
    x = np.outer(np.atleast_1d(u) * xf, up) @ up
    return (a + np.outer(np.atleast_1d(u), flat) + np.outer(mu * x**2 + zeta * x, up),
            flat + np.outer(xf * (2 * mu * x + zeta), up), zeta, xf)


def energy(anchors, a, b, mu, mass, speed, motor, method, limits, n):
    u = np.linspace(0, 1, n + 1)
    points, tangents, _, _ = shape(a, b, mu, u)
    force = np.zeros(a.size)
    force[-1] = mass * G
    power = []
    for p, tangent in zip(points, tangents, strict=True):
        j = rows(anchors, p)
        if len(anchors) == 4 and a.size == 3:
            t = four(-j.T, force, limits, method)
        elif len(anchors) == a.size:
            t = np.linalg.solve(-j.T, force)
            t = t if t.min() >= limits[0] and t.max() <= limits[1] else None
        if t is None:
            return None
        length = np.linalg.norm(tangent)
        reel_in = -j @ tangent / length * speed
        power.append(motor["resistance_ohm"] * (current(motor, t, reel_in) ** 2).sum() * length / speed)
    weights = np.array([1, *[4, 2] * ((n - 2) // 2), 4, 1])
    return weights @ power / (3 * n)


def arc(a, b, mu):
    nodes, weights = np.polynomial.legendre.leggauss(60)
    u = (nodes + 1) / 2
    return (np.linalg.norm(shape(a, b, mu, u)[1], axis=1) * weights).sum() / 2


def check_energy(solve):
    motor = MOTORS[rng.integers(2)]
    t, v = rng.uniform(0, 80), rng.uniform(-0.5, 0.5)
    near(solve.result("motor_current", motor=motor, speed_m_s=v, tension_n=t)["current_a"], current(motor, t, v))
    table = dict(speeds_m_s=np.sort(rng.uniform(-1, 1, 5)), tensions_n=np.sort(rng.uniform(0, 90, 4)), currents_a=rng.normal(size=(5, 4)))
    s, w = table["speeds_m_s"], table["tensions_n"]
    v, t = rng.uniform(s[0], s[-1]), rng.uniform(w[0], w[-1])
    expected = np.interp(v, s, [np.interp(t, w, row) for row in table["currents_a"]])
    near(solve.result("motor_current", table=table, speed_m_s=v, tension_n=t)["current_a"], expected)
    assert solve.kind("motor_current", table=table, speed_m_s=s[-1] + 0.01, tension_n=t) == "out_of_range"
    speed, amps, ohm, k = rng.uniform(0, 300), rng.uniform(0, 5), rng.uniform(0.1, 3), rng.uniform(0.01, 0.1)
    got = solve.result("motor_efficiency", speed_rad_s=speed, current_a=amps, resistance_ohm=ohm, torque_constant_nm_a=k)
    near(got["efficiency"], speed / (speed + amps * ohm / k))

    planar = rng.random() < 0.3
    a, b, mu = (pose(planar), pose(planar), rng.uniform(0, 0.3))
    _, _, _, xf = shape(a, b, mu, 0)
    if xf < 0.5:
        return
    u = np.linspace(0, 1, 7)
    points, tangents, zeta, _ = shape(a, b, mu, u)
    found = solve.result("parabola", from_m=a, to_m=b, mu_per_m=mu, u=u)
    near(found["points_m"], points)
    near(found["tangents_m"], tangents)
    near([found["length_m"], found["zeta"]], [arc(a, b, mu), zeta], 1e-8)
    fine = shape(a, b, mu, np.linspace(0, 1, 20001))[0][:, -1].min()
    near(found["lowest_m"], fine, 1e-6)
    ground = min(a[-1], b[-1]) - rng.uniform(0, 1)
    deepest = solve.result("mu_limit", from_m=a, to_m=b, ground_m=ground)["mu_per_m"]
    near(shape(a, b, deepest, np.linspace(0, 1, 20001))[0][:, -1].min(), ground, 1e-5)

    n = int(rng.integers(3, 5))
    anchors = anchors3(n)
    a, b = pose(), pose()
    if np.linalg.norm((a - b)[:2]) < 0.5:
        return
    limits = [0.5, float(rng.choice([25.0, 60.0]))]
    method = "unique" if n == 3 else ["least_norm", "min_sum"][rng.integers(2)]
    asked = dict(anchors_m=anchors, from_m=a, to_m=b, node_mass_kg=1.5, speed_m_s=0.2, motor=motor, method=method,
                 limits_n=limits, gravity_m_s2=G, intervals=16)
    expected = energy(anchors, a, b, mu, 1.5, 0.2, motor, method, limits, 16)
    if expected is None:
        assert solve.kind("move_energy", mu_per_m=mu, **asked) == "infeasible"
    else:
        found = solve.result("move_energy", mu_per_m=mu, **asked)
        near([found["energy_j"], found["duration_s"]], [expected, arc(a, b, mu) / 0.2], 1e-7)
    weight, ground = float(rng.choice([0.0, 1.0])), 0.1
    deepest = solve.result("mu_limit", from_m=a, to_m=b, ground_m=ground)["mu_per_m"]
    scan = []
    for mu in np.linspace(0, deepest, 25):
        cost = energy(anchors, a, b, mu, 1.5, 0.2, motor, method, limits, 16)
        if cost is not None:
            scan.append((cost + weight * arc(a, b, mu) / 0.2, mu))
    answer = solve("optimal_parabola", ground_m=ground, time_weight_w=weight, **asked)
    if not scan:
        assert answer.get("error", {}).get("kind") == "infeasible" or answer["result"]["energy_j"] > 0
        return
    found = answer["result"]
    slack = 5e-3 if method == "min_sum" else 1e-6
    assert found["energy_j"] + weight * found["duration_s"] <= min(scan)[0] * (1 + slack), (found, min(scan))
    assert 0 <= found["mu_per_m"] <= deepest * (1 + 1e-12)
    exact = energy(anchors, a, b, found["mu_per_m"], 1.5, 0.2, motor, method, limits, 16)
    near([found["energy_j"], found["duration_s"]], [exact, arc(a, b, found["mu_per_m"]) / 0.2], 1e-6)
    near(found["line_duration_s"], np.linalg.norm(a - b) / 0.2)
    line = energy(anchors, a, b, 0, 1.5, 0.2, motor, method, limits, 16)
    assert (found["line_energy_j"] is None) == (line is None)
    if line is not None:
        near(found["line_energy_j"], line, 1e-7)


def check_errors(solve):
    three = [[0, 0, 3.0], [9, 0, 3.1], [4, 8, 2.9]]
    square = [[0, 0, 6.0], [10, 0, 6.0], [10, 10, 6.0], [0, 10, 6.0]]
    collinear = [[0, 0, 3.0], [4, 0, 3.0], [9, 0, 3.0]]
    upright = [[0, 0, 1.0], [9, 0, 3.2], [4, 0, 5.0]]
    at = [4, 3, 1.0]
    lengths = np.linalg.norm(np.array(upright) - [4.0, 3.0, 1.0], axis=1)
    hang = dict(anchors_m=square, position_m=[4, 4, 2], node_mass_kg=2, acceleration_m_s2=[0, 0, 0], gravity_m_s2=9.81)
    move = dict(anchors_m=square, from_m=[2.5, 2.5, 4], to_m=[7.5, 2.5, 4], node_mass_kg=2, speed_m_s=0.2, motor=MOTORS[0],
                method="least_norm", limits_n=[1, 150], gravity_m_s2=9.81, intervals=32)
    floor = np.array([[2, 2], [6, 3], [4, 6], [3, 3.5], [5, 3]])
    xy = np.array(three)[:, :2]
    up = np.sqrt(((xy[:, None] - floor) ** 2).sum(axis=2) + 9)
    flat = np.sqrt(((xy[:, None] - floor[:1] * [[1, 1], [2, 2], [1.5, 1.5]]) ** 2).sum(axis=2) + 9)
    low = np.sqrt(((xy[:, None] - floor) ** 2).sum(axis=2))
    low[0] *= 0.8
    cases = [
        ("invalid_argument", "survey_anchors", dict(ranges_m=[9, -1, 9])),
        ("invalid_argument", "survey_anchors", dict(ranges_m=[9, 9])),
        ("invalid_argument", "survey_anchors", dict(ranges_m=[9, 9, 9], side=2)),
        ("degenerate_geometry", "survey_anchors", dict(ranges_m=[1, 9, 2])),
        ("degenerate_geometry", "survey_anchors", dict(ranges_m=[4, 9, 5])),
        ("degenerate_geometry", "survey_anchors", dict(ranges_m=[0, 9, 9])),
        ("invalid_argument", "fourth_anchor", dict(anchors_xy_m=xy, ranges_m=[5, 6])),
        ("invalid_argument", "fourth_anchor", dict(anchors_xy_m=xy[:2], ranges_m=[5, 6], side=1)),
        ("degenerate_geometry", "fourth_anchor", dict(anchors_xy_m=xy, ranges_m=[1, 2], side=1)),
        ("invalid_argument", "inverse_kinematics", dict(anchors_m=three, position_m=[1, 2])),
        ("invalid_argument", "inverse_kinematics", dict(anchors_m=three, position_m=[1, 2, float("nan")])),
        ("invalid_argument", "inverse_kinematics", dict(anchors_m=three)),
        ("invalid_argument", "inverse_kinematics", dict(anchors_m=[[0, 0, 3], [1, 1]], position_m=at)),
        ("invalid_argument", "forward_kinematics", dict(anchors_m=three, lengths_m=[5, 5])),
        ("invalid_argument", "forward_kinematics", dict(anchors_m=three, lengths_m=[5, -5, 5])),
        ("invalid_argument", "forward_kinematics", dict(anchors_m=three[:2], lengths_m=[5, 5])),
        ("unreachable", "forward_kinematics", dict(anchors_m=three, lengths_m=[1, 1, 1])),
        ("degenerate_geometry", "forward_kinematics", dict(anchors_m=collinear, lengths_m=[5, 5, 6])),
        ("degenerate_geometry", "forward_kinematics", dict(anchors_m=[three[0], three[0], three[2]], lengths_m=[5, 5, 6])),
        ("ambiguous", "forward_kinematics", dict(anchors_m=upright, lengths_m=lengths)),
        ("singular", "jacobian", dict(anchors_m=square, position_m=[4, 4, 6])),
        ("singular", "jacobian", dict(anchors_m=three, position_m=three[1])),
        ("singular", "node_velocity", dict(anchors_m=collinear, position_m=at, cable_velocity_m_s=[1, 1, 1])),
        ("singular", "cable_velocity", dict(anchors_m=three, position_m=three[1], velocity_m_s=[1, 0, 0])),
        ("rank_deficient", "calibrate_heights", dict(anchors_xy_m=xy, lengths_m=flat)),
        ("rank_deficient", "calibrate_heights", dict(anchors_xy_m=xy, lengths_m=up[:, :2])),
        ("no_real_height", "calibrate_heights", dict(anchors_xy_m=xy, lengths_m=low)),
        ("degenerate_geometry", "calibrate_heights", dict(anchors_xy_m=[[0, 0], [1, 0], [2, 0]], lengths_m=up)),
        ("invalid_argument", "calibrate_heights", dict(anchors_xy_m=xy, lengths_m=up[:2])),
        ("invalid_argument", "calibrate_joint", dict(anchors_xy_m=xy, lengths_m=up, sigma_length_m=0)),
        ("invalid_argument", "calibrate_joint", dict(anchors_xy_m=xy, lengths_m=up, sigma_length_m=0.01, loss="least")),
        ("invalid_argument", "calibrate_joint", dict(anchors_xy_m=xy, lengths_m=up, sigma_length_m=0.01, fit_scale=True)),
        ("degenerate_geometry", "gps_anchor", dict(points_m=[[0, 0, 0], [1, 0, 0], [2, 0, 0]], lengths_m=[4, 4, 4])),
        ("unreachable", "gps_anchor", dict(points_m=[[0, 0, 0], [9, 0, 0], [0, 9, 0]], lengths_m=[1, 1, 1])),
        ("invalid_argument", "gps_anchor", dict(points_m=[[0, 0, 0], [9, 0, 0]], lengths_m=[1, 1])),
        ("infeasible", "tensions", dict(limits_n=[1, 5], method="least_norm", **hang)),
        ("infeasible", "tensions", {**hang, "limits_n": [1, 150], "method": "safest", "position_m": [14, 4, 2]}),
        ("singular", "tensions", {**hang, "limits_n": [1, 150], "method": "min_sum", "position_m": [4, 4, 6]}),
        ("invalid_argument", "tensions", dict(limits_n=[5, 1], method="least_norm", **hang)),
        ("invalid_argument", "tensions", dict(limits_n=[1, 150], method="unique", **hang)),
        ("invalid_argument", "tensions", dict(limits_n=[1, 150], method="best", **hang)),
        ("invalid_argument", "tensions", dict(limits_n=[-1, 150], method="least_norm", **hang)),
        ("invalid_argument", "tensions", dict(method="least_norm", **hang)),
        ("invalid_argument", "distribute", dict(structure_matrix=[[1], [1]], wrench_n=[1, 1], limits_n=[0, 9])),
        ("invalid_argument", "distribute", dict(structure_matrix=[[1, 1]], wrench_n=[1, 1], limits_n=[0, 9])),
        ("singular", "distribute", dict(structure_matrix=[[1, 1, 2], [2, 2, 4]], wrench_n=[1, 1], limits_n=[0, 9])),
        ("infeasible", "distribute", dict(structure_matrix=[[1, 1]], wrench_n=[-1], limits_n=[0, 9])),
        ("invalid_argument", "node_acceleration", dict(anchors_m=three, position_m=at, tensions_n=[1, 2, 3], node_mass_kg=0, gravity_m_s2=9.81)),
        ("insufficient_data", "fit_motor", dict(desired_m_s=[1, 2, 3], actual_m_s=[1, 2, 3], window=5)),
        ("rank_deficient", "fit_motor", dict(desired_m_s=[1.0] * 9, actual_m_s=[1.0] * 9, window=5)),
        ("rank_deficient", "fit_motor", dict(desired_m_s=[0.0] * 9, actual_m_s=[0.0] * 9, window=5)),
        ("invalid_argument", "fit_motor", dict(desired_m_s=[1.0] * 9, actual_m_s=[1.0] * 8, window=5)),
        ("invalid_argument", "lq_gain", dict(node_jacobian=np.eye(3), period_s=0, state_weight=1, input_weight=1, horizon=3)),
        ("invalid_argument", "lq_gain", dict(node_jacobian=np.eye(3), period_s=0.1, state_weight=1, input_weight=0, horizon=3)),
        ("invalid_argument", "lq_gain", dict(node_jacobian=np.eye(3), period_s=0.1, state_weight=1, input_weight=1, horizon=0)),
        ("singular", "lq_gain", dict(node_jacobian=[[1, 1, 1], [1, 1, 1], [0, 0, 1]], period_s=0.1, state_weight=1, input_weight=1, horizon=3)),
        ("out_of_range", "motor_current", dict(table=dict(speeds_m_s=[-1, 1], tensions_n=[0, 9], currents_a=[[0, 1], [0, 1]]), speed_m_s=0, tension_n=10)),
        ("invalid_argument", "motor_current", dict(table=dict(speeds_m_s=[1, -1], tensions_n=[0, 9], currents_a=[[0, 1], [0, 1]]), speed_m_s=0, tension_n=1)),
        ("invalid_argument", "motor_current", dict(motor={**MOTORS[0], "force_constant_n_a": 0}, speed_m_s=0, tension_n=1)),
        ("invalid_argument", "motor_current", dict(speed_m_s=0, tension_n=1)),
        ("invalid_argument", "motor_efficiency", dict(speed_rad_s=1, current_a=1, resistance_ohm=1, torque_constant_nm_a=0)),
        ("degenerate_geometry", "parabola", dict(from_m=at, to_m=at, mu_per_m=0.1, u=[0.5])),
        ("invalid_argument", "parabola", dict(from_m=at, to_m=[5, 5, 1], mu_per_m=0.1, u=[1.5])),
        ("invalid_argument", "mu_limit", dict(from_m=at, to_m=[5, 5, 1], ground_m=2)),
        ("infeasible", "move_energy", {**move, "mu_per_m": 0.1, "limits_n": [1, 8]}),
        ("invalid_argument", "move_energy", {**move, "mu_per_m": 0.1, "intervals": 31}),
        ("invalid_argument", "move_energy", {**move, "mu_per_m": 0.1, "speed_m_s": 0}),
        ("singular", "move_energy", {**move, "mu_per_m": 0.0, "from_m": [2, 2, 6], "to_m": [7, 7, 6]}),
        ("infeasible", "optimal_parabola", {**move, "ground_m": 0, "time_weight_w": 0, "limits_n": [1, 8]}),
        ("invalid_argument", "optimal_parabola", {**move, "ground_m": 0, "time_weight_w": -1}),
    ]
    for expected, op, arguments in cases:
        kind = solve.kind(op, **arguments)
        assert kind == expected, (op, arguments, kind, expected)
    # Vertical moves are lines.
    found = solve.result("optimal_parabola", **{**move, "to_m": [2.5, 2.5, 2], "ground_m": 0, "time_weight_w": 0})
    assert found["mu_per_m"] == 0 and found["energy_j"] == found["line_energy_j"]
    assert solve.result("parabola", from_m=at, to_m=[4, 3, 3], mu_per_m=1, u=[0.5])["points_m"] == [[4, 3, 2]]


def main():
    solve = Solver(sys.argv[1])
    cases = int(sys.argv[2]) if len(sys.argv) > 2 else 100
    failed = False
    checks = [check_geometry, check_pulleys, check_calibration, check_tensions, check_distribute, check_control, check_energy, functools.partial(check_fits, rng)]
    name = lambda check: getattr(check, "func", check).__name__
    for check, count in [*((check, cases) for check in checks), (check_errors, 1)]:
        before = solve.count
        wrong = []
        for _ in range(count):
            try:
                check(solve)
            except AssertionError as error:
                wrong.append(str(error))
        print(f"{name(check)}: {solve.count - before} requests, {len(wrong)} wrong")
        for text in wrong[:3]:
            print("  " + text[:1500])
        failed |= bool(wrong)
    solve.process.stdin.close()
    sys.exit(1 if failed or solve.process.wait() != 0 else 0)


if __name__ == "__main__":
    main()
