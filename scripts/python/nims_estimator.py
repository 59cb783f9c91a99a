"""An estimator in Python, without packages: for `nims sim`, and for a robot with `estimator --program`.

    import nims_estimator

    def estimate(asked):
        return [
            None if length_m is None else {"length_m": length_m, "velocity_m_s": command_m_s}
            for length_m, command_m_s in zip(asked.lengths_m, asked.commands_m_s, strict=True)
        ]

    nims_estimator.run(estimate)

`nims sim SYSTEM.toml --estimator-program "python3 my_estimator.py"` flies with it in lockstep. The function is called
once per control cycle, and returns for each cable what it estimates at the instant, or None.

`asked` has: cycle; period_s, that of the cycles (0 if it is unknown); instant_ns, the instant that is asked for; for
each cable lengths_m (unstretched, from the encoder; None where this cycle has no reading), sampled_ns (when it was
read), ahead_s (from the newest reading to the instant; None before the first one), commands_m_s (in effect in this
cycle, above 0 pays out); forget (all earlier readings are invalid); expect_anything (true once: the operator may have
set the lengths, so the next reading of each cable, in this cycle or later, is correct also where it does not fit).

An estimate has length_m and velocity_m_s, and may have steady_velocity_m_s (for the velocity of the node; default:
motor-io's mean over 50 ms), sigma_m (standard deviation in addition to that of a reading) and phi (the motor model).
Position of the node, tensions and covariance follow from the lengths, as for every estimator.
"""

import math

import nims_law


def run(estimate, **parameters):
    """Answers until the flight ends. The parameters are recorded in the run file."""

    def cables(asked):
        estimates = estimate(asked)
        return None if estimates is None else [_plain(one) for one in estimates]

    nims_law.answer(cables, parameters)


def _plain(estimate):
    """An estimate in numbers of Python; None where one is not finite: JSON has no such numbers."""
    if estimate is None:
        return None
    given = {name: value for name, value in estimate.items() if value is not None}
    phi = [float(number) for number in given.pop("phi", (0.0, 0.0))]
    plain = {name: float(value) for name, value in given.items()}
    return {**plain, "phi": phi} if all(map(math.isfinite, [*plain.values(), *phi])) else None
