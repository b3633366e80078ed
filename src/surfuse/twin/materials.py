"""What the surfaces of the cell do to sound and to light."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from surfuse.errors import ConfigError
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


def with_roughness(part_roughness: float) -> dict[Material, Surface]:
    """`MATERIALS` with another part: roughness 0 is a mirror, 0.35 the default, 1 almost fully diffuse.

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
