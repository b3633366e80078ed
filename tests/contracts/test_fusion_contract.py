"""What every fusion plug-in must do; it runs over the registry, so that a new file is tested without a new test."""

from __future__ import annotations

import dataclasses
import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from surfuse import fusion
from surfuse.commands.fuse.map_of_result import surface_of
from surfuse.geometry.poses import pose, rotation_about
from surfuse.interfaces import FusionMethod
from surfuse.records import (
    FusedPoints,
    FusionScene,
    Gap,
    Gate,
    MapGrid,
    Outline,
    Readings,
    SensorSpec,
    SurfaceMap,
    Sweep,
    readings_from_sweeps,
)
from surfuse.records.columns import same
from surfuse.registry import folders, listed, load, names
from surfuse.surface.resample import thinned

SPEC = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 0.0003, frequency_hz=63e3, aperture_m=0.04)
CORNERS = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * 0.025
BOX = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])
SCENE = FusionScene((SPEC,) * 4, np.eye(4), Outline(BOX, np.eye(4)))
GRID = MapGrid((np.arange(11) - 5) * 0.01, (np.arange(7) - 3) * 0.01, np.eye(4))
COLUMNS = [field.name for field in dataclasses.fields(FusedPoints)]


CONTRIBUTING = Path(__file__).parents[2] / "CONTRIBUTING.md"
CONTRIBUTED = "steady"
"""The method that CONTRIBUTING shows: its very text is held to the same laws."""


