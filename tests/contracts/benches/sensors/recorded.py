"""One of two recorded sensors, with a number in every second sweep."""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from plug_in_bench import SensorBench, TickingClock

from surfuse.records import Sweep, readings_from_sweeps
from surfuse.sensors.polaroid import SPEC
from surfuse.sensors.recorded import Parameters, Surroundings

SWEEPS = 12


@contextmanager
def bench(folder):
    specs = (replace(SPEC, name="us0"), replace(SPEC, name="us1"))
    sweeps = [
        Sweep(
            stop=n,
            row=0,
            world_from_grip=np.eye(4),
            t_s=np.array([n, n + 0.5]),
            sensor=np.array([0, 1]),
            position_m=np.zeros((2, 3)),
            axis=np.tile([1.0, 0.0, 0.0], (2, 1)),
            range_m=np.array([0.9, np.inf if n % 2 else 0.5 if n else 0.8]),
            status=np.array([0, n % 2]),
            amplitude=np.array([1.0, 0.5]),
            spread_m=np.full(2, 1e-4),
            count=np.array([5, 0 if n % 2 else 5]),
        )
        for n in range(SWEEPS)
    ]
    around = Surroundings(clock=TickingClock(), readings=readings_from_sweeps(specs, sweeps))
    parameters = Parameters("us1", 2, surroundings=around)
    values = {"sensor": "us1", "first_reading": 2}
    # A record does not vanish, it ends: the suite does not read so far.
    yield SensorBench(parameters, values, 0.5, always_open=True, own_time=True)
