"""What the surfaces of the cell do to sound and to light."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from surfuse.errors import ConfigError, nearest
from surfuse.records import FloatArray

_USUAL_ROUGHNESS = 0.35


class Material(IntEnum):
    """Surfaces of the cell; the value indexes `MATERIALS`."""

    FLOOR = 0
    TABLE = 1
    PART = 2
    PART_SMOOTH = 3
    CLUTTER = 4


@dataclass(frozen=True)
class Surface:
    """Acoustic and optical behaviour of one material.

    Parameters
    ----------
    roughness_m : rms height of the fine roughness; the mirror-like part of the echo energy is
        `reflectivity * exp(-(2 k h cos i)^2)` (Rayleigh roughness, k wave number, i incidence).
    reflectivity : energy reflection coefficient of sound, 0 to 1 (nearly 1 for a solid in air).
    diffuse : share of the incident sound energy that is scattered after Lambert's law, 0 to 1.
    albedo : share of light that is reflected diffusely, 0 to 1.
    facet_slope : rms slope of the facets that scatter; the diffuse part then falls with the incidence i by
        `exp(-tan(i)^2 / facet_slope^2)`. 0: it does not, as after Lambert's law.
    """

    roughness_m: float
    reflectivity: float
    diffuse: float
    albedo: float
    facet_slope: float = 0.0

    def __post_init__(self) -> None:
        for name in ("reflectivity", "diffuse", "albedo"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ConfigError(f"material {name} = {value}", cure="give a share between 0 and 1")
        if not 0.0 <= self.facet_slope <= 10.0:
            raise ConfigError(f"material facet_slope = {self.facet_slope}", cure="give 0 (Lambert) to 10")
        if not 0.0 <= self.roughness_m < 0.01:
            raise ConfigError(f"material roughness_m = {self.roughness_m}", cure="give 0 to 0.01 m")


MATERIALS: dict[Material, Surface] = {
    Material.FLOOR: Surface(roughness_m=0.30e-3, reflectivity=0.95, diffuse=0.30, albedo=0.12),
    Material.TABLE: Surface(roughness_m=0.05e-3, reflectivity=0.98, diffuse=0.02, albedo=0.20),
    Material.PART: Surface(roughness_m=0.10e-3, reflectivity=0.98, diffuse=0.20, albedo=0.80),
    Material.PART_SMOOTH: Surface(roughness_m=0.002e-3, reflectivity=0.99, diffuse=0.0005, albedo=0.70),
    Material.CLUTTER: Surface(roughness_m=0.10e-3, reflectivity=0.95, diffuse=0.30, albedo=0.35),
}


def table_of(attribute: str, surfaces: Mapping[Material, Surface] = MATERIALS) -> FloatArray:
    """One property of every material as an array (materials,), indexed by `Material`."""
    return np.array([float(getattr(surfaces[material], attribute)) for material in Material])


PARTS: dict[str, Surface] = {
    "painted": Surface(roughness_m=0.05e-3, reflectivity=0.98, diffuse=1.0, albedo=0.80, facet_slope=0.28),
    "matte": MATERIALS[Material.PART],
    "metal": replace(MATERIALS[Material.PART_SMOOTH], albedo=0.80),
    "foam": Surface(roughness_m=0.50e-3, reflectivity=0.30, diffuse=0.10, albedo=0.80),
}
"""What a part may be made of, by name: what it does to sound. To the camera all of them are alike.

painted : a coat with a gentle grain. It scatters around its own normal: heard well at 20 degrees, lost by 25 to 30 with
    the tube, which is the limit of the paper's sensors.
matte : a coarse grain (cardboard, cast iron, felt) that scatters into all directions: heard at any tilt, late.
metal : smooth as glass. A mirror for sound: beyond 8 degrees with the tube, 20 without, there is nothing.
foam : open cells that swallow most of the sound; what comes back is weak, and late even when it faces the sensor.
"""


def with_material(name: str) -> dict[Material, Surface]:
    """`MATERIALS` with a part of a material of `PARTS`.

    Raises
    ------
    ConfigError : there is no such material.
    """
    if name not in PARTS:
        raise ConfigError(f"material '{name}'", cure=nearest(name, PARTS))
    return {**MATERIALS, Material.PART: PARTS[name]}


def with_roughness(part_roughness: float) -> dict[Material, Surface]:
    """`MATERIALS` with another part: roughness 0 is a mirror, 0.35 is `matte`, 1 almost fully diffuse.

    Raises
    ------
    ConfigError : the roughness is not from 0 to 1.
    """
    if not 0.0 <= part_roughness <= 1.0:
        raise ConfigError(f"part roughness = {part_roughness}", cure="give 0 (mirror) to 1 (diffuse)")
    usual = MATERIALS[Material.PART]
    rough = part_roughness / _USUAL_ROUGHNESS
    part = replace(usual, roughness_m=usual.roughness_m * rough, diffuse=min(1.0, usual.diffuse * rough**1.5))
    return {**MATERIALS, Material.PART: part}
