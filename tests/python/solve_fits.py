"""What `nims solve` fits to data with errors: that nothing near it, and nothing that a search from elsewhere finds, fits better."""

import math

import numpy as np

# Of the losses, for 95 % efficiency with normal errors.
HUBER, CAUCHY = 1.345, 2.3849
LOSSES = {
    "squared": lambda r: 0.5 * r**2,
    "huber": lambda r: np.where(np.abs(r) <= HUBER, 0.5 * r**2, HUBER * (np.abs(r) - 0.5 * HUBER)),
    "cauchy": lambda r: 0.5 * CAUCHY**2 * np.log1p((r / CAUCHY) ** 2),
}


def frame(rng, n):
    """Anchors around a circle of about 5.5 m, the first at the origin and the second on the x axis."""
    angle = 2 * np.pi * (np.arange(n) + rng.uniform(-0.2, 0.2, n)) / n
    xy = np.c_[5.5 * np.cos(angle), 5.5 * np.sin(angle)]
    xy -= xy[0]
    turn = math.atan2(xy[1, 1], xy[1, 0])
    xy = xy @ np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    xy[1, 1] = 0
    return xy


def within(rng, xy, count):
    mean = xy.mean(axis=0)
    return np.array([mean + 0.9 * (rng.dirichlet(np.full(len(xy), 0.6)) @ xy - mean) for _ in range(count)])


def exact(xy, heights, points):
    return np.sqrt(((xy[:, None] - points) ** 2).sum(axis=2) + heights[:, None] ** 2)


def check_heights(rng, solve):
    """The cost (4) is quartic in the heights: searched for its minimum from several places by its own derivatives."""
    n, count = int(rng.integers(3, 7)), int(rng.integers(8, 15))
    xy = frame(rng, n)
    heights, points = rng.uniform(2.9, 3.6, n), within(rng, xy, count)
    lengths = exact(xy, heights, points) + rng.choice([0.002, 0.01, 0.03]) * rng.normal(size=(n, count))
    centred = xy - xy.mean(axis=0)
    guess = np.linalg.pinv(centred)

    def residual(w):
        c = -0.5 * guess @ (lengths**2 - (centred**2).sum(axis=1)[:, None] - w[:, None])
        return (lengths**2 - ((centred[:, :, None] - c) ** 2).sum(axis=1) - w[:, None]).ravel()

    best = None
    for start in range(4):
        w = np.full(n, 9.0) if start == 0 else rng.uniform(1, 25, n)
        damping, r = 1e-3, residual(w)
        for _ in range(200):
            step = 1e-3 * (1 + np.abs(w))
            # r is quadratic in w, so the central difference is exact.
            j = np.array([(residual(w + e) - residual(w - e)) / (2 * h) for h, e in zip(step, np.diag(step), strict=True)]).T
            move = np.linalg.lstsq(np.r_[j, math.sqrt(damping) * np.eye(n)], np.r_[-r, np.zeros(n)], rcond=None)[0]
            tried = residual(w + move)
            if tried @ tried <= r @ r:
                w, r, damping = w + move, tried, max(damping / 10, 1e-14)
                if np.abs(move).max() < 1e-12:
                    break
            else:
                damping *= 10
        best = (r @ r, w) if best is None or r @ r < best[0] else best
    answer = solve("calibrate_heights", anchors_xy_m=xy, lengths_m=lengths)
    if (best[1] < 0).any():
        assert answer["error"]["kind"] == "no_real_height", (answer, best)
        return
    found = answer["result"]
    assert abs(found["cost_m4"] - best[0]) < 1e-7 * (1e-6 + best[0]), (found, best)
    assert np.abs(np.array(found["heights_m"]) - np.sqrt(best[1])).max() < 1e-5, (found, best)


