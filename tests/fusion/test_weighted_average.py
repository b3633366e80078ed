from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from surfuse.errors import ConfigError, DataError
from surfuse.fusing import sweepwise
from surfuse.fusing.median_of_sweep import median_inflation
from surfuse.fusing.sweepwise import BLOCK
from surfuse.fusion import mean, median, weighted_average
from surfuse.fusion.weighted_average import Parameters, create
from surfuse.geometry.poses import inverse, pose, rotation_about
from surfuse.records import FusedPoints, FusionScene, Gap, Gate, MapGrid, Outline, Readings

GRID = MapGrid(np.zeros(1), np.zeros(1), np.eye(4))
Scan = Callable[..., tuple[FusionScene, Readings]]


def fuse(scene: FusionScene, readings: Readings, **changes: object) -> FusedPoints:
    return create(Parameters(**changes)).replay(scene, readings, GRID).points  # type: ignore[arg-type]


def box_distance(u: float, v: float, outline: Outline) -> float:
    """Signed distance to an axis-parallel box, positive inside: written without the library's polygons."""
    (u0, v0), (u1, v1) = outline.vertices_m.min(0), outline.vertices_m.max(0)
    du, dv = max(u0 - u, u - u1), max(v0 - v, v - v1)
    return -math.hypot(max(du, 0), max(dv, 0)) if max(du, dv) > 0 else -max(du, dv)


class Plain:
    """The method in plain Python for parallel axes along -w and a box outline: SPEC section 4 word by word."""

    def __init__(self, scene: FusionScene, p: Parameters) -> None:
        self.scene, self.p = scene, p
        self.window: list[tuple[float, float]] = []
        self.rate = dict.fromkeys(range(len(scene.specs)), 0.0)
        self.row: int | None = None

    def stop(self, sweep: object) -> tuple[float, list[float], bool]:
        p, s = self.p, sweep
        if s.row != self.row:
            self.row, self.window = s.row, []
        x = s.world_from_grip[0, 3]
        ok = []
        for k in range(len(s.sensor)):
            spec, r = self.scene.specs[s.sensor[k]], s.range_m[k]
            if not (math.isfinite(r) and s.status[k] == 0 and spec.range_min_m <= r <= spec.range_max_m):
                continue
            spread = math.tan(spec.beam_full_angle_rad / 2) * r
            d = box_distance(*s.position_m[k, :2], self.scene.outline) if self.scene.outline else math.inf
            if d >= -(p.gate_footprints * spread + p.gate_allowance_m):
                ok.append((k, r, d, spread))
        dc = [0.0] * len(s.sensor)
        if not ok:
            return math.nan, dc, False
        predicted = None
        if len(self.window) >= 2 and p.use_dc1:
            predicted = float(np.polyval(np.polyfit(*zip(*self.window, strict=True), 1), x))
        changed = predicted is not None and abs(np.mean([r for _, r, _, _ in ok]) - predicted) > p.change_m
        if changed:
            predicted, self.window = None, []
        for k, r, d, spread in ok:
            dc1 = dc2 = dc3 = 1.0
            if predicted is not None:
                dc1 = math.exp(-(((r - predicted) / p.prediction_scale_m) ** 2) / 2)
            others = [other for i, other, _, _ in ok if i != k]
            if p.use_dc2:
                off = abs(r - np.median(others)) if others else 0.0
                rate = self.rate[s.sensor[k]]
                rate += ((off > p.allowed_m) - rate) / p.error_memory
                self.rate[s.sensor[k]] = rate
                dc2 = (1 - rate) * math.exp(-((max(0.0, off - p.allowed_m) / p.allowed_m) ** 2) / 2)
            if p.use_dc3:
                dc3 = 1 / (1 + math.exp(-d / max(p.boundary_share * spread, p.boundary_floor_m)))
            dc[k] = dc1 * dc2 * dc3
        if sum(dc) == 0.0:
            return math.nan, dc, changed
        depth = sum(dc[k] * r for k, r, _, _ in ok) / sum(dc)
        self.window = [*self.window, (x, depth)][-3:]
        return depth, dc, changed


