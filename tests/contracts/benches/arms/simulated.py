"""The arm without dynamics, in a world that shakes it by a tenth of a millimetre."""

from contextlib import contextmanager

import numpy as np
from plug_in_bench import ArmBench, TickingClock

from surfuse.arm_models.puma560 import ENCODER_RAD_PER_COUNT, LIMITS, READY_RAD, Puma560
from surfuse.arms.simulated import Parameters, Surroundings


class ShakyWorld:
    def __init__(self):
        self.rng = np.random.default_rng(3)

    def ping(self, world_from_sensor, spec, pings, t_s):
        raise NotImplementedError

    def image(self, camera, world_from_camera):
        raise NotImplementedError

    def repeatability(self, joints):
        return self.rng.normal(0.0, 1e-4, joints)

    def begin(self, stage, index):
        raise NotImplementedError


@contextmanager
def bench(folder):
    around = Surroundings(
        kinematics=Puma560(np.eye(4), np.eye(4)),
        limits=LIMITS,
        clock=TickingClock(),
        world=ShakyWorld(),
        start_rad=READY_RAD,
    )
    values = {"settle_s": 0.2, "encoder_rad_per_count": list(ENCODER_RAD_PER_COUNT)}
    parameters = Parameters(0.2, encoder_rad_per_count=ENCODER_RAD_PER_COUNT, surroundings=around)
    yield ArmBench(parameters, values, READY_RAD + np.radians([20.0, -10.0, 5.0, 8.0, -3.0, 30.0]), 1e-3)
