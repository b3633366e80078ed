"""Faults planted in the twin's rangers, and how much a sender disturbs a receiver."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from surfuse.errors import UsageError, nearest
from surfuse.geometry.poses import pose
from surfuse.records import FloatArray, SensorSpec
from surfuse.rig.simulated.ranger_bench import LOOK, Bench
from surfuse.twin.acoustics.air import AirParameters
from surfuse.twin.acoustics.noise import AcousticNoise
from surfuse.twin.materials import Material
from surfuse.twin.scene import Scene, SceneBody
from surfuse.twin.world import Twin, TwinParameters, transducer_of

FAULTS = ("bias", "noise", "drift", "dropout", "wrong beam", "cycle slips", "cross-talk")
WARM_UP_S = 3600.0
USUAL_MATERIAL = "painted"
"""Material of the plate on which the usable incidence is found: that of the built-in parts."""

_STEP_M = 0.09
_SIDE_M = 0.05
_CHANGED_M = 0.005


@dataclass(frozen=True)
class SimulatedRanger:
    """A ranger of the twin under test: its spec, the physics it lives in, and whether an array of it fires together."""

    spec: SensorSpec
    physics: TwinParameters
    together: bool = False

    def bench(self, material: str = "matte", seed: int = 1) -> Bench:
        """A bench with this ranger before a plate of a material."""
        return Bench(self.spec, self.physics, material, seed)

    def crosstalk_shares(self, near_m: float, seed: int) -> FloatArray:
        """Share (S, S) of a receiver's (column) readings over a step that a sender (row) changes by over 5 mm."""
        return _crosstalk_shares(self, near_m, seed)


def planted(spec: SensorSpec, fault: str | None) -> SimulatedRanger:
    """A ranger with one fault planted; None: a good one.

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
    return SimulatedRanger(spec, faulty[fault], fault == "cross-talk")


def _crosstalk_shares(ranger: SimulatedRanger, near_m: float, seed: int) -> FloatArray:
    world = Twin(Scene([_sheet(0.0, -1.0, 0.0), _sheet(_STEP_M, 0.0, 1.0)]), ranger.physics, seed)
    corners = [(y, z) for z in (-0.5 * _SIDE_M, 0.5 * _SIDE_M) for y in (-0.5 * _SIDE_M, 0.5 * _SIDE_M)]
    specs = [ranger.spec] * len(corners)
    shifts = np.linspace(-0.08, 0.08, 17).tolist()
    changed = np.zeros((len(corners), len(corners)))
    for number, shift in enumerate(shifts):
        poses = np.stack([pose(LOOK, [-near_m, y + shift, z]) for y, z in corners])
        for receiver in range(len(corners)):
            alone = _one(world, number, poses[[receiver]], specs[:1], together=False)
            for sender in set(range(len(corners))) - {receiver}:
                both = _one(world, number, poses[[receiver, sender]], specs[:2], together=ranger.together)
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
