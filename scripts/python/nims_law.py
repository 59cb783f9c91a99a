"""A control law in Python, without packages: for `nims sim`, and for a robot with `controller --program`.

    import nims_law

    def law(asked):
        if asked.desired_velocities_m_s is None:
            return None
        errors = [wanted - is_ for wanted, is_ in zip(asked.desired_lengths_m, asked.lengths_m, strict=True)]
        return [speed + 1.5 * error for speed, error in zip(asked.desired_velocities_m_s, errors, strict=True)]

    nims_law.run(law)

`nims sim SYSTEM.toml --program "python3 my_law.py"` flies with it in lockstep. The law is called once per control cycle
and returns the velocity of each cable in m/s (above 0 pays out), or None for no answer; so is one that is not finite.

`asked` has: slot, cycle, period_s, horizon_s; position_m, velocity_m_s, covariance_m2 (row by row), lengths_m and
tensions_n of the estimate; desired_lengths_m and desired_velocities_m_s of the unstretched cables (None where the
cables cannot hold the node at the setpoint); the setpoints now and ahead (position_m, velocity_m_s, acceleration_m_s2,
segment_id, path_s_m, at_rest), and now_held and ahead_held (unstretched_m, lengths_m, tensions_n, or None).
"""

import json
import math
import re
import sys
from collections.abc import Mapping, Sequence
from types import SimpleNamespace


def run(law, **parameters):
    """Answers until the flight ends. The parameters are recorded in the run file: texts, numbers, truth values, and lists
    and dictionaries of them.
    """

    def velocities(asked):
        answer = law(asked)
        plain = None if answer is None else [float(velocity) for velocity in answer]
        # JSON has no other numbers, and a velocity that is none of them is no answer.
        return plain if plain is not None and all(map(math.isfinite, plain)) else None

    answer(velocities, parameters)


def answer(function, parameters):
    """Answers each line with what the function makes of it."""
    text = "".join(f"{_key(key)} = {_toml(key, value)}\n" for key, value in parameters.items())
    _system = json.loads(sys.stdin.readline() or "null")
    _say({"parameters": text})
    for line in sys.stdin:
        _say(function(json.loads(line, object_hook=lambda fields: SimpleNamespace(**fields))))


def _toml(name, value):
    """A parameter as a value of TOML; `name` is its name in an error."""
    # A number or an array of NumPy has its values as those of Python.
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) or isinstance(value, int) and -(2**63) <= value < 2**63:
        return repr(value)
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(key)} = {_toml(f'{name}.{key}', inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_toml(f"{name}[{number}]", inner) for number, inner in enumerate(value)) + "]"
    raise TypeError(
        f"the parameter {name} is {value!r}; accepted: texts, numbers of 64 bits, truth values, and lists and dictionaries of them"
    )


def _key(name):
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", str(name)) else _text(str(name))


def _text(text):
    """A text of TOML: that of JSON, except that TOML has no pairs of surrogates and no bare DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _say(value):
    json.dump(value, sys.stdout)
    sys.stdout.write("\n")
    sys.stdout.flush()
