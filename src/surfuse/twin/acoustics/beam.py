"""The transmit-receive beam of a circular piston, and the bundle of rays that samples it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import j1

from surfuse.errors import ConfigError
from surfuse.records import FloatArray, IntArray

GOLDEN_ANGLE_RAD = float(np.pi * (3.0 - np.sqrt(5.0)))
TABLE_SIZE = 4096
_GRID = 64
_CORE_SHARE = 0.7


@dataclass(frozen=True)
class BundleParameters:
    """How finely the beam and the surface are sampled.

    Parameters
    ----------
    rays : rays in the bundle.
    floor_db : the bundle reaches out to where the two-way side lobes have fallen to this.
    speckle_cell_m : size of the patches of a rough surface that scatter with one phase.
    edge_spacing_m : distance of the scatter points along sharp edges.
    edge_strength : Keller's diffraction coefficient times the square root of the wave number.
    bounces : 1 for direct echoes, 2 to hear paths over two surfaces as well.
    """

    rays: int = 512
    floor_db: float = -45.0
    speckle_cell_m: float = 0.006
    edge_spacing_m: float = 0.008
    edge_strength: float = 0.2
    bounces: int = 2

    def __post_init__(self) -> None:
        if not 16 <= self.rays <= 1_000_000:
            raise ConfigError(f"bundle.rays = {self.rays}", cure="give 16 to 1000000")
        if not -90.0 <= self.floor_db <= -10.0:
            raise ConfigError(f"bundle.floor_db = {self.floor_db}", cure="give -90 to -10")
        for name in ("speckle_cell_m", "edge_spacing_m"):
            value = getattr(self, name)
            if not 1e-4 <= value <= 0.1:
                raise ConfigError(f"bundle.{name} = {value}", cure="give 0.0001 to 0.1 m")
        if not 0.0 <= self.edge_strength <= 10.0:
            raise ConfigError(f"bundle.edge_strength = {self.edge_strength}", cure="give 0 to 10")
        if self.bounces not in (1, 2):
            raise ConfigError(f"bundle.bounces = {self.bounces}", cure="give 1 or 2")


@dataclass(frozen=True)
class Beam:
    """A sampled beam in the sensor frame.

    `directions` (N, 3) unit, z forward; `weight_sr` (N,) the solid angle that each ray stands for; `two_way` (T,)
    the two-way energy directivity D^4 over the sine of the angle, 0 to 1 in T even steps; `edge_sine` the sine
    of the bundle's rim; `nearest` (G, G) the ray that is nearest to a direction, over x and y in [-rim, rim].
    """

    directions: FloatArray
    weight_sr: FloatArray
    two_way: FloatArray
    edge_sine: float
    nearest: IntArray


def directivity(aperture_m: float, wave_number: float, sine: FloatArray) -> FloatArray:
    """One-way amplitude directivity 2 J1(x) / x of a circular piston, x = k a sin(theta).

    Of the shape of `sine`; 1 on the axis. `wave_number` k in 1/m, a is half of `aperture_m`.
    """
    x = 0.5 * aperture_m * wave_number * np.asarray(sine, dtype=np.float64)
    small = np.abs(x) < 1e-6
    safe = np.where(small, 1.0, x)
    result: FloatArray = np.where(small, 1.0, 2.0 * j1(safe) / safe)
    return result


def sample_beam(aperture_m: float, wave_number: float, bundle: BundleParameters) -> Beam:
    """A golden-angle spiral whose density follows the two-way amplitude, thinned out towards the rim."""
    sines = np.linspace(0.0, 1.0, TABLE_SIZE)
    two_way = directivity(aperture_m, wave_number, sines) ** 4
    edge_sine = _rim_sine(0.5 * aperture_m * wave_number, bundle.floor_db)
    fine = np.linspace(0.0, np.arcsin(edge_sine), 4001)
    ring = np.sin(fine)
    core = directivity(aperture_m, wave_number, np.sin(fine)) ** 2
    core_total = float(np.trapezoid(core * ring, fine))
    cap_total = float(np.trapezoid(ring, fine))
    density = _CORE_SHARE * core / core_total + (1.0 - _CORE_SHARE) / cap_total
    steps = 0.5 * (density[1:] * ring[1:] + density[:-1] * ring[:-1]) * np.diff(fine)
    share = np.concatenate([[0.0], np.cumsum(steps)])
    index = np.arange(bundle.rays)
    theta = np.interp((index + 0.5) / bundle.rays * share[-1], share, fine)
    phi = GOLDEN_ANGLE_RAD * index
    directions = np.column_stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    weight = 2.0 * np.pi * share[-1] / (bundle.rays * np.interp(theta, fine, density))
    return Beam(directions, weight, two_way, edge_sine, _nearest_rays(directions, edge_sine))


def _rim_sine(ka: float, floor_db: float) -> float:
    """Where the envelope 8 / (pi x^3) of the two-way amplitude has fallen to the floor."""
    x = (8.0 / (np.pi * 10.0 ** (floor_db / 20.0))) ** (1.0 / 3.0)
    return float(min(x / ka, np.sin(np.radians(60.0))))


def _nearest_rays(directions: FloatArray, edge_sine: float) -> IntArray:
    """Index (G, G) of the ray next to each node of a square grid over the x and y of directions."""
    nodes = np.linspace(-edge_sine, edge_sine, _GRID)
    result = np.empty((_GRID, _GRID), dtype=np.int64)
    for row, x in enumerate(nodes):
        gap = (directions[None, :, 0] - x) ** 2 + (directions[None, :, 1] - nodes[:, None]) ** 2
        result[row] = np.argmin(gap, axis=1)
    return result