def steps(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.where(u > 0.01, 0.09, 0.0) + 0.2 * u


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "changes",
    [{}, {"use_dc1": False}, {"use_dc2": False}, {"use_dc3": False}, {"change_m": 9.0, "prediction_scale_m": 1e-3}],
)
def test_agrees_with_a_plain_implementation(scan: Scan, seed: int, changes: dict[str, float]) -> None:
    scene, readings = scan(steps, noise_m=0.002, missing=0.3, outliers=0.1, seed=seed)
    points = fuse(scene, readings, **changes)
    plain = Plain(scene, Parameters(**changes))  # type: ignore[arg-type]
    resets = 0
    for j in range(readings.n_sweeps):
        depth, dc, changed = plain.stop(readings.sweep(j))
        point = points.at(j)
        np.testing.assert_allclose(point.depth_m, depth, rtol=1e-9, atol=0)
        np.testing.assert_allclose(point.dc, dc, rtol=1e-8, atol=1e-200)
        assert point.reset == changed
        resets += changed
    if not changes:
        assert resets > 0


def test_equations_1_and_2_hold_for_what_is_recorded(scan: Scan) -> None:
    scene, readings = scan(steps, noise_m=0.001, missing=0.1)
    points = fuse(scene, readings)
    for j in range(len(points)):
        point, ranges = points.at(j), readings.sweep(j).range_m
        part = point.gate == Gate.PASSED
        np.testing.assert_array_equal(point.dc[part], (point.dc1 * point.dc2 * point.dc3)[part])
        assert np.all(point.dc[~part] == 0.0)
        assert np.all(np.isnan(point.dc1[~part]))
        if point.gap == Gap.NONE:
            average = np.sum(point.dc[part] * ranges[part]) / np.sum(point.dc[part])
            assert point.depth_m == pytest.approx(average, rel=1e-14)


def test_facing_plate_gives_half_the_sigma_of_a_reading_and_the_exact_distance(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: 0 * u, outlined=False)
    points = fuse(scene, readings)
    np.testing.assert_allclose(points.depth_m, 0.43, rtol=1e-15)
    np.testing.assert_allclose(points.sigma_m, 0.0003 / 2, rtol=1e-12)
    np.testing.assert_allclose(points.dc, 1.0, rtol=1e-12)
    np.testing.assert_allclose(points.point_m[:, 2], 0.0, atol=1e-15)
    np.testing.assert_allclose(points.point_m[:, :2], readings.world_from_grip[:, :2, 3], atol=1e-15)


def test_tilted_plate_is_exact_with_a_symmetric_array(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: np.tan(np.radians(20)) * u, outlined=False)
    points = fuse(scene, readings)
    np.testing.assert_allclose(points.point_m[:, 2], np.tan(np.radians(20)) * points.point_m[:, 0], atol=1e-12)
    assert not points.reset.any()


def test_a_step_is_rounded_over_the_width_of_the_array(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: np.where(u > 0.0, 0.09, 0.0), nu=21, nv=1, outlined=False)
    points = fuse(scene, readings)
    w, u = points.point_m[:, 2], points.point_m[:, 0]
    np.testing.assert_allclose(w[np.abs(u) > 0.0251], np.where(u > 0, 0.09, 0.0)[np.abs(u) > 0.0251], atol=1e-4)
    between = np.abs(u) < 0.0249
    assert np.all((w[between] > 0.004) & (w[between] < 0.086))
    assert points.reset.any()
    assert points.sigma_m[between].min() > 50 * points.sigma_m[0]


def test_each_factor_can_be_switched_off(scan: Scan) -> None:
    scene, readings = scan(steps, noise_m=0.002, outliers=0.2)
    for name in ("dc1", "dc2", "dc3"):
        on, off = fuse(scene, readings), fuse(scene, readings, **{f"use_{name}": False})
        assert np.nanmin(getattr(on, name)) < 0.9
        assert set(getattr(off, name)[off.gate == 0]) == {1.0}
        assert not np.allclose(on.depth_m, off.depth_m, atol=1e-6)
    bare = fuse(scene, readings, use_dc1=False, use_dc2=False, use_dc3=False)
    plain = mean.create(mean.Parameters()).replay(scene, readings, GRID).points
    np.testing.assert_allclose(bare.depth_m, plain.depth_m, rtol=1e-15)
    np.testing.assert_allclose(bare.sigma_m, plain.sigma_m, rtol=1e-12)


def test_dc1_punishes_what_leaves_the_line(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: 0.1 * u, nv=1, outlined=False)
    ranges = readings.range_m.copy()
    ranges[4 * 7 + 2] += 0.024
    points = fuse(scene, dataclasses.replace(readings, range_m=ranges), use_dc2=False)
    at = points.at(7)
    offset = 0.1 * 0.025
    assert at.dc1[2] == pytest.approx(math.exp(-(((0.024 + offset) / 0.012) ** 2) / 2), rel=1e-6)
    assert at.dc1[[0, 1, 3]].min() > 0.97


