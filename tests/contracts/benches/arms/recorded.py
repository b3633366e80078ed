"""A recording of one move, and then its end."""

from contextlib import contextmanager

import numpy as np
from plug_in_bench import ArmBench

from surfuse.arm_models.puma560 import LIMITS, READY_RAD, Puma560
from surfuse.arms.recorded import Parameters, Surroundings
from surfuse.records import JointState


@contextmanager
def bench(folder):
    target = READY_RAD + 0.1
    states = (JointState(READY_RAD, 10.0), JointState(target + 1e-4, 12.0))
    around = Surroundings(kinematics=Puma560(np.eye(4), np.eye(4)), limits=LIMITS, states=states)
    parameters = Parameters(0.01, surroundings=around)
    # A recording has no device that could vanish; it ends, which tests/arms/test_simulated_arm.py looks at.
    yield ArmBench(parameters, {"tolerance_rad": 0.01}, target, 1e-3, own_time=True)
