"""The trials of an acceptance: in the twin, with or without a planted fault, or what logs tell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surfuse.commands.rangers.measured_readings import facing_shots
from surfuse.commands.rangers.sensor_sheet import STANDOFF_M
from surfuse.errors import UsageError, nearest
from surfuse.geometry.poses import pose
from surfuse.records import FloatArray, SensorSpec, Status
from surfuse.rig.simulated.ranger_bench import LOOK, Bench, Shots
from surfuse.runs.scan_source import load_scan
from surfuse.twin.acoustics.air import AirParameters
from surfuse.twin.acoustics.noise import AcousticNoise
from surfuse.twin.materials import Material
from surfuse.twin.scene import Scene, SceneBody
from surfuse.twin.world import ULTRASONIC, Twin, TwinParameters, transducer_of

FAULTS = ("bias", "noise", "drift", "dropout", "wrong beam", "cycle slips", "cross-talk")
WARM_UP_S = 3600.0
_STEP_M = 0.09
_SIDE_M = 0.05
_CHANGED_M = 0.005
_EARLY_M, _LATE_M, _USABLE_SHARE = 0.005, 0.02, 0.75


@dataclass(frozen=True)
class Trials:
    """What was tried: a facing plate at several distances with single pings, and what else could be done.

    `warm_up` is a plate that stands still from switching on, `beam_rad` the full -6 dB angle, `usable_rad` the
    largest usable incidence, `crosstalk` (S, S) the share of the receiver's (column) readings that the sender changes.
    """

    facing: Shots
    warm_up: Shots | None = None
    beam_rad: float | None = None
    usable_rad: float | None = None
    crosstalk: FloatArray | None = None


def planted(spec: SensorSpec, fault: str | None) -> tuple[TwinParameters, bool]:
    """Physics with one fault planted, and whether the sensors fire together; None: a good sensor.

    Raises
    ------
    UsageError : no such fault.
    """
    usual = TwinParameters()
    other = transducer_of(spec)
    faulty = {
        None: usual,
        "bias": replace(usual, air=AirParameters(assumed_temperature_c=32.0)),
        "noise": replace(usual, noise=AcousticNoise(timing_m=2e-3)),
        "drift": replace(usual, noise=AcousticNoise(drift_m=5e-3)),
        "dropout": replace(usual, noise=AcousticNoise(dropout=0.2)),
        "wrong beam": replace(usual, transducers={spec.name: replace(other, aperture_m=0.6 * other.aperture_m)}),
        "cycle slips": replace(usual, noise=AcousticNoise(slip=0.2)),
        "cross-talk": usual,
    }
    if fault not in faulty:
        raise UsageError(f"unknown fault '{fault}'", cure=nearest(str(fault), FAULTS))
    return faulty[fault], fault == "cross-talk"


def twin_trials(spec: SensorSpec, physics: TwinParameters, together: bool = False, seed: int = 1) -> Trials:
    """Everything that can be tried, in the twin: first the warm-up, then the rest with a warm sensor."""
    matte, smooth = Bench(spec, physics, seed=seed), Bench(spec, physics, smooth=True, seed=seed)
    low = max(spec.range_min_m, spec.dead_length_m) + 0.02
    standoff_m = float(np.clip(STANDOFF_M, low, 0.98 * spec.range_max_m))
    warm_up = []
    while matte.clock.now_s() < WARM_UP_S:
        warm_up.append(matte.shoot(standoff_m, 0.0, 1, moving=False))
        matte.clock.advance(30.0)
    smooth.clock.advance(WARM_UP_S)
    distances = np.linspace(low, min(1.2, 0.95 * spec.range_max_m), 10)
    facing = [matte.shoot(distance, 0.0, 40, 1, moving=False) for distance in distances.tolist()]
    sound = spec.kind == ULTRASONIC
    return Trials(
        facing=_joined(facing),
        warm_up=_joined(warm_up),
        beam_rad=_beam_rad(smooth, standoff_m) if sound else None,
        usable_rad=_usable_rad(matte, standoff_m),
        crosstalk=_crosstalk(spec, physics, together, standoff_m, seed) if sound else None,
    )


def log_trials(spec: SensorSpec, log: Path, distances_m: tuple[float, ...], warm_up: Path | None) -> Trials:
    """What a log of a facing plate at known distances tells, and one of the warm-up."""
    if not distances_m:
        raise UsageError("--log without --distances", cure="give the distances in metres, in the order of the log")
    facing = facing_shots(load_scan(log).readings, distances_m, spec, str(log))
    if warm_up is None:
        return Trials(facing)
    return Trials(facing, facing_shots(load_scan(warm_up).readings, (STANDOFF_M,), spec, str(warm_up)))


def _joined(shots: list[Shots]) -> Shots:
    names = ("axis_m", "incidence_rad", "expected_m", "range_m", "status", "t_s", "amplitude")
    return Shots(*(np.concatenate([getattr(one, name) for one in shots]) for name in names))


def _beam_rad(smooth: Bench, standoff_m: float) -> float | None:
    """Full angle within which the echo of a mirror is stronger than half: the -6 dB beam."""
    tilts = np.radians(np.arange(0.0, 40.0, 0.25))
    strength = np.array([np.nanmean(np.append(smooth.shoot(standoff_m, tilt, 4).amplitude, 0.0)) for tilt in tilts])
    weak = strength < 0.5 * strength[0]
    if not weak.any() or strength[0] <= 0.0:
        return None
    k = int(np.argmax(weak))
    part = (strength[k - 1] - 0.5 * strength[0]) / (strength[k - 1] - strength[k])
    return float(2.0 * (tilts[k - 1] + part * (tilts[k] - tilts[k - 1])))


def _usable_rad(matte: Bench, standoff_m: float) -> float | None:
    """Largest incidence up to which three of four readings lie between foot and axis, or shortly behind.

    Readings that a facing plate does not answer either are no matter of incidence.
    """
    usable, facing = None, 0.0
    for tilt in np.radians(np.arange(0.0, 42.5, 2.5)).tolist():
        shots = matte.shoot(standoff_m, tilt, 48)
        good = (shots.status == int(Status.OK)) & (shots.range_m > shots.expected_m - _EARLY_M)
        good &= shots.range_m < np.maximum(shots.axis_m, shots.expected_m) + _LATE_M
        share = float(np.mean(good))
        facing = share if usable is None else facing
        if share == 0.0 or share < _USABLE_SHARE * facing:
            break
        usable = tilt
    return usable


def _crosstalk(spec: SensorSpec, physics: TwinParameters, together: bool, near_m: float, seed: int) -> FloatArray:
    """Share (S, S) of the readings of a receiver (column) over a step that a sender (row) changes by over 5 mm."""
    world = Twin(Scene([_sheet(0.0, -1.0, 0.0), _sheet(_STEP_M, 0.0, 1.0)]), physics, seed)
    corners = [(y, z) for z in (-0.5 * _SIDE_M, 0.5 * _SIDE_M) for y in (-0.5 * _SIDE_M, 0.5 * _SIDE_M)]
    specs = [spec] * len(corners)
    shifts = np.linspace(-0.08, 0.08, 17).tolist()
    changed = np.zeros((len(corners), len(corners)))
    for number, shift in enumerate(shifts):
        poses = np.stack([pose(LOOK, [-near_m, y + shift, z]) for y, z in corners])
        for receiver in range(len(corners)):
            alone = _one(world, number, poses[[receiver]], specs[:1], together=False)
            for sender in set(range(len(corners))) - {receiver}:
                both = _one(world, number, poses[[receiver, sender]], specs[:2], together=together)
                differs = not (alone == both or abs(alone - both) < _CHANGED_M)
                changed[sender, receiver] += differs / len(shifts)
    return changed


def _one(world: Twin, number: int, poses: FloatArray, specs: list[SensorSpec], *, together: bool) -> float:
    """The first sensor's reading of one ping, the same random numbers whoever else sends."""
    world.begin("cross-talk", number)
    named = [replace(spec, name=f"{spec.name}{'' if k == 0 else k}") for k, spec in enumerate(specs)]
    if together:
        return float(world.ping_together(poses, named, 1, WARM_UP_S)[0][0, 0])
    first = float(world.ping(poses[0], named[0], 1, WARM_UP_S)[0][0])
    for place, other in zip(poses[1:], named[1:], strict=True):
        world.ping(place, other, 1, WARM_UP_S)
    return first


def _sheet(x: float, y_low: float, y_high: float) -> SceneBody:
    corners = np.array([[x, y_low, -1.0], [x, y_high, -1.0], [x, y_high, 1.0], [x, y_low, 1.0]])
    return SceneBody(corners, np.array([[0, 2, 1], [0, 3, 2]]), Material.PART_SMOOTH, np.eye(4))
