"""A test bench in the twin: one ranger before a large plate, at any distance and incidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import ULTRASONIC, BoolArray, Echo, FloatArray, SensorSpec, Status
from surfuse.rig.simulated.assembly import SimulatedClock
from surfuse.sensors import simulated
from surfuse.twin.materials import Material, with_material
from surfuse.twin.scene import Scene, SceneBody
from surfuse.twin.world import Twin, TwinParameters

# The bench is so large that no beam reaches past its plate.
_HALF_SIDE_M = 4.0
_SPOT_M = 0.30
LOOK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class KnownReadings:
    """N readings of a plate: what was true, and what came back (`status` as `Status`, ranges after REP-117).

    `axis_m` (N,) is the distance to the plate along the sensor's axis, `incidence_rad` (N,) the angle between axis and
    normal, `expected_m` (N,) what the sensor should read: along the axis if it is optical. The echo of a wide beam
    comes from the foot of the perpendicular, so an ultrasonic one reads its dead length plus the distance of the plate
    from the place where the beam starts. `amplitude` (N,) is nan where it is not known.
    """

    axis_m: FloatArray
    incidence_rad: FloatArray
    expected_m: FloatArray
    range_m: FloatArray
    status: FloatArray
    t_s: FloatArray
    amplitude: FloatArray

    @property
    def heard(self) -> float:
        """Share of readings with a number."""
        return float(np.mean(self.status == int(Status.OK)))

    def subset(self, chosen: BoolArray) -> KnownReadings:
        """The readings marked in `chosen` (N,)."""
        columns = (self.axis_m, self.incidence_rad, self.expected_m, self.range_m, self.status)
        return KnownReadings(*(column[chosen] for column in (*columns, self.t_s, self.amplitude)))

    def errors_m(self) -> FloatArray:
        """Range minus what it should be, of the readings that have a number."""
        good = self.status == int(Status.OK)
        return np.asarray((self.range_m - self.expected_m)[good], dtype=np.float64)


def known_readings_of(
    spec: SensorSpec, axis_m: FloatArray, incidence_rad: FloatArray, echoes: Sequence[Echo] | None, ranges_m: FloatArray
) -> KnownReadings:
    """Shots from true geometry and ranges; times come from the echoes where there are any."""
    foot_m = spec.dead_length_m + (axis_m - spec.dead_length_m) * np.cos(incidence_rad)
    expected_m = foot_m if spec.kind == ULTRASONIC else axis_m
    status = np.select(
        [np.isfinite(ranges_m), np.isposinf(ranges_m), np.isneginf(ranges_m)],
        [float(Status.OK), float(Status.NO_ECHO), float(Status.TOO_CLOSE)],
        float(Status.FAULT),
    )
    times, strengths = np.zeros(len(axis_m)), np.full(len(axis_m), np.nan)
    if echoes is not None:
        times = np.array([echo.t_s for echo in echoes])
        strengths = np.array([echo.amplitude for echo in echoes])
    return KnownReadings(axis_m, incidence_rad, expected_m, ranges_m, status, times, strengths)


@dataclass
class Bench:
    """A ranger with these physics before a plate; every call draws its own random numbers from the seed.

    `material` is that of the plate, by name (see `surfuse.twin.materials.PARTS`).
    """

    spec: SensorSpec
    physics: TwinParameters = field(default_factory=TwinParameters)
    material: str = "matte"
    seed: int = 1

    def __post_init__(self) -> None:
        half = _HALF_SIDE_M
        corners = np.array([[0.0, -half, -half], [0.0, half, -half], [0.0, half, half], [0.0, -half, half]])
        plate = SceneBody(corners, np.array([[0, 2, 1], [0, 3, 2]]), Material.PART, np.eye(4))
        physics = replace(self.physics, surfaces=with_material(self.material))
        self._twin = Twin(Scene([plate]), physics, self.seed)
        self._spots = np.random.default_rng(self.seed)
        self._calls = 0
        self.clock = SimulatedClock()

    def measure(
        self, axis_m: float, incidence_rad: float, count: int, pings: int = 5, *, moving: bool = True
    ) -> KnownReadings:
        """`count` readings; `moving` aims each at another spot of the plate, else all are taken from one place."""
        self._calls += 1
        self._twin.begin("bench", self._calls)
        spots = self._spots.uniform(-_SPOT_M, _SPOT_M, (count if moving else 1, 2))
        places = [_place(axis_m, incidence_rad, y, z) for y, z in spots.tolist()]
        now = [places[0]]
        around = simulated.Surroundings(clock=self.clock, spec=self.spec, world=self._twin, pose=lambda: now[0])
        sensor = simulated.create(simulated.Parameters(pings, surroundings=around))
        echoes = []
        for number in range(count):
            now[0] = places[number if moving else 0]
            echoes.append(sensor.fire())
        axis, tilt = np.full(count, axis_m), np.full(count, incidence_rad)
        return known_readings_of(self.spec, axis, tilt, echoes, np.array([echo.range_m for echo in echoes]))


def _place(axis_m: float, incidence_rad: float, y: float, z: float) -> FloatArray:
    """World-from-sensor pose whose axis meets the plate x = 0 at (0, y, z)."""
    turn = rotation_about([0.0, 0.0, 1.0], incidence_rad) @ LOOK
    return pose(turn, np.array([0.0, y, z]) - axis_m * turn[:, 2])
