"""A ranger in the twin, before the plate."""

from contextlib import contextmanager

import numpy as np
from plug_in_bench import SensorBench, TickingClock

from surfuse.geometry.poses import pose
from surfuse.sensors.simulated import Parameters, Surroundings
from surfuse.twin.parts import make_part
from surfuse.twin.scene import Scene
from surfuse.twin.world import Twin

LOOK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@contextmanager
def bench(folder):
    world = Twin(Scene([make_part("flat").body]), seed=2)
    around = Surroundings(clock=TickingClock(), world=world, pose=lambda: pose(LOOK, [0.67, 0.0, 1.1]))
    values = {"pings": 4, "sample_rate_hz": 1_000_000}
    # What is simulated cannot vanish.
    yield SensorBench(Parameters(4, surroundings=around), values, 0.43, always_open=True)
