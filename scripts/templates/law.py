#!/usr/bin/env python3
"""A control law for `nims sim`: change the function. Needs nims_law.py beside it or in PYTHONPATH."""

import nims_law

GAIN_PER_S = 1.5


def law(asked):
    """Desired velocity plus a share of the length error; returns dL/dt of each cable, m/s, above 0 pays out."""
    if asked.desired_velocities_m_s is None:
        return None
    errors = [wanted - measured for wanted, measured in zip(asked.desired_lengths_m, asked.lengths_m, strict=True)]
    return [speed + GAIN_PER_S * error for speed, error in zip(asked.desired_velocities_m_s, errors, strict=True)]


nims_law.run(law, gain_per_s=GAIN_PER_S)
