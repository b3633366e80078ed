"""A camera in a world that is grey."""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from plug_in_bench import CameraBench, TickingClock

from surfuse.cameras import REFERENCE_MODEL
from surfuse.cameras.simulated import Parameters, Surroundings

MODEL = replace(REFERENCE_MODEL, width_px=32, height_px=24)


class GreyWorld:
    def image(self, camera, world_from_camera):
        return np.full((camera.height_px, camera.width_px), 90, np.uint8)

    def ping(self, world_from_sensor, spec, pings, t_s):
        raise NotImplementedError

    def repeatability(self, joints):
        raise NotImplementedError

    def begin(self, stage, index):
        raise NotImplementedError


@contextmanager
def bench(folder):
    around = Surroundings(model=MODEL, clock=TickingClock(), world=GreyWorld(), pose=lambda: np.eye(4))
    yield CameraBench(Parameters(0.02, around), {"exposure_s": 0.02}, always_open=True)