def check_joint(rng, solve):
    """At the answer the cost has no slope, measured in standard deviations of every unknown, with every choice of model and loss."""
    n, count = int(rng.integers(3, 5)), int(rng.integers(6, 15))
    xy = frame(rng, n)
    heights, points = rng.uniform(2.9, 3.6, n), within(rng, xy, count)
    sigma, loss = rng.choice([0.002, 0.005, 0.02]), str(rng.choice(list(LOSSES)))
    ranges, scale, offsets = (bool(b) for b in rng.random(3) < [0.6, 0.4, 0.3])
    true_scale = 1 + 0.01 * rng.normal() if scale else 1
    true_offsets = 0.03 * rng.normal(size=n) if offsets else np.zeros(n)
    lengths = true_scale * exact(xy, heights, points) + true_offsets[:, None] + sigma * rng.normal(size=(n, count))
    if loss != "squared":
        lengths[rng.integers(n), rng.integers(count)] += 0.3
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n)]
    between = lambda at: np.array([np.linalg.norm(at[i] - at[j]) for i, j in pairs])
    measured = between(xy) + 0.01 * rng.normal(size=len(pairs))
    given = xy + 0.02 * rng.normal(size=xy.shape) if ranges else xy
    asked = dict(anchors_xy_m=given, lengths_m=lengths, sigma_length_m=sigma, loss=loss)
    if ranges:
        asked |= dict(ranges_m=measured, range_pairs=[[i + 1, j + 1] for i, j in pairs], sigma_range_m=0.01)
    if scale:
        asked |= dict(fit_scale=True, sigma_scale=0.02)
    if offsets:
        asked |= dict(fit_offsets=True, sigma_offset_m=0.05)
    found = solve.result("calibrate_joint", **asked)
    anchors = np.array(found["anchors_xy_m"])
    free = [anchors[1, 0], *anchors[2:].ravel()] if ranges else []
    at = np.array([*found["heights_m"], *free, *([found["scale"]] if scale else []),
                   *(found["offsets_m"] if offsets else []), *np.ravel(found["points_xy_m"])])

    def parts(x):
        z, x = x[:n], x[n:]
        place = given.copy()
        if ranges:
            place = np.zeros((n, 2))
            place[1, 0], place[2:], x = x[0], x[1 : 2 * n - 3].reshape(-1, 2), x[2 * n - 3 :]
        k, x = (x[0], x[1:]) if scale else (1.0, x)
        o, x = (x[:n], x[n:]) if offsets else (np.zeros(n), x)
        lines = ((k * exact(place, z, x.reshape(-1, 2)) + o[:, None] - lengths) / sigma).ravel()
        known = [(between(place) - measured) / 0.01] * ranges + [[(k - 1) / 0.02]] * scale + [o / 0.05] * offsets
        return lines, np.concatenate(known) if known else np.zeros(0)

    def cost(x):
        lines, known = parts(x)
        return LOSSES[loss](lines).sum() + 0.5 * (known**2).sum()

    steps = 1e-6 * np.eye(at.size)
    slope = np.array([(cost(at + e) - cost(at - e)) / 2e-6 for e in steps])
    jacobian = np.array([(np.concatenate(parts(at + e)) - np.concatenate(parts(at - e))) / 2e-6 for e in steps]).T
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    std = np.sqrt(np.diag(covariance))
    assert np.abs(covariance @ slope / std).max() < 2e-3, (asked, np.abs(covariance @ slope / std).max())
    if loss == "squared":
        assert np.abs(np.array(found["anchor_std_m"])[:, 2] / std[:n] - 1).max() < 1e-3, (found["anchor_std_m"], std)


def check_position(rng, solve):
    """Four and more lines that disagree: Newton's steps from the true place end where the answer is."""
    n = int(rng.integers(4, 9))
    angle = 2 * np.pi * (np.arange(n) + rng.uniform(-0.2, 0.2, n)) / n
    anchors = np.c_[5 + 6 * np.cos(angle), 5 + 6 * np.sin(angle), 5 + 0.5 * rng.uniform(-1, 1, n)]
    at = np.array([*rng.uniform(3, 7, 2), rng.uniform(0.2, 2.5)])
    lengths = np.linalg.norm(anchors - at, axis=1) + rng.choice([0.001, 0.01]) * rng.normal(size=n)
    for _ in range(50):
        away = at - anchors
        distance = np.linalg.norm(away, axis=1)
        at = at - np.linalg.lstsq(away / distance[:, None], distance - lengths, rcond=None)[0]
    found = solve.result("forward_kinematics", anchors_m=anchors, lengths_m=lengths)
    assert np.linalg.norm(at - found["position_m"]) < 1e-7, (found, at)
    rms = math.sqrt(((np.linalg.norm(anchors - at, axis=1) - lengths) ** 2).mean())
    assert abs(found["residual_rms_m"] - rms) < 1e-9, (found, rms)


def check_fits(rng, solve):
    check_heights(rng, solve)
    check_joint(rng, solve)
    check_position(rng, solve)
