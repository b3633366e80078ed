"""How far the readings of each sensor really are from the surface: offset between sensors, scatter, outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.beam_model.light.zones import HeightField, predicted
from surfuse.geometry.poses import inverse, rotate_vectors, transform_points
from surfuse.records import BoolArray, FloatArray, FusionScene, IntArray, Readings, Status, SurfaceMap

TO_SIGMA = 1.4826
# Fewer readings than this say nothing of their sensor.
LEAST_READINGS = 20
# A rim inside of a zone is not to be undone: the most that averaging may be taken to do, in radii of the spot.
AVERAGING_SHARE = 0.2
MOSTLY_ON = 0.7


@dataclass(frozen=True)
class SensorScatter:
    """What a surface says of the sensors, S of them.

    `offset_m` (S,) their median residual, `scatter_m` (S,) the robust standard deviation of the residuals of all
    sensors of that kind about their offsets; `averaging_m` (N,) the mean over the zone of each reading minus the range
    along its axis, 0 for readings without an echo. A sensor with few readings has offset 0 and scatter 0. `foot_m`
    (K, 2) and `left_m` (K,) are where readings end and their residuals about the offset of their sensor.
    """

    offset_m: FloatArray
    scatter_m: FloatArray
    averaging_m: FloatArray
    foot_m: FloatArray
    left_m: FloatArray


def usable_rows(readings: Readings) -> BoolArray:
    """Readings (N,) with an echo."""
    return np.asarray((readings.status == int(Status.OK)) & np.isfinite(readings.range_m), dtype=np.bool_)


def sensor_scatter(scene: FusionScene, readings: Readings, surface: SurfaceMap) -> SensorScatter:
    """Residuals of the readings about a surface, sensor by sensor; only where the axis ends on what the map holds."""
    part_from_world = inverse(scene.world_from_part)
    rows = np.flatnonzero(usable_rows(readings))
    place = transform_points(part_from_world, readings.position_m[rows])
    axis = rotate_vectors(part_from_world, readings.axis[rows])
    half = 0.5 * np.array([spec.beam_full_angle_rad for spec in readings.specs])[readings.sensor[rows]]
    along, mean, on = predicted(HeightField.of(surface), place, axis, half, readings.range_m[rows])
    averaging = np.zeros(len(readings.range_m))
    most = AVERAGING_SHARE * along * np.tan(np.minimum(half, 1.0))
    averaging[rows] = np.clip(mean - along, -most, most)
    error = readings.range_m[rows] - mean
    foot = place + along[:, None] * axis
    grid = surface.grid
    within = (foot[:, 0] >= grid.u_m[0]) & (foot[:, 0] <= grid.u_m[-1])
    within &= (foot[:, 1] >= grid.v_m[0]) & (foot[:, 1] <= grid.v_m[-1])
    # A zone that is half beside the part says more of its rim than of its height.
    within &= on >= MOSTLY_ON
    offset, scatter = _by_sensor(readings, rows[within], error[within])
    left = error - offset[readings.sensor[rows]]
    return SensorScatter(offset, scatter, averaging, foot[within, :2], left[within])


def _by_sensor(readings: Readings, rows: IntArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Offsets (S,) of the sensors, and the scatter (S,) of those of their kind and stated sigma."""
    sensor = readings.sensor[rows]
    count = len(readings.specs)
    offset, scatter = np.zeros(count), np.zeros(count)
    for k in range(count):
        own = error[sensor == k]
        if len(own) >= LEAST_READINGS:
            offset[k] = float(np.median(own))
    kinds = [(spec.kind, spec.sigma_m) for spec in readings.specs]
    about = np.abs(error - offset[sensor])
    for kind in set(kinds):
        alike = np.array([one == kind for one in kinds])
        own = about[alike[sensor]]
        if len(own) >= LEAST_READINGS:
            scatter[alike] = TO_SIGMA * float(np.median(own))
    return offset, scatter
