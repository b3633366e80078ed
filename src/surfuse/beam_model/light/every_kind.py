"""One map from sensors of every kind: sound and light each by its own model, light judging what sound made up.

Sound is sharp where its echo is understood and far off where it is not; light is coarse and never ambiguous. So the map
of sound stands wherever light does not contradict it, and moves towards light by the share of the contradiction that is
not light's own noise (positive-part shrinkage: James and Stein, Proc. 4th Berkeley Symp. 1 (1961) 361).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter

from surfuse.beam_model.echo.detector import DetectorModel
from surfuse.beam_model.light.light_map import LightMap, blurred, light_map
from surfuse.beam_model.map.estimate import estimate_map
from surfuse.records import BoolArray, FloatArray, FusionScene, MapGrid, Readings, Regime, SurfaceMap
from surfuse.surface.resample import resampled

# Contradictions of less than so many variances of light are its noise; they are averaged over so many spots.
NOISE = 2.0
SPOTS = 2.0
TO_SIGMA = 1.4826
# Neighbouring cells share their errors: so many of them count as one when the offset is estimated.
CELLS_THAT_AGREE = 25.0


def map_of_every_kind(
    scene: FusionScene, readings: Readings, grid: MapGrid, detector: DetectorModel, edge: float
) -> SurfaceMap:  # fmt: skip
    """The map of all readings; those of one kind of sensor alone go their own way."""
    lit = np.array([spec.along_axis for spec in readings.specs], dtype=np.bool_)[readings.sensor]
    if not np.any(lit):
        return estimate_map(scene, readings, grid, detector, edge)
    seen = light_map(scene, readings.select(np.flatnonzero(lit)), grid, detector, edge)
    if np.all(lit):
        return seen.whole()
    heard = estimate_map(scene, readings.select(np.flatnonzero(~lit)), grid, detector, edge)
    if not np.any(heard.mask) or not np.any(seen.surface.mask):
        return seen.whole() if np.any(seen.surface.mask) else heard
    return together(heard, seen)


def together(heard: SurfaceMap, seen: LightMap) -> SurfaceMap:
    """The map of sound, moved towards the map of light where light contradicts it."""
    fine = heard.grid if len(heard.grid.u_m) >= len(seen.surface.grid.u_m) else seen.surface.grid
    sound, light = resampled(heard, fine), resampled(seen.surface, fine)
    both = sound.mask & light.mask
    if not np.any(both):
        return seen.whole()
    cells = seen.spot_m / float(np.median(np.diff(fine.u_m)))
    apart = np.asarray(light.height_m) - blurred(sound.height_m, sound.mask, cells)
    offset, left = _offset(apart, sound, light, both, seen.offset_sigma_m)
    share, square = _share(apart - offset, light, both, cells)
    lit = light.height_m - offset
    lit_sigma = np.hypot(light.sigma_m, left)
    share = np.where(both, share, np.where(light.mask, 1.0, 0.0))
    height = np.where(share > 0.0, np.where(both, sound.height_m + share * (lit - sound.height_m), lit), sound.height_m)
    between = share * (1.0 - share) * square
    sigma = np.sqrt(
        (1.0 - share) * np.where(sound.mask, sound.sigma_m, 0.0) ** 2
        + share * np.where(light.mask, lit_sigma, 0.0) ** 2
        + between
    )
    return _layers(sound, light, share, height, sigma)


def _offset(
    apart: FloatArray, sound: SurfaceMap, light: SurfaceMap, both: BoolArray, prior_m: float
) -> tuple[float, float]:
    """Offset of light against sound (m) and what is left unknown of it: weighted median, shrunk by its prior."""
    weight = 1.0 / (sound.sigma_m[both] ** 2 + light.sigma_m[both] ** 2)
    values = apart[both]
    order = np.argsort(values)
    passed = np.cumsum(weight[order])
    middle = float(values[order][np.searchsorted(passed, 0.5 * passed[-1])])
    scatter = TO_SIGMA * float(np.median(np.abs(values - middle)))
    variance = (scatter**2 + float(1.0 / np.median(weight))) * CELLS_THAT_AGREE / max(len(values), CELLS_THAT_AGREE)
    if prior_m <= 0.0:
        return 0.0, 0.0
    gain = prior_m**2 / (prior_m**2 + variance)
    return gain * middle, float(np.sqrt(gain * variance))


def _share(apart: FloatArray, light: SurfaceMap, both: BoolArray, cells: float) -> tuple[FloatArray, FloatArray]:
    """How far (R, C) the map moves from sound to light, and the mean square (m^2) of what they are apart."""
    width = max(3, 2 * round(SPOTS * cells) + 1)

    def mean(values: FloatArray) -> FloatArray:
        number = np.maximum(uniform_filter(both.astype(np.float64), width, mode="constant"), 1e-9)
        return np.asarray(uniform_filter(np.where(both, values, 0.0), width, mode="constant") / number)

    square = np.maximum(mean(apart**2), 0.0)
    noise = mean(light.sigma_m**2)
    return np.where(both, np.clip(1.0 - NOISE * noise / np.maximum(square, 1e-18), 0.0, 1.0), 0.0), square


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
