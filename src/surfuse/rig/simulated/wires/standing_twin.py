"""A twin whose random numbers depend on where a sensor stands, for devices that no one tells the stop."""

from __future__ import annotations

import threading
import zlib
from functools import partial

import numpy as np

from surfuse.interfaces import Clock
from surfuse.records import FloatArray, SensorSpec
from surfuse.sensors import simulated
from surfuse.twin.world import Twin

_STAGE = "wires"
_DECIMALS = 7
_WARM_S = 1e6  # the sensors have warmed up


class StandingTwin(Twin):
    """The same reading from the same place, whenever and however often it is asked for: a scan can be repeated."""

    _one = threading.Lock()

    def ping(
        self, world_from_sensor: FloatArray, spec: SensorSpec, pings: int, t_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """See `Twin.ping`; `t_s` does not count."""
        with self._one:
            self.begin(_STAGE, zlib.crc32((np.round(world_from_sensor, _DECIMALS) + 0.0).tobytes()))
            return super().ping(world_from_sensor, spec, pings, _WARM_S)


def simulated_ranger(
    world: Twin, spec: SensorSpec, place: partial[FloatArray], clock: Clock
) -> simulated.SimulatedSensor:
    """A sensor of the twin at a place (4, 4) that may change."""
    around = simulated.Surroundings(clock=clock, spec=spec, world=world, pose=place)
    return simulated.create(simulated.Parameters(surroundings=around))
