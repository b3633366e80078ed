"""The validated readings of a scan as echoes in the part frame of the map: where each beam began, looked and ended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from surfuse.fusing.cones import Beams
from surfuse.geometry.poses import inverse
from surfuse.records import BoolArray, FloatArray, FusionScene, Gate, IntArray, MapGrid, Outline, Readings

AXIS_TRUE = 0.0
"""Spread of a sensor that measures along its axis, as light does."""

SAME_PLACE_M = 2e-4
"""Two visits closer than this are one place: the repeatability of an arm."""

SLANT = 0.1
"""An axis that meets the plane of the part at less than this sine looks past it, or from behind."""


@dataclass(frozen=True)
class Survey:
    """N validated readings in the part frame of the map, and all K readings that were taken.

    `start_m` (N, 3) is where the beam begins, `axis` (N, 3) its unit direction, `range_m` (N,) counts from the start;
    `foot_m` (N, 3) is the own-axis hit point. `sigma_m` (N,) is the standard deviation of the height that a reading
    gives to a surface across its axis. `spread_rad` (N,) is half the beam angle, 0 for a sensor that measures along
    its axis. `aim_m` (N, 2) is where the axis is at the median range, so that a wild range does not move it. `sensor`,
    `sweep`, `row` (N,) say who read it, when, and on which scan line. `seen_m` (K, 2) are the aims of all readings,
    refused ones too. `spacing_m` is the distance between neighbouring stops (nan: there is one stop). `excess` says how
    much larger (>= 1) the standard deviations that the log states are than those of the sensors, in the median.
    """

    start_m: FloatArray
    axis: FloatArray
    range_m: FloatArray
    foot_m: FloatArray
    sigma_m: FloatArray
    spread_rad: FloatArray
    aim_m: FloatArray
    sensor: IntArray
    sweep: IntArray
    row: IntArray
    seen_m: FloatArray
    spacing_m: float
    outline: Outline | None
    excess: float = 1.0

    def __len__(self) -> int:
        return len(self.range_m)

    @property
    def beams(self) -> Beams:
        """The readings as the kernels take them."""
        return Beams(self.start_m, self.axis, self.range_m, self.spread_rad)

    def select(self, keep: BoolArray) -> Survey:
        """The readings marked by `keep` (N,); what was seen and the spacing stay."""
        return Survey(
            self.start_m[keep], self.axis[keep], self.range_m[keep], self.foot_m[keep], self.sigma_m[keep],
            self.spread_rad[keep], self.aim_m[keep], self.sensor[keep], self.sweep[keep], self.row[keep],
            self.seen_m, self.spacing_m, self.outline, self.excess,
        )  # fmt: skip


def survey(scene: FusionScene, readings: Readings, gate: IntArray, grid: MapGrid) -> Survey:
    """Echoes of the readings whose `gate` (N,) is PASSED, in the part frame of the grid.

    The beam starts `dead_length_m` in front of the sensor. Readings that look past the part or from behind it
    (axis . w > -0.1) are left out: a height over (u, v) is not what they measure.
    """
    part_from_world = inverse(grid.world_from_part)
    position = readings.position_m @ part_from_world[:3, :3].T + part_from_world[:3, 3]
    axis = readings.axis @ part_from_world[:3, :3].T
    specs = scene.specs
    dead = np.array([spec.dead_length_m for spec in specs], dtype=np.float64)[readings.sensor]
    half = [AXIS_TRUE if spec.along_axis else spec.beam_full_angle_rad / 2.0 for spec in specs]
    stated = np.array([spec.sigma_m for spec in specs], dtype=np.float64)[readings.sensor]
    own = readings.sigma_m
    sigma = np.where((own > 0.0) & np.isfinite(own), own, stated)
    length = readings.range_m - dead
    with np.errstate(invalid="ignore"):
        passed = (gate == Gate.PASSED) & (length > 0.0) & (axis[:, 2] < -SLANT)
    rows = np.flatnonzero(passed)
    reach = float(np.median(readings.range_m[rows])) if len(rows) else 0.0
    aim = (position + reach * axis)[:, :2]
    sweep = np.repeat(np.arange(readings.n_sweeps), np.diff(readings.start))
    start = position[rows] + dead[rows, None] * axis[rows]
    return Survey(
        start_m=start,
        axis=axis[rows],
        range_m=length[rows],
        foot_m=start + length[rows, None] * axis[rows],
        sigma_m=sigma[rows] / np.abs(axis[rows, 2]),
        spread_rad=np.array(half, dtype=np.float64)[readings.sensor[rows]],
        aim_m=aim[rows],
        sensor=readings.sensor[rows],
        sweep=sweep[rows],
        row=readings.row[sweep[rows]],
        seen_m=aim[np.all(np.isfinite(aim), axis=1)],
        spacing_m=_spacing(aim[rows], readings.sensor[rows]),
        outline=scene.outline,
        excess=max(1.0, float(np.median(sigma[rows] / stated[rows]))) if len(rows) else 1.0,
    )


def _spacing(aim: FloatArray, sensor: IntArray) -> float:
    """Median distance (m) between the nearest places that the busiest sensor looked at; nan with one place."""
    if len(aim) == 0:
        return float("nan")
    busiest = aim[sensor == int(np.argmax(np.bincount(sensor)))]
    _, first = np.unique(np.round(busiest / SAME_PLACE_M), axis=0, return_index=True)
    if len(first) < 2:
        return float("nan")
    places = busiest[np.sort(first)]
    distance, _ = cKDTree(places).query(places, k=2)
    return float(np.median(distance[:, 1]))
