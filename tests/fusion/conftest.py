"""A small scan over a plate as seen by an array of four sensors, for the fusion tests."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FusionScene, MapGrid, Outline, Readings, SensorSpec, SurfaceMap
from surfuse.registry import load
from surfuse.surface.gridding import grid_points

SPEC = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 0.0003)
CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]]) * 0.025

Depth = Callable[[np.ndarray, np.ndarray], np.ndarray]


def scan_over(
    surface: Depth,
    *,
    nu: int = 12,
    nv: int = 5,
    outlined: bool = True,
    noise_m: float = 0.0,
    missing: float = 0.0,
    outliers: float = 0.0,
    seed: int = 0,
) -> tuple[FusionScene, Readings]:
    """Ranges along w onto w = surface(u, v), grip 0.43 m in front of w = 0, rows along u, step 1 cm."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid((np.arange(nu) - (nu - 1) / 2) * 0.01, (np.arange(nv) - (nv - 1) / 2) * 0.01)
    m = u.size
    grip = np.tile(pose(rotation_about([1, 0, 0], np.pi), [0, 0, 0.43]), (m, 1, 1))
    grip[:, 0, 3], grip[:, 1, 3] = u.ravel(), v.ravel()
    position = (grip[:, None, :3, 3] + CORNERS).reshape(-1, 3)
    ranges = 0.43 - surface(position[:, 0], position[:, 1]) + rng.normal(0.0, 1.0, 4 * m) * noise_m
    bad = rng.random(4 * m) < outliers
    ranges[bad] += rng.uniform(0.02, 0.2, bad.sum())
    lost = rng.random(4 * m) < missing
    ranges[lost] = rng.choice([np.inf, -np.inf, np.nan], lost.sum())
    status = np.select([ranges == np.inf, ranges == -np.inf, np.isnan(ranges)], [1, 2, 3], 0)
    readings = Readings(
        specs=(SPEC,) * 4,
        t_s=np.arange(4 * m) * 0.05,
        sensor=np.tile(np.arange(4), m),
        position_m=position,
        axis=np.tile([0.0, 0.0, -1.0], (4 * m, 1)),
        range_m=ranges,
        status=status,
        amplitude=np.full(4 * m, np.nan),
        sigma_m=np.full(4 * m, np.nan),
        count=np.ones(4 * m),
        start=np.arange(m + 1) * 4,
        stop=np.arange(m),
        row=np.repeat(np.arange(nv), nu),
        world_from_grip=grip,
    )
    half = np.array([nu * 0.005, nv * 0.005])
    box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    outline = Outline(box, np.eye(4)) if outlined else None
    return FusionScene((SPEC,) * 4, np.eye(4), outline), readings


@pytest.fixture
def scan() -> Callable[..., tuple[FusionScene, Readings]]:
    return scan_over


def cone_ranges(surface: Depth, readings: Readings, half_rad: float, cell_m: float = 0.002) -> np.ndarray:
    """What an ideal sonar hears: distance to the nearest point of w = surface(u, v) within the cone of each beam."""
    u, v = np.meshgrid(np.arange(-0.15, 0.15, cell_m) + cell_m / 2, np.arange(-0.12, 0.12, cell_m) + cell_m / 2)
    points = np.column_stack([u.ravel(), v.ravel(), surface(u, v).ravel()])
    ranges = np.full(len(readings.range_m), np.inf)
    for i, (start, axis) in enumerate(zip(readings.position_m, readings.axis, strict=True)):
        near = points[np.hypot(*(points[:, :2] - start[:2]).T) < 0.08] - start
        length = np.linalg.norm(near, axis=1)
        seen = near @ axis >= length * np.cos(half_rad)
        ranges[i] = length[seen].min(initial=np.inf)
    return ranges


def grid_of(scene: FusionScene, nu: int = 12, nv: int = 5) -> MapGrid:
    """The nodes under the stops of `scan_over`."""
    return MapGrid((np.arange(nu) - (nu - 1) / 2) * 0.01, (np.arange(nv) - (nv - 1) / 2) * 0.01, scene.world_from_part)


@pytest.fixture
def cone_scan() -> Callable[..., tuple[FusionScene, Readings]]:
    """As `scan`, but heard by cones of the sensors' beam."""

    def build(surface: Depth, **options: float) -> tuple[FusionScene, Readings]:
        scene, readings = scan_over(surface, **options)  # type: ignore[arg-type]
        heard = cone_ranges(surface, readings, SPEC.beam_full_angle_rad / 2)
        bend = readings.range_m - (0.43 - surface(readings.position_m[:, 0], readings.position_m[:, 1]))
        return scene, dataclasses.replace(readings, range_m=heard + np.where(np.isfinite(bend), bend, 0.0))

    return build


@pytest.fixture
def mapped() -> Callable[..., SurfaceMap]:
    """The map of a scan by a method with parameters, on the nodes under its stops."""

    def run(
        name: str, scene: FusionScene, readings: Readings, grid: MapGrid | None = None, **given: float
    ) -> SurfaceMap:
        module = load("fusion", name)
        nu = int(np.sum(readings.row == 0)) or 1
        where = grid if grid is not None else grid_of(scene, nu, max(readings.n_sweeps // nu, 1))
        result = module.create(module.Parameters(**given)).replay(scene, readings, where)
        return result.surface if result.surface is not None else grid_points(result.points, where, name, scene.outline)

    return run
