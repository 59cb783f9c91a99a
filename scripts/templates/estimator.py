#!/usr/bin/env python3
"""An estimator for `nims sim` and for a robot: change the function. Needs nims_estimator.py and nims_law.py beside it or
in PYTHONPATH. As it is, it is an alpha-beta filter, the same as in the folder estimator."""

import nims_estimator

ALPHA = 0.5
BETA = ALPHA * ALPHA / (2.0 - ALPHA)
# A longer silence is not bridged: three cycles, at more than 250 Hz as many as last as long as three at 250 Hz.
BRIDGED_CYCLES = 3
BRIDGED_S = 0.012

# Of each cable that was read: length (m), velocity (m/s), time (ns) and cycle of the newest reading.
states = {}
# Cables whose next reading may differ by any amount: the question says so once, and a cable may have no reading then.
anything = set()


def estimate(asked):
    """Length and velocity dL/dt (above 0 pays out) of each cable at the instant, or None."""
    if asked.forget:
        states.clear()
    if asked.expect_anything:
        anything.update(range(len(asked.lengths_m)))
    return [cable(asked, i) for i in range(len(asked.lengths_m))]


def bridges(asked, cycle):
    """Whether the time since a reading of this cycle is bridged."""
    # A nims before this field does not send it.
    period_s = getattr(asked, "period_s", 0.0)
    most = max(BRIDGED_CYCLES, int(BRIDGED_S / period_s + 0.5)) if period_s > 0.0 else BRIDGED_CYCLES
    return 0 <= asked.cycle - cycle <= most


def cable(asked, i):
    length_m, sampled_ns = asked.lengths_m[i], asked.sampled_ns[i]
    if length_m is not None:
        velocity_m_s = 0.0
        # After a long silence, or where the lengths were set again, it begins at rest with the reading.
        last = None if i in anything else states.get(i)
        anything.discard(i)
        passed_ns = sampled_ns - last[2] if last else 0
        if passed_ns > 0 and bridges(asked, last[3]):
            passed_s = passed_ns * 1e-9
            expected_m = last[0] + last[1] * passed_s
            difference_m = length_m - expected_m
            length_m = expected_m + ALPHA * difference_m
            velocity_m_s = last[1] + BETA * difference_m / passed_s
        states[i] = (length_m, velocity_m_s, sampled_ns, asked.cycle)
    if i not in states:
        return None
    length_m, velocity_m_s, _, _ = states[i]
    moved_m = velocity_m_s * asked.ahead_s[i]
    return {
        "length_m": length_m + moved_m,
        "velocity_m_s": velocity_m_s,
        # The velocity of the filter is smooth enough for that of the node.
        "steady_velocity_m_s": velocity_m_s,
        # Assumed: half of the extrapolation.
        "sigma_m": 0.5 * abs(moved_m),
    }


nims_estimator.run(estimate, alpha=ALPHA, beta=BETA)
