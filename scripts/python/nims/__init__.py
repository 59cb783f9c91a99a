"""Fly, simulate and analyse cable-suspended robots that run nims.

* `Sim`: a virtual robot in lockstep, flown by your cable velocities (`nims.env`: the same for Gymnasium).
* `Robot`: a running robot through its gateway: channels and requests.
* `nims_law.run`: a control law in Python, for `nims sim` and for a robot (`controller --program`);
  `nims_estimator.run`: an estimator.
* `nims.blob`: pictures, scans and grids of different lengths, in shared memory.
* `Run`: a recorded run to NumPy and pandas.
* `nims_sensor`: sensors. It, `nims_law` and `nims_run` also work as single files, without this package.
"""

from nims.robot import Refused, Robot, RobotError, Subscription
from nims.run import Run
from nims.sim import Sim, SimError

__all__ = ["Refused", "Robot", "RobotError", "Run", "Sim", "SimError", "Subscription"]
