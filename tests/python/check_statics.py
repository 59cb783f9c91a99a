"""Compares where the plant hangs with exact elastic catenaries over wheels, in numpy.

usage: check_statics.py FILE

Each line of FILE is one node at rest: the robot, the unstretched cables, and the plant's position and tensions. This
program solves the position again from the unstretched cables alone. It shares no formula with the plant: free cables are
elastic catenaries (Irvine, "Cable Structures", 1981, section 1.4) that leave the rim of their wheel along its tangent,
and wheel and routed part stretch under the tension at the top. The plant has straight cables whose parabolic bow and
half weights are added.

It also compares the tension of the routed part, to which the plant adds the weight of the cable times half of its
height, with the tension at the top of the catenary, as a share of what the cable's weight adds there.

Prints the largest differences per robot; exits 1 if one exceeds its tolerance.
"""

import json
import sys
from collections import defaultdict

import numpy as np

TOLERANCE_MM = {"10 m": 0.1, "30 x 20 m": 0.1, "80 x 20 m": 0.1}

# Of the routed part, as a share of what the weight of a cable adds to its tension. Without that part it is 1. A cable
# of 10 m adds 1 mN, of which the difference of the positions alone makes a tenth.
TOLERANCE_ROUTED = 0.2


class Cable:
    """One cable from its anchor to the node, for the forces (pull, lift) on the node: towards the anchor, and up."""

    def __init__(self, case, i):
        self.anchor = np.array(case["anchors_m"][i])
        self.radius = case["radius_m"]
        self.total = case["unstretched_m"][i] + case["routed_m"][i]
        self.routed = case["routed_m"][i]
        self.ea = case["stiffness_n"]
        # Without weight the catenary has no formula; this much moves no node by a micrometre.
        self.weight = max(case["mass_kg_m"] * case["gravity_m_s2"], 1e-5)

    def hanging(self, pull, lift):
        """Unstretched cable beyond the wheel, m, and the angle on its rim, for the forces on the node."""
        free = self.total - self.routed
        for _ in range(12):
            top = np.hypot(pull, lift + self.weight * free)
            # The angle on the rim: the cable leaves outward (sin a) and up (cos a).
            wrapped = np.arctan2(pull, -(lift + self.weight * free)) if self.radius > 0 else 0.0
            free = self.total - (self.routed + self.radius * wrapped) / (1 + top / self.ea)
        return free, wrapped

    def misfit(self, node, pull, lift):
        """Horizontal and vertical distance by which the cable misses the point where it leaves the wheel, m."""
        w, ea = self.weight, self.ea
        free, wrapped = self.hanging(pull, lift)
        above = lift + w * free
        across = pull * free / ea + pull / w * (np.arcsinh(above / pull) - np.arcsinh(lift / pull))
        rise = (lift * free + w * free**2 / 2) / ea + (np.hypot(pull, above) - np.hypot(pull, lift)) / w
        beside = np.hypot(*(node - self.anchor)[:2])
        reach = beside - self.radius * (1 - np.cos(wrapped))
        height = self.anchor[2] + self.radius * np.sin(wrapped) - node[2]
        return across - reach, rise - height

    def force(self, node, pull, lift):
        towards = (self.anchor - node)[:2] / np.hypot(*(self.anchor - node)[:2])
        return np.array([*(pull * towards), lift])

    def tensions(self, pull, lift):
        """Tension at the wheel, and that in the middle of the cable, N."""
        free, _ = self.hanging(pull, lift)
        return np.hypot(pull, lift + self.weight * free), np.hypot(pull, lift + self.weight * free / 2)


def out_of_balance(case, cables, unknown):
    """Misfits of all cables, m, and the force on the node in units that make it comparable."""
    node, forces = unknown[:3], unknown[3:].reshape(-1, 2)
    misfits = [cable.misfit(node, *force) for cable, force in zip(cables, forces, strict=True)]
    total = sum(cable.force(node, *force) for cable, force in zip(cables, forces, strict=True))
    total[2] -= case["node_mass_kg"] * case["gravity_m_s2"]
    return np.concatenate([np.ravel(misfits), total / 100])


def hang(case):
    """Position and forces, by damped Newton steps with numerical derivatives from a point 30 cm beside."""
    cables = [Cable(case, i) for i in range(len(case["anchors_m"]))]
    start = np.array(case["position_m"]) + [0.2, -0.1, -0.2]
    units = np.array([(c.anchor - start) / np.linalg.norm(c.anchor - start) for c in cables])
    tensions = np.linalg.lstsq(units.T, [0, 0, case["node_mass_kg"] * case["gravity_m_s2"]], rcond=None)[0]
    forces = [[max(t, 5.0) * np.hypot(*u[:2]), max(t, 5.0) * u[2]] for t, u in zip(tensions, units, strict=True)]
    x = np.concatenate([start, np.ravel(forces)])
    off = out_of_balance(case, cables, x)
    for _ in range(300):
        steps = np.where(np.arange(x.size) < 3, 1e-6, 1e-6 * np.maximum(np.abs(x), 1.0))
        columns = []
        for k, h in enumerate(steps):
            up, down = x.copy(), x.copy()
            up[k] += h
            down[k] -= h
            columns.append((out_of_balance(case, cables, up) - out_of_balance(case, cables, down)) / (2 * h))
        step = np.linalg.solve(np.array(columns).T, off)
        share = 1.0
        while share > 1e-6:
            there = x - share * step
            # Every cable pulls.
            if np.all(there[3::2] > 0):
                then = out_of_balance(case, cables, there)
                if np.linalg.norm(then) < np.linalg.norm(off) or np.linalg.norm(off) < 1e-9:
                    break
            share /= 2
        x, off = there, then
        if np.linalg.norm(share * step[:3]) < 1e-10:
            break
    assert np.linalg.norm(off) < 1e-7, (case["robot"], off)
    return x


def main():
    worst = defaultdict(float)
    tension = defaultdict(float)
    routed = defaultdict(float)
    count = defaultdict(int)
    with open(sys.argv[1]) as lines:
        for line in lines:
            case = json.loads(line)
            found = hang(case)
            off_mm = 1e3 * np.linalg.norm(found[:3] - case["position_m"])
            name = case["robot"]
            worst[name] = max(worst[name], off_mm)
            # The plant states the tension in the middle of the cable, and that of the routed part.
            forces = zip(case["tensions_n"], case["routed_n"], found[3:].reshape(-1, 2), strict=True)
            for i, (middle_n, routed_n, force) in enumerate(forces):
                top, middle = Cable(case, i).tensions(*force)
                tension[name] = max(tension[name], abs(middle - middle_n))
                if case["mass_kg_m"] > 0:
                    routed[name] = max(routed[name], abs(top - routed_n) / (top - middle))
            count[name] += 1
    for name, off_mm in worst.items():
        print(
            f"{name}: {count[name]} places, position within {off_mm:.4f} mm, tensions within {tension[name]:.4f} N, "
            f"routed part within {100 * routed[name]:.1f} % of the carried weight"
        )
    assert count.keys() == TOLERANCE_MM.keys() and min(count.values()) >= 20, count
    far = any(off_mm > TOLERANCE_MM[name] for name, off_mm in worst.items())
    sys.exit(far or any(share > TOLERANCE_ROUTED for share in routed.values()))


main()