@pytest.fixture(scope="module", autouse=True)
def contributed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The method of CONTRIBUTING as a file of the plug-in folder."""
    folder = tmp_path_factory.mktemp("fusion")
    blocks = re.findall(r"```python\n(.*?)```", CONTRIBUTING.read_text(encoding="utf-8"), re.DOTALL)
    text = next(block for block in blocks if "per_stop" in block)
    (folder / f"{CONTRIBUTED}.py").write_text(text, encoding="utf-8")
    fusion.__path__.append(str(folder))
    _look_again()
    yield
    fusion.__path__.remove(str(folder))
    sys.modules.pop(f"surfuse.fusion.{CONTRIBUTED}", None)
    vars(fusion).pop(CONTRIBUTED, None)
    _look_again()


def _look_again() -> None:
    """The registry remembers what it found: let it look once more."""
    folders.found.cache_clear()
    listed.listing.cache_clear()


@pytest.fixture(params=(*names("fusion"), CONTRIBUTED))
def method(request: pytest.FixtureRequest) -> FusionMethod:
    module = load("fusion", request.param)
    return module.create(module.Parameters())


def sweep_at(stop: int, u: float, v: float, row: int, ranges: list[float], sensors: list[int] | None = None) -> Sweep:
    sensor = list(range(len(ranges))) if sensors is None else sensors
    n = len(sensor)
    corner = CORNERS[np.array(sensor, dtype=np.int64) % 4]
    position = np.column_stack([corner + np.array([u, v]), np.full(n, 0.43)]) if n else np.zeros((0, 3))
    r = np.array(ranges, dtype=np.float64)
    return Sweep(
        stop=stop, row=row, world_from_grip=pose(rotation_about([1, 0, 0], np.pi), [u, v, 0.43]),
        t_s=stop * 0.6 + 0.05 * np.arange(n), sensor=np.array(sensor, dtype=np.int64), position_m=position,
        axis=np.tile([0.0, 0.0, -1.0], (n, 1)), range_m=r,
        status=np.select([r == np.inf, r == -np.inf, np.isnan(r)], [1, 2, 3], 0), amplitude=np.full(n, 0.8),
        spread_m=np.full(n, np.nan), count=np.ones(n),
    )  # fmt: skip


def scan(seed: int = 0, *, missing: float = 0.1, ragged: bool = False) -> Readings:
    """A plate with a 4 cm step; some readings lost or wild; with `ragged` 0 to 4 readings a sweep."""
    rng = np.random.default_rng(seed)
    sweeps = []
    for row, v in enumerate(GRID.v_m):
        for u in GRID.u_m:
            sensors = sorted(rng.choice(4, rng.integers(0, 5), replace=False).tolist()) if ragged else [0, 1, 2, 3]
            ranges = 0.43 - np.where(CORNERS[sensors, 0] + u > 0.0, 0.04, 0.0) + rng.normal(0, 3e-4, len(sensors))
            ranges = np.where(rng.random(len(sensors)) < 0.05, rng.uniform(0.0, 2.0, len(sensors)), ranges)
            lost = rng.random(len(sensors)) < missing
            ranges = np.where(lost, rng.choice([np.inf, -np.inf, np.nan], len(sensors)), ranges)
            sweeps.append(sweep_at(len(sweeps), float(u), float(v), row, ranges.tolist(), sensors))
    return readings_from_sweeps(SCENE.specs, sweeps)


def check(method: FusionMethod, readings: Readings, scene: FusionScene = SCENE) -> FusedPoints:
    """Replay, with the laws that hold for every scan."""
    result = method.replay(scene, readings, GRID)
    points = result.points
    assert len(points) == readings.n_sweeps
    np.testing.assert_array_equal(points.stop, readings.stop)
    np.testing.assert_array_equal(points.row, readings.row)
    np.testing.assert_array_equal(points.start, readings.start)
    np.testing.assert_array_equal(points.sensor, readings.sensor)
    value = points.gap == Gap.NONE
    assert np.all(np.isfinite(points.depth_m[value])), "a value is finite"
    assert np.all(points.sigma_m[value] > 0.0), "a value has a standard deviation"
    assert np.all(np.isfinite(points.sigma_m[value]))
    assert np.all(np.isfinite(points.point_m[value]))
    assert np.all(np.isnan(points.depth_m[~value])), "a gap is nan, never 0"
    assert np.all(np.isnan(points.point_m[~value]))
    assert np.all((points.dc >= 0.0) & (points.dc <= 1.0))
    assert np.all(points.dc[points.gate != Gate.PASSED] == 0.0), "what failed validation takes no part"
    no_echo = np.isposinf(readings.range_m)
    assert np.all(points.gate[no_echo] == Gate.NO_ECHO)
    assert np.all(points.gate[np.isneginf(readings.range_m)] == Gate.TOO_CLOSE)
    assert np.all(points.gate[np.isnan(readings.range_m)] == Gate.FAULT)
    if result.surface is not None:
        assert thinned(result.surface, GRID).grid.shape == GRID.shape, "its nodes are among those of the map"
        assert np.all(result.surface.sigma_m[result.surface.mask] > 0.0)
    return points


def live(method: FusionMethod, readings: Readings, scene: FusionScene = SCENE) -> tuple[FusedPoints, FusedPoints]:
    """Points returned step by step (as columns through finish), and those of replay."""
    state = method.start(scene)
    stepped = [method.step(state, readings.sweep(j)) for j in range(readings.n_sweeps)]
    finished = method.finish(state, GRID).points
    for j, point in enumerate(stepped):
        assert (point.stop, point.row) == (readings.stop[j], readings.row[j])
    return finished, method.replay(scene, readings, GRID).points


def test_says_what_it_is(method: FusionMethod) -> None:
    module = load("fusion", method.name)
    assert module.SUMMARY
    assert "\n" not in module.SUMMARY
    assert dataclasses.is_dataclass(module.Parameters)
    for field in dataclasses.fields(module.Parameters):
        assert field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING


@pytest.mark.parametrize("ragged", [False, True])
@pytest.mark.parametrize("seed", [0, 1])
def test_live_and_replayed_fusion_agree_to_the_last_bit(method: FusionMethod, seed: int, ragged: bool) -> None:
    readings = scan(seed, missing=0.3, ragged=ragged)
    check(method, readings)
    finished, replayed = live(method, readings)
    for name in COLUMNS:
        assert getattr(finished, name).tobytes() == getattr(replayed, name).tobytes(), name
    first, second = method.start(SCENE), method.replay(SCENE, readings, GRID)
    for j in range(readings.n_sweeps):
        method.step(first, readings.sweep(j))
    surface, other = method.finish(first, GRID).surface, second.surface
    assert (surface is None) == (other is None)
    if surface is not None and other is not None:
        for name in ("height_m", "sigma_m", "confidence", "count", "mask", "regime"):
            assert getattr(surface, name).tobytes() == getattr(other, name).tobytes(), name


def test_live_and_replayed_fusion_agree_with_many_sensors(method: FusionMethod) -> None:
    """Sums of many readings are where the order of adding shows."""
    rng = np.random.default_rng(3)
    scene = dataclasses.replace(SCENE, specs=(SPEC,) * 13)
    sweeps = []
    for stop, u in enumerate(GRID.u_m):
        heard = rng.random(13) < (1.0 if stop == 4 else 0.9)
        ranges = np.where(heard, 0.43 + rng.normal(0, 3e-4, 13), np.inf)
        sweeps.append(sweep_at(stop, float(u), 0.0, 0, ranges.tolist(), list(range(13))))
    finished, replayed = live(method, readings_from_sweeps(scene.specs, sweeps), scene)
    for name in COLUMNS:
        assert getattr(finished, name).tobytes() == getattr(replayed, name).tobytes(), name


def test_finish_may_be_asked_in_between(method: FusionMethod) -> None:
    readings = scan()
    state = method.start(SCENE)
    for j in range(5):
        method.step(state, readings.sweep(j))
    assert len(method.finish(state, GRID).points) == 5
    for j in range(5, readings.n_sweeps):
        method.step(state, readings.sweep(j))
    finished, replayed = method.finish(state, GRID).points, method.replay(SCENE, readings, GRID).points
    for name in COLUMNS:
        assert getattr(finished, name).tobytes() == getattr(replayed, name).tobytes(), name


def test_starting_twice_gives_independent_states(method: FusionMethod) -> None:
    readings = scan()
    one, two = method.start(SCENE), method.start(SCENE)
    for j in range(readings.n_sweeps):
        a = method.step(one, readings.sweep(j))
        b = method.step(two, readings.sweep(j))
        np.testing.assert_array_equal(a.depth_m, b.depth_m)


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_no_reading_at_all_is_a_scan_of_gaps(method: FusionMethod, value: float) -> None:
    sweeps = [sweep_at(j, 0.01 * j, 0.0, 0, [value] * 4) for j in range(5)]
    points = check(method, readings_from_sweeps(SCENE.specs, sweeps))
    assert np.all(points.gap == Gap.NO_VALID_READING)


def test_one_reading_and_empty_scan(method: FusionMethod) -> None:
    one = readings_from_sweeps(SCENE.specs, [sweep_at(0, 0.0, 0.0, 0, [0.43])])
    check(method, one)
    check(method, readings_from_sweeps(SCENE.specs, [sweep_at(0, 0.0, 0.0, 0, [])]))
    empty = readings_from_sweeps(SCENE.specs, [])
    assert len(method.replay(SCENE, empty, GRID).points) == 0
    assert len(method.finish(method.start(SCENE), GRID).points) == 0


def test_a_single_sensor_is_an_array(method: FusionMethod) -> None:
    scene = dataclasses.replace(SCENE, specs=(SPEC,))
    sweeps = [sweep_at(j, 0.01 * j - 0.03, 0.0, 0, [0.43]) for j in range(7)]
    points = check(method, readings_from_sweeps((SPEC,), sweeps), scene)
    np.testing.assert_allclose(points.depth_m[points.gap == Gap.NONE], 0.43, atol=0.005)


def test_without_an_outline(method: FusionMethod) -> None:
    check(method, scan(), dataclasses.replace(SCENE, outline=None))


def test_everything_outside_the_part_is_said_so(method: FusionMethod) -> None:
    sweeps = [sweep_at(j, 3.0 + 0.01 * j, 0.0, 0, [0.43] * 4) for j in range(5)]
    points = check(method, readings_from_sweeps(SCENE.specs, sweeps))
    assert np.all(points.gate == Gate.OUTSIDE_PART)
    assert np.all(points.gap == Gap.OUTSIDE_PART)


def test_order_of_the_readings_in_a_sweep_does_not_matter(method: FusionMethod) -> None:
    readings = scan(missing=0.2)
    order = np.random.default_rng(1).permuted(np.arange(len(readings.t_s)).reshape(-1, 4), axis=1).ravel()
    columns = ("t_s", "sensor", "position_m", "axis", "range_m", "status", "amplitude", "sigma_m", "count")
    shuffled = dataclasses.replace(readings, **{name: getattr(readings, name)[order] for name in columns})
    before, after = check(method, readings), check(method, shuffled)
    np.testing.assert_array_equal(after.gate, before.gate[order])
    np.testing.assert_allclose(after.depth_m, before.depth_m, rtol=0, atol=1e-6)


def test_dead_sensor_leaves_the_rest_standing(method: FusionMethod) -> None:
    readings = scan(missing=0.0)
    ranges = np.where(readings.sensor == 2, np.inf, readings.range_m)
    status = np.where(readings.sensor == 2, 1, readings.status)
    points = check(method, dataclasses.replace(readings, range_m=ranges, status=status))
    assert np.all(points.gap == Gap.NONE)


def test_facing_plate_is_found_within_the_noise(method: FusionMethod) -> None:
    rng = np.random.default_rng(5)
    sweeps = [
        sweep_at(r * len(GRID.u_m) + c, float(u), float(v), r, (0.43 + rng.normal(0, 3e-4, 4)).tolist())
        for r, v in enumerate(GRID.v_m)
        for c, u in enumerate(GRID.u_m)
    ]
    points = check(method, readings_from_sweeps(SCENE.specs, sweeps))
    value = points.gap == Gap.NONE
    assert value.mean() > 0.9
    assert np.abs(points.point_m[value, 2]).max() < 0.0015


LASERS = dataclasses.replace(
    SCENE, specs=(SensorSpec("beam of light", "laser", 0.2, 1.2, 0.01, 0.0003),) * 4
)  # along its axis: what a tilted plate reads needs no model of the echo
STATED = 0.0003
UNWEIGHTED = {
    "arc_median": "a median",
    "carving": "a quantile",
    "directional_maximum": "a count of votes",
    "mean": "the plain average",
    "median": "a median",
    "own_axis_median": "a median",
    "single_sensor": "one reading a stop",
    "weighted_average": "the paper's three factors and no other",
}
"""Methods that cannot give a reading less weight for its stated sigma, and what they are instead."""


def plane(slope: float, scene: FusionScene, seed: int = 0) -> Readings:
    """Readings of a plate that rises along u, along the axes."""
    rng = np.random.default_rng(seed)
    sweeps = []
    for row, v in enumerate(GRID.v_m):
        for u in GRID.u_m:
            ranges = 0.43 - slope * (CORNERS[:, 0] + u) + rng.normal(0, STATED, 4)
            sweeps.append(sweep_at(len(sweeps), float(u), float(v), row, ranges.tolist()))
    return readings_from_sweeps(scene.specs, sweeps)


def mapped(method: FusionMethod, scene: FusionScene, readings: Readings) -> tuple[FusedPoints, SurfaceMap]:
    result = method.replay(scene, readings, GRID)
    return result.points, surface_of(result, GRID, method.name, scene.outline)


@pytest.mark.parametrize(("slope", "scene"), [(0.0, SCENE), (0.2, LASERS)], ids=["facing", "tilted"])
def test_a_larger_stated_sigma_makes_no_part_of_the_map_surer(
    method: FusionMethod, slope: float, scene: FusionScene
) -> None:
    readings = plane(slope, scene)
    before, surer = mapped(method, scene, readings)
    for factor in (2.0, 5.0):
        stated = dataclasses.replace(readings, sigma_m=np.full(readings.n_readings, factor * STATED))
        after, wider = mapped(method, scene, stated)
        both = surer.mask & wider.mask
        assert both.sum() > 0.9 * surer.mask.sum()
        # Other explanations of the readings, which are a part of it, may be fewer with noisier readings.
        slack = 0.01 if method.name == "beam" else 1e-9
        assert np.all(wider.sigma_m[both] >= surer.sigma_m[both] * (1.0 - slack))
        value = (before.gap == Gap.NONE) & (after.gap == Gap.NONE)
        assert np.all(after.sigma_m[value] >= before.sigma_m[value] * (1.0 - 1e-9))
        before, surer = after, wider
    if slope == 0.0:
        # On the tilted plate the sensors of a stop contradict each other by more than any stated sigma.
        plain, first = mapped(method, scene, readings)
        assert np.median(surer.sigma_m[surer.mask]) > 1.02 * np.median(first.sigma_m[first.mask])
        assert np.nanmedian(before.sigma_m) > 1.02 * np.nanmedian(plain.sigma_m)


def test_sigma_of_the_sensor_is_meant_where_the_log_states_none(method: FusionMethod) -> None:
    readings = plane(0.0, SCENE)
    points, surface = mapped(method, SCENE, readings)
    stated = mapped(method, SCENE, dataclasses.replace(readings, sigma_m=np.full(readings.n_readings, STATED)))
    assert stated[0] == points
    assert same(stated[1].height_m, surface.height_m)
    assert same(stated[1].sigma_m, surface.sigma_m)


def test_a_sensor_that_states_a_larger_sigma_weighs_less(method: FusionMethod) -> None:
    """One of four reads 1.5 mm too far: saying that it is no better than that takes its bias out of the map."""
    readings = plane(0.0, SCENE)
    lying = readings.sensor == 1
    readings = dataclasses.replace(readings, range_m=readings.range_m + np.where(lying, 0.0015, 0.0))

    def bias_m(stated_m: float) -> float:
        _, surface = mapped(method, SCENE, dataclasses.replace(readings, sigma_m=np.where(lying, stated_m, STATED)))
        return abs(float(np.mean(surface.height_m[surface.mask])))

    silent, honest = bias_m(STATED), bias_m(10.0 * STATED)
    assert honest < 0.9 * silent if method.name not in UNWEIGHTED else honest <= silent * (1.0 + 1e-9)
