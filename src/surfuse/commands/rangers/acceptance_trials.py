"""The trials of an acceptance: in the twin, with or without a planted fault, or what logs tell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse.commands.rangers.measured_readings import facing_readings
from surfuse.commands.rangers.sensor_sheet import STANDOFF_M
from surfuse.errors import UsageError
from surfuse.records import ULTRASONIC, FloatArray, SensorSpec, Status
from surfuse.rig.simulated.acceptance_bench import USUAL_MATERIAL, WARM_UP_S, SimulatedRanger
from surfuse.rig.simulated.ranger_bench import Bench, KnownReadings
from surfuse.runs.scan_source import load_scan

STEEPEST_DEG = 60.0
"""Largest incidence that is tried."""

_EARLY_M, _LATE_M, _USABLE_SHARE = 0.005, 0.02, 0.75


@dataclass(frozen=True)
class Trials:
    """What was tried: a facing plate at several distances with single pings, and what else could be done.

    `warm_up` is a plate that stands still from switching on, `beam_rad` the full -6 dB angle, `usable_rad` the largest
    usable incidence, on a plate of `material`, `crosstalk` (S, S) the share of the receiver's (column) readings that
    the sender changes.
    """

    facing: KnownReadings
    warm_up: KnownReadings | None = None
    beam_rad: float | None = None
    usable_rad: float | None = None
    material: str = ""
    crosstalk: FloatArray | None = None


def twin_trials(ranger: SimulatedRanger, seed: int = 1, material: str = USUAL_MATERIAL) -> Trials:
    """Everything that can be tried, in the twin: first the warm-up, then the rest with a warm sensor.

    `material` is that of the plate that is tilted to find the usable incidence.

    Raises
    ------
    ConfigError : there is no such material.
    """
    spec, matte, smooth = ranger.spec, ranger.bench(seed=seed), ranger.bench("metal", seed)
    tilted = ranger.bench(material, seed)
    low = max(spec.range_min_m, spec.dead_length_m) + 0.02
    standoff_m = float(np.clip(STANDOFF_M, low, 0.98 * spec.range_max_m))
    warm_up = []
    while matte.clock.now_s() < WARM_UP_S:
        warm_up.append(matte.measure(standoff_m, 0.0, 1, moving=False))
        matte.clock.advance(30.0)
    for bench in (smooth, tilted):
        bench.clock.advance(WARM_UP_S)
    distances = np.linspace(low, min(1.2, 0.95 * spec.range_max_m), 10)
    facing = [matte.measure(distance, 0.0, 40, 1, moving=False) for distance in distances.tolist()]
    sound = spec.kind == ULTRASONIC
    return Trials(
        facing=_joined(facing),
        warm_up=_joined(warm_up),
        beam_rad=_beam_rad(smooth, standoff_m) if sound else None,
        usable_rad=_usable_rad(tilted, standoff_m),
        material=material,
        crosstalk=ranger.crosstalk_shares(standoff_m, seed) if sound else None,
    )


def log_trials(spec: SensorSpec, log: Path, distances_m: tuple[float, ...], warm_up: Path | None) -> Trials:
    """What a log of a facing plate at known distances tells, and one of the warm-up."""
    if not distances_m:
        raise UsageError("--log without --distances", cure="give the distances in metres, in the order of the log")
    facing = facing_readings(load_scan(log).readings, distances_m, spec, str(log))
    if warm_up is None:
        return Trials(facing)
    return Trials(facing, facing_readings(load_scan(warm_up).readings, (STANDOFF_M,), spec, str(warm_up)))


def _joined(known: list[KnownReadings]) -> KnownReadings:
    names = ("axis_m", "incidence_rad", "expected_m", "range_m", "status", "t_s", "amplitude")
    return KnownReadings(*(np.concatenate([getattr(one, name) for one in known]) for name in names))


def _beam_rad(smooth: Bench, standoff_m: float) -> float | None:
    """Full angle within which the echo of a mirror is stronger than half: the -6 dB beam."""
    tilts = np.radians(np.arange(0.0, 40.0, 0.25))
    strength = np.array([np.nanmean(np.append(smooth.measure(standoff_m, tilt, 4).amplitude, 0.0)) for tilt in tilts])
    weak = strength < 0.5 * strength[0]
    if not weak.any() or strength[0] <= 0.0:
        return None
    k = int(np.argmax(weak))
    part = (strength[k - 1] - 0.5 * strength[0]) / (strength[k - 1] - strength[k])
    return float(2.0 * (tilts[k - 1] + part * (tilts[k] - tilts[k - 1])))


def _usable_rad(plate: Bench, standoff_m: float) -> float | None:
    """Largest incidence up to which three of four readings lie between foot and axis, or shortly behind.

    Readings that a facing plate does not answer either are no matter of incidence.
    """
    usable, facing = None, 0.0
    for tilt in np.radians(np.arange(0.0, STEEPEST_DEG + 1.0, 2.5)).tolist():
        known = plate.measure(standoff_m, tilt, 48)
        good = (known.status == int(Status.OK)) & (known.range_m > known.expected_m - _EARLY_M)
        good &= known.range_m < np.maximum(known.axis_m, known.expected_m) + _LATE_M
        share = float(np.mean(good))
        facing = share if usable is None else facing
        if share == 0.0 or share < _USABLE_SHARE * facing:
            break
        usable = tilt
    return usable