def test_change_of_surface_starts_the_window_afresh_and_punishes_no_reading(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: np.where(u > 0.0, 0.2, 0.0), nv=1, outlined=False)
    points = fuse(scene, readings, use_dc2=False)
    first = int(np.argmax(points.reset))
    assert first > 2
    np.testing.assert_array_equal(points.at(first).dc1, 1.0)
    # One point in the window: still no prediction, full confidence.
    np.testing.assert_array_equal(points.at(first + 1).dc1, 1.0)


def test_new_row_starts_afresh(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: np.where(v > -0.001, 0.015, 0.0) + 0.0 * u, nv=2, outlined=False)
    points = fuse(scene, readings, use_dc2=False)
    second = int(np.argmax(readings.row == 1))
    for j in (0, 1, second, second + 1):
        np.testing.assert_array_equal(points.at(j).dc1, 1.0)
    assert points.at(second + 2).dc1.min() < 1.0


def test_dc2_learns_a_sensor_that_lies(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: 0 * u, nu=40, nv=1, outlined=False)
    ranges = readings.range_m.copy()
    ranges[2::4] += 0.06
    points = fuse(scene, dataclasses.replace(readings, range_m=ranges), use_dc1=False)
    lying = points.dc2.reshape(-1, 4)[:, 2]
    assert np.all(np.diff(lying) < 0.0)
    step = math.exp(-((0.035 / 0.025) ** 2) / 2)
    np.testing.assert_allclose(lying, step * 0.95 ** np.arange(1, 41), rtol=1e-9)
    np.testing.assert_allclose(points.dc2.reshape(-1, 4)[:, [0, 1, 3]], 1.0, rtol=1e-12)
    # It recovers once it tells the truth: the error rate is forgotten.
    ranges[2::4][20:] = 0.43
    points = fuse(scene, dataclasses.replace(readings, range_m=ranges), use_dc1=False)
    assert np.all(np.diff(points.dc2.reshape(-1, 4)[20:, 2]) > 0.0)


def test_dc3_is_a_half_on_the_outline_and_falls_to_both_sides(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: 0 * u, nu=12, nv=9)
    box = np.array([[-0.035, -9.0], [9.0, -9.0], [9.0, 9.0], [-0.035, 9.0]])
    scene = dataclasses.replace(scene, outline=Outline(box, np.eye(4)))
    points = fuse(scene, readings)
    d = readings.position_m[:, 0] + 0.035
    scale = 0.25 * 0.43 * math.tan(math.radians(6.5))
    np.testing.assert_allclose(points.dc3, 1 / (1 + np.exp(-d / scale)), rtol=1e-12)


def test_outline_with_hole_and_margin_and_frame_of_its_own(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: 0 * u, outlined=False)
    big = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    hole = np.array([[0.0, -0.5], [0.5, -0.5], [0.5, 0.5], [0.0, 0.5]])
    plain = fuse(dataclasses.replace(scene, outline=Outline(big, np.eye(4), holes_m=(hole,))), readings)
    scale = 0.25 * 0.43 * math.tan(math.radians(6.5))
    expected = 1 / (1 + np.exp(readings.position_m[:, 0] / scale))
    passed = plain.gate == Gate.PASSED
    np.testing.assert_allclose(plain.dc3[passed], expected[passed], rtol=1e-9)
    turned = pose(rotation_about([0, 0, 1], 0.3), [0.1, -0.2, 0.0])

    def seen(ring: np.ndarray) -> np.ndarray:
        return (np.c_[ring, np.zeros(4), np.ones(4)] @ inverse(turned).T)[:, :2]

    outline = Outline(seen(big), turned, holes_m=(seen(hole),))
    np.testing.assert_allclose(fuse(dataclasses.replace(scene, outline=outline), readings).dc3, plain.dc3, rtol=1e-9)
    # An enlarged outline counts as what it was before: 5 cm of margin moves the boundary back by 5 cm.
    enlarged = Outline(np.array([[-0.05, -9], [9, -9], [9, 9], [-0.05, 9]]), np.eye(4), margin_m=0.05)
    d = readings.position_m[:, 0]
    points = fuse(dataclasses.replace(scene, outline=enlarged), readings)
    near = points.gate == Gate.PASSED
    assert 0.5 < near.mean() < 1.0
    np.testing.assert_allclose(points.dc3[near], (1 / (1 + np.exp(-d / scale)))[near], rtol=1e-9)


