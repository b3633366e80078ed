"""The whole beam-aware method on small scans made by plain geometry: what it recovers, refuses and survives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from surfuse.errors import ConfigError
from surfuse.fusion import beam
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FloatArray, FusionScene, MapGrid, Outline, Readings, Regime, SensorSpec, SurfaceMap
from surfuse.surface.resample import thinned

HALF = 0.08
TUBE = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 3e-4, frequency_hz=63e3, aperture_m=0.04)
LASER = SensorSpec("tof", "laser", 0.02, 2.0, float(np.radians(2.0)), 1e-3)
SQUARE = np.array([[-HALF, -HALF], [HALF, -HALF], [HALF, HALF], [-HALF, HALF]])
CORNERS = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * 0.025
NODES = np.arange(-8, 9) * 0.01
Distance = Callable[[FloatArray], FloatArray]


def to_plane(tilt_deg: float) -> Distance:
    """Perpendicular distance to the plane w = u tan(tilt)."""
    slope = np.tan(np.radians(tilt_deg))
    return lambda s: (s[:, 2] - slope * s[:, 0]) * np.cos(np.radians(tilt_deg))


def to_sphere(radius: float) -> Distance:
    return lambda s: np.linalg.norm(s - [0.0, 0.0, -radius], axis=1) - radius


def to_step(height: float, capture: float) -> Distance:
    """A step at u = -0.005, high for smaller u: its rim is heard within the capture radius."""

    def distance(s: FloatArray) -> FloatArray:
        beside = s[:, 0] + 0.005
        rim = np.hypot(np.maximum(beside, 0.0), s[:, 2] - height)
        return np.where(beside < capture, rim, s[:, 2])

    return distance


def scan(
    distance: Distance, *, spec: SensorSpec = TUBE, noise: float = 3e-4, outliers: float = 0.01, seed: int = 0,
    world_from_part: FloatArray | None = None, outlined: bool = True, reach: int = 5,
) -> tuple[FusionScene, Readings, MapGrid]:  # fmt: skip
    """A raster with a step of 1 cm, sensors facing down, readings of the plain distance."""
    rng = np.random.default_rng(seed)
    part = np.eye(4) if world_from_part is None else world_from_part
    g = np.arange(-reach, reach + 1) * 0.01
    u, v = np.meshgrid(g, g)
    m = u.size
    position = np.column_stack([u.ravel(), v.ravel(), np.full(m, 0.43)])[:, None, :] + np.pad(CORNERS, ((0, 0), (0, 1)))
    position = position.reshape(-1, 3)
    ranges = distance(position) + rng.normal(0.0, noise, 4 * m)
    bad = rng.random(4 * m) < outliers
    ranges[bad] += rng.uniform(0.005, 0.2, bad.sum())
    grip = np.tile(pose(rotation_about([1, 0, 0], np.pi), [0, 0, 0.43]), (m, 1, 1))
    grip[:, 0, 3], grip[:, 1, 3] = u.ravel(), v.ravel()
    readings = Readings(
        specs=(spec,) * 4, t_s=np.arange(4 * m) * 0.05, sensor=np.tile(np.arange(4), m),
        position_m=position @ part[:3, :3].T + part[:3, 3], axis=np.tile(-part[:3, 2], (4 * m, 1)), range_m=ranges,
        status=np.zeros(4 * m), amplitude=np.full(4 * m, np.nan), sigma_m=np.full(4 * m, np.nan),
        count=np.ones(4 * m), start=np.arange(m + 1) * 4, stop=np.arange(m), row=np.repeat(np.arange(len(g)), len(g)),
        world_from_grip=part @ grip,
    )  # fmt: skip
    outline = Outline(SQUARE * 1.01, part) if outlined else None
    return FusionScene((spec,) * 4, part, outline), readings, MapGrid(NODES, NODES, part)


def fuse(scene: FusionScene, readings: Readings, grid: MapGrid) -> SurfaceMap:
    surface = beam.create(beam.Parameters()).replay(scene, readings, grid).surface
    assert surface is not None
    return thinned(surface, grid)


def keep(readings: Readings, rows: FloatArray) -> Readings:
    """Some readings, one sweep each."""
    n = len(rows)
    columns = ("t_s", "sensor", "position_m", "axis", "range_m", "status", "amplitude", "sigma_m", "count")
    return Readings(
        specs=readings.specs, **{name: getattr(readings, name)[rows] for name in columns}, start=np.arange(n + 1),
        stop=np.arange(n), row=np.zeros(n), world_from_grip=np.tile(np.eye(4), (n, 1, 1)),
    )  # fmt: skip


def error_mm(surface: SurfaceMap, truth: FloatArray) -> FloatArray:
    return (surface.height_m - truth)[surface.mask] * 1e3


UU, VV = np.meshgrid(NODES, NODES)


def test_a_facing_plate_is_recovered_better_than_its_readings() -> None:
    surface = fuse(*scan(to_plane(0.0)))
    assert np.all(surface.mask)
    assert np.sqrt(np.mean(error_mm(surface, 0.0 * UU) ** 2)) < 0.15
    assert np.all(surface.regime == Regime.MIRROR)
    assert 0.2e-3 < np.median(surface.sigma_m) < 0.4e-3


def test_a_tilted_plate_heard_at_its_perpendicular_distance() -> None:
    surface = fuse(*scan(to_plane(4.0)))
    slope = np.tan(np.radians(4.0))
    assert np.sqrt(np.mean(error_mm(surface, slope * UU) ** 2)) < 0.6
    own_axis = 0.43 - to_plane(4.0)(np.array([[0.0, 0.0, 0.43]]))[0]
    assert abs(own_axis) > 0.9e-3


def test_a_sphere_is_recovered() -> None:
    surface = fuse(*scan(to_sphere(0.4)))
    inner = np.hypot(UU, VV) < 0.05
    error = (surface.height_m - (np.sqrt(0.4**2 - UU**2 - VV**2) - 0.4))[inner] * 1e3
    assert np.sqrt(np.mean(error**2)) < 0.8


def test_a_step_is_sharp_and_in_its_place() -> None:
    surface = fuse(*scan(to_step(0.06, 0.042)))
    truth = np.where(UU < -0.005, 0.06, 0.0)
    wrong = np.abs(surface.height_m - truth) > 3e-3
    assert np.all(np.abs(UU[wrong] + 0.005) < 0.011), "only cells at the edge itself may be on the wrong side"
    assert np.mean(wrong) < 0.08
    strip = (UU > 0.008) & (UU < 0.028)
    assert np.mean(surface.regime[strip] == Regime.MIRROR) < 0.5, "nothing was heard from the strip beside the step"


def test_any_part_frame_gives_the_same_map() -> None:
    frame = pose(rotation_about([0.3, -0.5, 0.8], 1.1), [1.0, -2.0, 0.7])
    here, there = fuse(*scan(to_plane(3.0))), fuse(*scan(to_plane(3.0), world_from_part=frame))
    np.testing.assert_allclose(there.height_m, here.height_m, atol=5e-5)


def test_without_an_outline_the_extent_comes_from_what_was_heard() -> None:
    surface = fuse(*scan(to_plane(0.0), outlined=False, reach=3))
    assert np.all(surface.mask[np.hypot(UU, VV) < 0.04])
    assert not np.any(surface.mask[np.maximum(np.abs(UU), np.abs(VV)) > 0.075])
    assert np.max(np.abs(error_mm(surface, 0.0 * UU))) < 1.0


def test_where_nothing_was_heard_there_is_a_gap() -> None:
    scene, readings, grid = scan(to_plane(0.0))
    surface = fuse(scene, keep(readings, np.flatnonzero(readings.position_m[:, 0] < -0.02)), grid)
    assert not np.any(surface.mask[UU > 0.045])
    assert np.all(np.isnan(surface.height_m[~surface.mask]))
    assert np.all(surface.regime[~surface.mask] == Regime.EMPTY)
    assert np.all(surface.mask[UU < -0.03])


@pytest.mark.parametrize("outliers", [0.1, 0.3])
def test_outliers_do_not_drill_holes(outliers: float) -> None:
    surface = fuse(*scan(to_plane(0.0), outliers=outliers, seed=5))
    assert np.sqrt(np.mean(error_mm(surface, 0.0 * UU) ** 2)) < 0.5


def test_a_lying_sensor_is_found_out() -> None:
    scene, readings, grid = scan(to_plane(0.0))
    lied = readings.range_m + np.where(readings.sensor == 2, 0.02, 0.0)
    columns = {name: getattr(readings, name) for name in Readings.__dataclass_fields__}
    surface = fuse(scene, Readings(**{**columns, "range_m": lied}), grid)
    assert np.sqrt(np.mean(error_mm(surface, 0.0 * UU) ** 2)) < 0.5


def test_repeated_rows_add_nothing_but_certainty() -> None:
    scene, readings, grid = scan(to_plane(2.0), outliers=0.0)
    n = len(readings.range_m)
    once = fuse(scene, keep(readings, np.arange(n)), grid)
    twice = fuse(scene, keep(readings, np.repeat(np.arange(n), 2)), grid)
    np.testing.assert_allclose(twice.height_m, once.height_m, atol=2e-4)


def test_light_reads_on_its_axis() -> None:
    slope = 0.4
    surface = fuse(*scan(lambda s: s[:, 2] - slope * s[:, 0], spec=LASER, noise=1e-3))
    assert np.sqrt(np.mean(error_mm(surface, slope * UU) ** 2)) < 0.6


def test_light_and_sound_in_one_log() -> None:
    scene, readings, grid = scan(lambda s: s[:, 2] - 0.02 * s[:, 0])
    specs = (TUBE, LASER, TUBE, LASER)
    columns = {name: getattr(readings, name) for name in Readings.__dataclass_fields__}
    surface = fuse(FusionScene(specs, np.eye(4), scene.outline), Readings(**{**columns, "specs": specs}), grid)
    assert np.sqrt(np.mean(error_mm(surface, 0.02 * UU) ** 2)) < 0.5


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_readings_claim_little(count: int) -> None:
    scene, readings, grid = scan(to_plane(0.0), outliers=0.0)
    surface = fuse(scene, keep(readings, np.arange(200, 200 + count)), grid)
    measured = surface.mask & (surface.regime != Regime.PRIOR)
    assert np.mean(measured) < 0.5, "what no reading supports is marked as such"
    assert count > 0 or not np.any(surface.mask)
    assert np.all(np.isfinite(surface.height_m[surface.mask]))


def test_all_from_one_place() -> None:
    scene, readings, grid = scan(to_plane(0.0), outliers=0.0)
    surface = fuse(scene, keep(readings, np.full(50, 200)), grid)
    assert np.mean(surface.mask) < 0.7
    assert np.all(np.isfinite(surface.sigma_m[surface.mask]))


def test_readings_from_behind_are_not_believed() -> None:
    scene, readings, grid = scan(to_plane(0.0))
    columns = {name: getattr(readings, name) for name in Readings.__dataclass_fields__}
    behind = Readings(**{**columns, "axis": -readings.axis})
    assert not np.any(fuse(scene, behind, grid).mask)


def test_silence_is_a_gap_everywhere() -> None:
    scene, readings, grid = scan(to_plane(0.0))
    columns = {name: getattr(readings, name) for name in Readings.__dataclass_fields__}
    silent = Readings(
        **{**columns, "range_m": np.full(len(readings.t_s), np.inf), "status": np.ones(len(readings.t_s))}
    )
    assert not np.any(fuse(scene, silent, grid).mask)


@pytest.mark.parametrize("field", ["threshold_ratio", "rise_wavelengths", "burst_cycles", "roughness_m", "edge_price"])
def test_parameters_have_limits(field: str) -> None:
    with pytest.raises(ConfigError, match=field):
        beam.Parameters(**{field: -1})
