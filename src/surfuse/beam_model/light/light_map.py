"""The map of light and contact alone: estimated twice, the second time with what the first says of the sensors.

The first estimate takes the sensors at their word. Its residuals give the offset of each sensor against the others,
the scatter that the log really has, and what averaging over a zone does; the second is made from ranges without them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter, maximum_filter
from scipy.spatial import cKDTree

from surfuse.beam_model.echo.detector import DetectorModel
from surfuse.beam_model.light.passed import seen_through
from surfuse.beam_model.light.scatter import SensorScatter, sensor_scatter, usable_rows
from surfuse.beam_model.map.estimate import estimate_map
from surfuse.records import BoolArray, FloatArray, FusionScene, MapGrid, Readings, Regime, SurfaceMap

# Share of a sensor's sigma that no averaging removes: its offset, as data sheets leave it.
OFFSET_SHARE = {"tof": 1.0, "infrared": 1.0, "laser": 0.5, "touch": 0.2}
# A blurred surface is wrong by a multiple of what blurring it once more changes.
BLUR_AGAIN = 2.0
# Share of the scatter that neighbouring readings have in common (reflectance, poses).
SHARED = 0.15
# Readings around a node, and the percentile of their misses (so many sigmas of a normal one) that says whether the map
# explains them; chance alone reaches so many times the usual scatter.
AROUND = 25
MOSTLY_PERCENT, MOSTLY_SIGMAS = 80.0, 1.2816
MORE_THAN = 1.3


@dataclass(frozen=True)
class LightMap:
    """A map whose sigma is without the offset that all its readings share, and that offset's standard deviation (m).

    `spot_m` is the typical radius of a zone on the part, `scatter_m` the scatter of the readings about the map;
    `readings` are those that it was made of, as they are in the log.
    """

    surface: SurfaceMap
    offset_sigma_m: float
    spot_m: float
    scatter_m: float
    readings: Readings

    def whole(self) -> SurfaceMap:
        """The map with the offset in its sigma."""
        sigma = np.hypot(self.surface.sigma_m, self.offset_sigma_m)
        return replace(self.surface, sigma_m=np.where(self.surface.mask, sigma, np.nan))


def light_map(
    scene: FusionScene, readings: Readings, grid: MapGrid, detector: DetectorModel, edge: float
) -> LightMap:  # fmt: skip
    """The map of readings that are all of light or contact."""
    readings = readings.select(np.flatnonzero(~seen_through(scene, readings)))
    rough = estimate_map(scene, readings, grid, detector, edge)
    if np.count_nonzero(rough.mask) < 4 or min(rough.grid.shape) < 2:
        return LightMap(_named(rough), _offset_sigma(readings, None), 0.0, 0.0, readings)
    found = sensor_scatter(scene, readings, rough)
    surface = estimate_map(scene, corrected(readings, found), grid, detector, edge)
    spot = _spot(readings)
    left = sensor_scatter(scene, corrected(readings, found), surface)
    blur = _blur(surface, spot)
    surface = _named(_doubted(surface, left, blur))
    scatter = float(np.max(left.scatter_m, initial=0.0))
    return LightMap(surface, _offset_sigma(readings, found), spot, scatter, readings)


def corrected(readings: Readings, found: SensorScatter) -> Readings:
    """Readings without offsets between sensors and averaging, and with the sigma that the log shows."""
    taken = found.offset_m[readings.sensor] + found.averaging_m
    range_m = np.where(usable_rows(readings), readings.range_m - taken, readings.range_m)
    stated = np.array([spec.sigma_m for spec in readings.specs])[readings.sensor]
    own = np.where(np.isfinite(readings.sigma_m) & (readings.sigma_m > 0.0), readings.sigma_m, stated)
    return replace(readings, range_m=range_m, sigma_m=np.maximum(own, found.scatter_m[readings.sensor]))


def blurred(height: FloatArray, mask: BoolArray, spot_cells: float) -> FloatArray:
    """Heights (R, C) averaged over a zone's spot; what is not known continues the nearest value."""
    _, nearest = distance_transform_edt(~mask, return_indices=True)
    # A disc has the variance r^2 / 4 along each axis.
    return np.asarray(gaussian_filter(height[nearest[0], nearest[1]], 0.5 * spot_cells, mode="nearest"))


def _blur(surface: SurfaceMap, spot_m: float) -> FloatArray:
    """What zones cannot resolve (R, C) in m: from what averaging the map once more changes within a spot."""
    cells = spot_m / float(np.median(np.diff(surface.grid.u_m)))
    change = np.abs(blurred(surface.height_m, surface.mask, cells) - np.nan_to_num(surface.height_m))
    width = 2 * round(cells) + 1
    return np.asarray(BLUR_AGAIN * maximum_filter(np.where(surface.mask, change, 0.0), width))


def _doubted(surface: SurfaceMap, found: SensorScatter, blur: FloatArray) -> SurfaceMap:
    """The map with what zones cannot resolve, and what readings have in common, in its sigma."""
    common = SHARED * float(np.max(found.scatter_m, initial=0.0))
    sigma = np.sqrt(surface.sigma_m**2 + blur**2 + common**2 + _unexplained(surface, found) ** 2)
    return replace(surface, sigma_m=np.where(surface.mask, sigma, np.nan))


def _unexplained(surface: SurfaceMap, found: SensorScatter) -> FloatArray:
    """How far (R, C) in m the readings around a node are from the map beyond what they scatter everywhere."""
    if len(found.left_m) < AROUND:
        return np.zeros(surface.grid.shape)
    uu, vv = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    nodes = np.column_stack([uu.ravel(), vv.ravel()])
    _, near = cKDTree(found.foot_m).query(nodes, k=AROUND)
    local = np.percentile(np.abs(found.left_m)[near], MOSTLY_PERCENT, axis=1) / MOSTLY_SIGMAS
    usual = float(np.max(found.scatter_m, initial=0.0))
    return np.asarray(np.sqrt(np.maximum(local**2 - (MORE_THAN * usual) ** 2, 0.0)).reshape(surface.grid.shape))


def _named(surface: SurfaceMap) -> SurfaceMap:
    """The map with cells that readings hold named for light; regions that a simple surface won as well."""
    held = np.isin(surface.regime, [int(Regime.SPECKLE), int(Regime.MEASURED)])
    return replace(surface, regime=np.where(held, int(Regime.RAY), surface.regime).astype(np.uint8))


def _spot(readings: Readings) -> float:
    rows = usable_rows(readings)
    half = 0.5 * np.array([spec.beam_full_angle_rad for spec in readings.specs])[readings.sensor[rows]]
    return float(np.median(readings.range_m[rows] * np.tan(np.minimum(half, 1.0)))) if np.any(rows) else 0.0


def _offset_sigma(readings: Readings, found: SensorScatter | None) -> float:
    """Standard deviation (m) of the offset of the best kind that was heard: the others were set against it."""
    heard = np.unique(readings.sensor[usable_rows(readings)])
    stated = [OFFSET_SHARE[readings.specs[k].kind] * readings.specs[k].sigma_m for k in heard]
    seen = 0.0
    if found is not None and len(heard) > 1:
        # Sensors that differ from each other by more than stated may all differ from the truth by as much.
        seen = float(np.median(np.abs(found.offset_m[heard] - np.median(found.offset_m[heard]))))
    return float(np.hypot(min(stated, default=0.0), seen))