def test_no_confidence_is_a_gap_with_its_reason(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: np.where(u > 0.0, 0.2, 0.0), nv=1, outlined=False)
    points = fuse(scene, readings, change_m=9.0, prediction_scale_m=1e-4)
    lost = points.gap == Gap.NO_CONFIDENCE
    assert lost.any()
    assert np.all(np.isnan(points.depth_m[lost]))
    assert np.all(np.isnan(points.point_m[lost]))
    assert np.all(points.gate == Gate.PASSED)


def moved(scene: FusionScene, readings: Readings, motion: np.ndarray) -> tuple[FusionScene, Readings]:
    outline = scene.outline
    if outline is not None:
        outline = dataclasses.replace(outline, world_from_part=motion @ outline.world_from_part)
    scene = dataclasses.replace(scene, world_from_part=motion @ scene.world_from_part, outline=outline)
    readings = dataclasses.replace(
        readings,
        position_m=readings.position_m @ motion[:3, :3].T + motion[:3, 3],
        axis=readings.axis @ motion[:3, :3].T,
        world_from_grip=motion @ readings.world_from_grip,
    )
    return scene, readings


@pytest.mark.parametrize("method", [create(Parameters()), mean.create(mean.Parameters())])
def test_moving_the_world_changes_nothing_in_the_part_frame(scan: Scan, method: object) -> None:
    scene, readings = scan(steps, noise_m=0.001, missing=0.1)
    motion = pose(rotation_about([0.3, -1.0, 0.5], 2.1), [1.0, -2.0, 0.7])
    before = method.replay(scene, readings, GRID).points
    after = method.replay(*moved(scene, readings, motion), GRID).points
    np.testing.assert_allclose(after.point_m, before.point_m, atol=1e-12)
    np.testing.assert_allclose(after.dc, before.dc, atol=1e-8)
    np.testing.assert_array_equal(after.gate, before.gate)


def test_order_of_the_sensors_does_not_matter(scan: Scan) -> None:
    scene, readings = scan(steps, noise_m=0.001, missing=0.1)
    order = np.random.default_rng(1).permuted(np.arange(len(readings.t_s)).reshape(-1, 4), axis=1).ravel()
    columns = ("sensor", "position_m", "axis", "range_m", "status")
    shuffled = dataclasses.replace(readings, **{name: getattr(readings, name)[order] for name in columns})
    before, after = fuse(scene, readings), fuse(scene, shuffled)
    np.testing.assert_allclose(after.depth_m, before.depth_m, rtol=1e-12)
    np.testing.assert_allclose(after.dc, before.dc[order], rtol=1e-9)


def test_readings_off_the_grip_plane_and_oblique_axes_are_projected_on_the_grip_axis(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: 0 * u, outlined=False)
    rng = np.random.default_rng(2)
    # Sensors pushed back along their axes by up to 5 cm and turned by up to 10 degrees, over the plane w = 0.
    axis = rng.normal([0, 0, -1], 0.1, (len(readings.t_s), 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    position = readings.position_m + rng.uniform(0, 0.05, (len(axis), 1)) * [0, 0, 1]
    ranges = position[:, 2] / -axis[:, 2]
    points = fuse(scene, dataclasses.replace(readings, position_m=position, axis=axis, range_m=ranges))
    np.testing.assert_allclose(points.point_m[:, 2], 0.0, atol=1e-12)


def test_prediction_holds_when_the_grip_changes_its_distance(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: 0 * u, nv=1, outlined=False)
    lift = np.where(np.arange(readings.n_sweeps) % 2 == 0, 0.05, 0.0)
    grip = readings.world_from_grip.copy()
    grip[:, 2, 3] += lift
    position = readings.position_m.copy()
    position[:, 2] += np.repeat(lift, 4)
    lifted = dataclasses.replace(
        readings, world_from_grip=grip, position_m=position, range_m=readings.range_m + np.repeat(lift, 4)
    )
    points = fuse(scene, lifted)
    assert not points.reset.any()
    np.testing.assert_allclose(points.dc1, 1.0, rtol=1e-9)


def test_the_readings_own_sigma_is_used_where_the_log_has_one(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: 0 * u, outlined=False)
    sigma = np.full(len(readings.t_s), np.nan)
    sigma[:4], sigma[4:8] = 0.002, [0.001, 0.0, np.nan, np.inf]
    points = fuse(scene, dataclasses.replace(readings, sigma_m=sigma))
    assert points.sigma_m[0] == pytest.approx(0.001)
    assert points.sigma_m[1] == pytest.approx(math.sqrt(0.001**2 + 3 * 0.0003**2) / 4)
    assert points.sigma_m[2] == pytest.approx(0.00015)


def test_unknown_sensor_and_foreign_state_are_refused(scan: Scan) -> None:
    scene, readings = scan(lambda u, v: 0 * u)
    method = create(Parameters())
    few = dataclasses.replace(scene, specs=scene.specs[:2])
    with pytest.raises(DataError, match="sensor 2"):
        method.replay(few, readings, GRID)
    with pytest.raises(DataError, match="sensor 2"):
        method.step(method.start(few), readings.sweep(0))
    with pytest.raises(DataError, match="start"):
        method.step(None, readings.sweep(0))


@pytest.mark.parametrize(
    ("name", "value"),
    [("change_m", 0.0), ("allowed_m", -1.0), ("error_memory", 0.5), ("prediction_scale_m", math.nan),
     ("gate_allowance_m", -0.1), ("boundary_share", -1.0), ("boundary_floor_m", 0.0)],
)  # fmt: skip
def test_parameters_out_of_their_limits_are_named(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=name):
        Parameters(**{name: value})


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6, 9, 16])
def test_variance_of_the_median(n: int) -> None:
    samples = np.random.default_rng(n).standard_normal((200_000, n))
    assert median_inflation(n) == pytest.approx(np.median(samples, axis=1).var() * n, rel=0.015)


