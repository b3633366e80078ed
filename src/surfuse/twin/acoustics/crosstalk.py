"""Several transducers that send at the same moment: each hears its own echo and those of its neighbours' bursts.

A pair that sends at A and hears at B, with parallel axes a small baseline b apart, sounds like one transducer half-way
between them whose every path is longer: half of it is `sqrt(r^2 + (b / 2)^2)` instead of r. This is the bistatic
equivalence theorem (Kell 1965, "On the derivation of bistatic RCS from monostatic measurements", Proc. IEEE 53); for a
mirror it is exact.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surfuse.errors import ConfigError
from surfuse.records import FloatArray
from surfuse.twin.acoustics.noise import AcousticNoise
from surfuse.twin.acoustics.sounder import BIN_M, EchoArrivals, Sounder

# Beams further apart than this hear different surfaces, and one in between hears neither as they do.
PARALLEL_COSINE = float(np.cos(np.radians(5.0)))


def ping_together(
    sounder: Sounder,
    world_from_sensor: FloatArray,
    pings: int,
    noise: AcousticNoise,
    generators: Sequence[np.random.Generator],
    t_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Ranges (S, pings) and strengths (S, pings) of S equal transducers at poses (S, 4, 4) that send at once.

    One transducer alone gives what `Sounder.ping` gives, to the last bit.

    Raises
    ------
    ConfigError : the axes are not parallel within 5 degrees.
    """
    _check_parallel(world_from_sensor)
    count = len(world_from_sensor)
    sums = [_nothing(sounder) for _ in range(count)]
    for sender in range(count):
        for receiver in range(sender, count):
            between = world_from_sensor[sender].copy()
            between[:3, 3] = 0.5 * (world_from_sensor[sender, :3, 3] + world_from_sensor[receiver, :3, 3])
            apart_m = float(np.linalg.norm(world_from_sensor[receiver, :3, 3] - world_from_sensor[sender, :3, 3]))
            found = sounder.arrivals(between)
            for place in {sender, receiver}:
                sums[place] = _added(sums[place], found, 0.5 * apart_m)
    ranges, strengths = np.empty((count, pings)), np.empty((count, pings))
    for place, generator in enumerate(generators):
        ranges[place], strengths[place] = sounder.heard(sums[place], pings, noise, generator, t_s)
    return ranges, strengths


def _check_parallel(world_from_sensor: FloatArray) -> None:
    axes = world_from_sensor[:, :3, 2]
    least = float((axes @ axes.T).min())
    if least < PARALLEL_COSINE:
        raise ConfigError(
            f"sensors that fire together look {np.degrees(np.arccos(least)):.0f} degrees apart",
            cure="the model of cross-talk holds to 5 degrees; fire them one after the other",
        )


def _nothing(sounder: Sounder) -> EchoArrivals:
    bins = sounder.bins
    return EchoArrivals(np.zeros(bins), np.zeros(bins), np.zeros(bins), np.array([bins, -1], dtype=np.int64))


def _added(sums: EchoArrivals, found: EchoArrivals, half_baseline_m: float) -> EchoArrivals:
    """Add what a pair hears, every path made longer by its baseline."""
    low, high = (int(limit) for limit in found.extent)
    if high < low:
        return sums
    here = np.arange(low, high + 1)
    there = here
    if half_baseline_m > 0.0:
        there = np.rint(np.hypot(here * BIN_M, half_baseline_m) / BIN_M).astype(np.int64)
    kept = there < len(sums.mirror)
    here, there = here[kept], there[kept]
    for own, added in ((sums.mirror, found.mirror), (sums.real, found.real), (sums.imag, found.imag)):
        np.add.at(own, there, added[here])
    if len(there):
        sums.extent[0] = min(int(sums.extent[0]), int(there[0]))
        sums.extent[1] = max(int(sums.extent[1]), int(there[-1]))
    return sums
