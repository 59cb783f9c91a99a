"""A control law in Python, without packages: for `nims sim`, and for a robot with `controller --program`.

    import nims_law

    def law(asked):
        if asked.desired_velocities_m_s is None:
            return None
        errors = [wanted - is_ for wanted, is_ in zip(asked.desired_lengths_m, asked.lengths_m, strict=True)]
        return [speed + 1.5 * error for speed, error in zip(asked.desired_velocities_m_s, errors, strict=True)]

    nims_law.run(law)

`nims sim SYSTEM.toml --program "python3 my_law.py"` flies with it in lockstep. The law is called once per control cycle
and returns the velocity of each cable in m/s (above 0 pays out), or None for no answer.

`asked` has: slot, cycle, period_s, horizon_s; position_m, velocity_m_s, covariance_m2 (row by row), lengths_m and
tensions_n of the estimate; desired_lengths_m and desired_velocities_m_s of the unstretched cables (None where the
cables cannot hold the node at the setpoint); the setpoints now and ahead (position_m, velocity_m_s, acceleration_m_s2,
segment_id, path_s_m, at_rest), and now_held and ahead_held (unstretched_m, lengths_m, tensions_n, or None).
"""

import json
import sys
from types import SimpleNamespace


def run(law, **parameters):
    """Answers until the flight ends. The parameters are recorded in the run file."""

    def velocities(asked):
        answer = law(asked)
        return None if answer is None else [float(velocity) for velocity in answer]

    answer(velocities, parameters)


def answer(function, parameters):
    """Answers each line with what the function makes of it."""
    _system = json.loads(sys.stdin.readline() or "null")
    _say({"parameters": "".join(f"{key} = {json.dumps(value)}\n" for key, value in parameters.items())})
    for line in sys.stdin:
        _say(function(json.loads(line, object_hook=lambda fields: SimpleNamespace(**fields))))


def _say(value):
    json.dump(value, sys.stdout)
    sys.stdout.write("\n")
    sys.stdout.flush()
