"""What the beam-aware method does with sensors, poses and logs that are not as they should be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surfuse.fusion import beam
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import (
    BoolArray,
    FloatArray,
    FusionScene,
    GuardReason,
    MapGrid,
    Outline,
    Readings,
    Regime,
    SensorSpec,
    SurfaceMap,
)
from surfuse.surface.resample import thinned

TUBE = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 3e-4, frequency_hz=63e3, aperture_m=0.04)
WIDE = replace(TUBE, beam_full_angle_rad=float(np.radians(26.0)), aperture_m=0.0147)
CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]]) * 0.025


def plate(
    step: float = 0.01, reach: int = 5, specs: tuple[SensorSpec, ...] = (TUBE,) * 4, outlined: bool = True
) -> tuple[FusionScene, Readings, MapGrid]:
    """A facing plate at w = 0, read from 43 cm."""
    rng = np.random.default_rng(4)
    g = np.arange(-reach, reach + 1) * step
    u, v = np.meshgrid(g, g)
    m = u.size
    grip = np.tile(pose(rotation_about([1, 0, 0], np.pi), [0, 0, 0.43]), (m, 1, 1))
    grip[:, 0, 3], grip[:, 1, 3] = u.ravel(), v.ravel()
    position = (grip[:, None, :3, 3] + CORNERS).reshape(-1, 3)
    readings = Readings(
        specs=specs, t_s=np.arange(4 * m) * 0.05, sensor=np.tile(np.arange(4), m), position_m=position,
        axis=np.tile([0.0, 0.0, -1.0], (4 * m, 1)), range_m=0.43 + rng.normal(0.0, 3e-4, 4 * m),
        status=np.zeros(4 * m), amplitude=np.full(4 * m, np.nan), sigma_m=np.full(4 * m, np.nan),
        count=np.ones(4 * m), start=np.arange(m + 1) * 4, stop=np.arange(m), row=np.repeat(np.arange(len(g)), len(g)),
        world_from_grip=grip,
    )  # fmt: skip
    half = (reach + 1) * step
    outline = Outline(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half, np.eye(4)) if outlined else None
    return FusionScene(specs, np.eye(4), outline), readings, MapGrid(g, g, np.eye(4))


def fuse(scene: FusionScene, readings: Readings, grid: MapGrid) -> SurfaceMap:
    surface = beam.create(beam.Parameters()).replay(scene, readings, grid).surface
    assert surface is not None
    return thinned(surface, grid)


def rmse_mm(surface: SurfaceMap, where: BoolArray | None = None) -> float:
    cells = surface.mask if where is None else surface.mask & where
    height: FloatArray = surface.height_m[cells]
    return float(1e3 * np.sqrt(np.mean(height**2)))


@pytest.mark.parametrize(
    "spec",
    [
        SensorSpec("x", "ultrasonic", 0.2, 1.2, float(np.radians(30.0)), 1e-3),
        SensorSpec("x", "ultrasonic", 0.2, 1.2, float(np.radians(0.5)), 1e-3),
    ],
    ids=["without frequency and aperture", "without a beam"],
)
def test_sensors_that_are_hardly_described(spec: SensorSpec) -> None:
    surface = fuse(*plate(specs=(spec,) * 4))
    assert rmse_mm(surface) < 0.5
    assert np.mean(surface.mask) > 0.9


def test_sensors_with_contradictory_descriptions_of_one_beam() -> None:
    surface = fuse(*plate(specs=(TUBE, WIDE, TUBE, WIDE)))
    assert rmse_mm(surface) < 0.5


def test_two_sensors_that_contradict_the_two_others_are_neither_believed_nor_dropped() -> None:
    scene, readings, grid = plate()
    torn = replace(readings, range_m=readings.range_m + np.where(readings.sensor % 2 == 1, 0.006, 0.0))
    honest, surface = fuse(scene, readings, grid), fuse(scene, torn, grid)
    assert np.mean(surface.mask) > 0.9
    height = surface.height_m[surface.mask]
    assert np.all((height > -0.0075) & (height < 0.0015)), "between what the two pairs say"
    assert np.median(surface.sigma_m[surface.mask]) > 1.3 * np.median(honest.sigma_m[honest.mask])


def test_a_pose_offset_moves_the_map_and_does_not_bend_it() -> None:
    scene, readings, grid = plate()
    surface = fuse(scene, replace(readings, position_m=readings.position_m + np.array([0.004, 0.003, 0.005])), grid)
    inner = np.ones(surface.mask.shape, dtype=bool)
    inner[[0, -1]], inner[:, [0, -1]] = False, False
    height = surface.height_m[surface.mask & inner]
    assert np.mean(height) == pytest.approx(0.005, abs=3e-4)
    assert np.std(height) < 3e-4


def test_steps_of_eight_centimetres_give_what_they_can() -> None:
    surface = fuse(*plate(step=0.08, reach=2))
    assert np.all(surface.mask)
    assert rmse_mm(surface) < 0.5
    assert {one.reason for one in surface.decisions} == {GuardReason.TOO_FEW}


def test_thirty_per_cent_outliers_leave_the_guard_content() -> None:
    scene, readings, grid = plate()
    rng = np.random.default_rng(8)
    bad = rng.random(len(readings.range_m)) < 0.3
    wild = np.where(bad, rng.uniform(0.25, 0.8, len(bad)), readings.range_m)
    surface = fuse(scene, replace(readings, range_m=wild), grid)
    assert rmse_mm(surface) < 0.5
    assert all(one.chosen == "beam" for one in surface.decisions)


def test_a_hole_in_the_scan_is_marked_as_prior_and_is_less_certain() -> None:
    scene, readings, grid = plate(reach=8)
    foot = readings.position_m[:, :2]
    silent = np.max(np.abs(foot), axis=1) < 0.045
    surface = fuse(
        scene, replace(readings, range_m=np.where(silent, np.inf, readings.range_m), status=silent * 1), grid
    )
    middle = surface.mask.shape[0] // 2
    assert surface.regime[middle, middle] in (Regime.PRIOR, Regime.EMPTY)
    if surface.mask[middle, middle]:
        assert surface.sigma_m[middle, middle] > 3.0 * surface.sigma_m[2, 2]


def test_many_copies_of_a_log_cost_memory_in_proportion_and_change_nothing() -> None:
    scene, readings, grid = plate(reach=3)
    copies = np.tile(np.arange(len(readings.range_m)), 250)
    n = len(copies)
    columns = ("t_s", "sensor", "position_m", "axis", "range_m", "status", "amplitude", "sigma_m", "count")
    many = Readings(
        specs=readings.specs, **{name: getattr(readings, name)[copies] for name in columns}, start=np.arange(n + 1),
        stop=np.arange(n), row=np.zeros(n), world_from_grip=np.tile(np.eye(4), (n, 1, 1)),
    )  # fmt: skip
    once, often = fuse(scene, readings, grid), fuse(scene, many, grid)
    np.testing.assert_array_equal(often.mask, once.mask)
    np.testing.assert_allclose(often.height_m[once.mask], once.height_m[once.mask], atol=5e-4)