def test_baselines_are_mean_and_median(scan: Scan) -> None:
    scene, readings = scan(steps, noise_m=0.002, missing=0.2, outliers=0.2)
    by_mean = mean.create(mean.Parameters()).replay(scene, readings, GRID).points
    by_median = median.create(median.Parameters()).replay(scene, readings, GRID).points
    for j in range(readings.n_sweeps):
        valid = readings.sweep(j).range_m[by_mean.at(j).gate == Gate.PASSED]
        if len(valid):
            assert by_mean.depth_m[j] == pytest.approx(np.mean(valid), rel=1e-13)
            assert by_median.depth_m[j] == pytest.approx(np.median(valid), rel=1e-13)
            if len(valid) > 1:
                error = np.std(valid, ddof=1) / math.sqrt(len(valid))
                assert by_mean.sigma_m[j] == pytest.approx(max(error, 0.0003 / math.sqrt(len(valid))), rel=1e-9)
        else:
            assert by_mean.gap[j] == by_median.gap[j] != Gap.NONE


@pytest.mark.parametrize("module", [weighted_average, mean, median])
def test_blocks_of_stops_leave_no_seam(scan: Scan, module: ModuleType) -> None:
    scene, readings = scan(steps, nu=60, nv=10, noise_m=0.002, missing=0.3, outliers=0.1)
    assert readings.n_sweeps > 2 * BLOCK
    method = module.create(module.Parameters())
    whole, state = method.replay(scene, readings, GRID).points, method.start(scene)
    for j in range(readings.n_sweeps):
        method.step(state, readings.sweep(j))
    stepped = method.finish(state, GRID).points
    for field in dataclasses.fields(whole):
        assert getattr(whole, field.name).tobytes() == getattr(stepped, field.name).tobytes(), field.name


def test_lines_on_several_threads_give_the_same_bits(scan, monkeypatch):
    scene, readings = scan(
        lambda u, v: 0.02 * u + 0.03 * (v > 0.0), nu=9, nv=7, missing=0.1, outliers=0.1, noise_m=1e-3
    )
    grid = MapGrid(np.zeros(1), np.zeros(1), np.eye(4))
    method = weighted_average.create(weighted_average.Parameters())
    alone = method.replay(scene, readings, grid).points
    monkeypatch.setattr(sweepwise, "LEAST_PIECE", 5)
    monkeypatch.setattr(weighted_average.os, "cpu_count", lambda: 4)
    pieces = sweepwise.pieces_at_lines(readings.row, 4)
    assert len(pieces) == 4
    assert all(readings.row[first] != readings.row[first - 1] for first, _ in pieces[1:])
    together = method.replay(scene, readings, grid).points
    for name in alone.__dataclass_fields__:
        assert getattr(together, name).tobytes() == getattr(alone, name).tobytes(), name


def test_a_scan_of_one_line_is_one_piece():
    assert sweepwise.pieces_at_lines(np.zeros(100_000, dtype=np.int64), 8) == [(0, 100_000)]
