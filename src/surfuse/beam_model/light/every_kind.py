"""One map from sensors of every kind: sound and light each by its own model, light judging what sound made up.

Sound is sharp where its echo is understood and far off where it is not; light is coarse and never ambiguous. So the map
of sound stands wherever the readings of light do not contradict it beyond chance, and gives way where they do.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surfuse.beam_model.echo.detector import DetectorModel
from surfuse.beam_model.light.contradiction import Contradiction, contradiction
from surfuse.beam_model.light.light_map import LightMap, light_map
from surfuse.beam_model.light.same_nodes import at_nodes
from surfuse.beam_model.map.estimate import estimate_map
from surfuse.records import BoolArray, FloatArray, FusionScene, MapGrid, Readings, Regime, SurfaceMap

# Contradictions of less than so many variances of chance are chance; from so many on, the echo was not understood.
CHANCE, WRONG = 2.2, 3.0
TO_SIGMA = 1.4826
# Neighbouring cells share their errors: so many of them count as one when the offset is estimated.
CELLS_THAT_AGREE = 25.0


def map_of_every_kind(
    scene: FusionScene, readings: Readings, grid: MapGrid, detector: DetectorModel, edge: float
) -> SurfaceMap:  # fmt: skip
    """The map of all readings; those of one kind of sensor alone go their own way."""
    lit = np.array([spec.along_axis for spec in readings.specs], dtype=np.bool_)[readings.sensor]
    # A measured lateness on tilt belongs to the model of the echo, also that of a sensor of light.
    late = any(spec.late is not None for spec in readings.specs if spec.along_axis)
    if not np.any(lit) or late:
        return estimate_map(scene, readings, grid, detector, edge)
    seen = light_map(scene, readings.select(np.flatnonzero(lit)), grid, detector, edge)
    if np.all(lit):
        return seen.whole()
    heard = estimate_map(scene, readings.select(np.flatnonzero(~lit)), grid, detector, edge)
    if np.count_nonzero(heard.mask) < 4 or not np.any(seen.surface.mask):
        return seen.whole() if np.any(seen.surface.mask) else heard
    return together(heard, seen, contradiction(scene, seen.readings, heard, seen.scatter_m, seen.spot_m))


def together(heard: SurfaceMap, seen: LightMap, apart: Contradiction) -> SurfaceMap:
    """The map of sound, moved towards the map of light where light contradicts it; `apart` is at the nodes of sound."""
    sound, light = heard, at_nodes(seen.surface, heard.grid)
    both = sound.mask & light.mask
    if not np.any(both):
        return seen.whole()
    ratio = apart.square / np.maximum(apart.noise, 1e-18)
    share = np.clip((ratio - CHANCE) / (WRONG - CHANCE), 0.0, 1.0)
    offset, left = _offset(sound, light, both & (ratio < CHANCE), seen.offset_sigma_m)
    share = np.where(both, share, np.where(light.mask, 1.0, 0.0))
    lit = light.height_m - offset
    lit_sigma = np.hypot(light.sigma_m, left)
    height = np.where(share > 0.0, np.where(both, sound.height_m + share * (lit - sound.height_m), lit), sound.height_m)
    # What light contradicts and the map keeps all the same.
    kept = np.where(both, (1.0 - share) * np.maximum(apart.square - apart.noise, 0.0), 0.0)
    sigma = np.sqrt(
        (1.0 - share) * np.where(sound.mask, sound.sigma_m, 0.0) ** 2
        + share * np.where(light.mask, lit_sigma, 0.0) ** 2
        + kept
    )
    return _layers(sound, light, share, height, sigma)


def _offset(sound: SurfaceMap, light: SurfaceMap, agreed: BoolArray, prior_m: float) -> tuple[float, float]:
    """Offset of light against sound (m) and what is left unknown of it: weighted median, shrunk by its prior.

    Only cells (R, C) where light does not contradict sound speak for it; the more of them, the more.
    """
    if prior_m <= 0.0 or not np.any(agreed):
        return 0.0, max(prior_m, 0.0)
    values = (light.height_m - sound.height_m)[agreed]
    weight = 1.0 / (sound.sigma_m[agreed] ** 2 + light.sigma_m[agreed] ** 2)
    order = np.argsort(values)
    passed = np.cumsum(weight[order])
    middle = float(values[order][np.searchsorted(passed, 0.5 * passed[-1])])
    scatter = TO_SIGMA * float(np.median(np.abs(values - middle)))
    variance = (scatter**2 + float(1.0 / np.median(weight))) * CELLS_THAT_AGREE / len(values)
    # Where most of the map is contradicted, what agrees may do so by chance.
    variance += prior_m**2 * (agreed.size / len(values) - 1.0)
    gain = prior_m**2 / (prior_m**2 + variance)
    return gain * middle, float(np.sqrt(gain * variance))


def _layers(
    sound: SurfaceMap, light: SurfaceMap, share: FloatArray, height: FloatArray, sigma: FloatArray
) -> SurfaceMap:
    """The map of both: its cells are named for what holds them."""
    mask = sound.mask | light.mask
    mostly = share > 0.5
    regime = np.where(mostly, light.regime, sound.regime)
    # What sound could only continue, light has seen.
    unheard = np.isin(regime, [int(Regime.PRIOR), int(Regime.EMPTY)]) & light.mask
    regime = np.where(unheard, light.regime, regime)
    second, weight = sound.alternative_height_m, sound.alternative_weight
    return replace(
        sound,
        height_m=np.where(mask, height, np.nan),
        sigma_m=np.where(mask, sigma, np.nan),
        confidence=np.where(mask, np.where(mostly, light.confidence, sound.confidence), 0.0),
        count=np.where(mask, sound.count * sound.mask + light.count * light.mask, 0),
        mask=mask,
        regime=np.where(mask, regime, int(Regime.EMPTY)).astype(np.uint8),
        alternative_height_m=None if second is None else np.where(mostly, np.nan, second),
        alternative_weight=None if weight is None else np.where(mostly, 0.0, weight),
    )
