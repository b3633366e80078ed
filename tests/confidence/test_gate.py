from __future__ import annotations

import math

import numpy as np
import pytest

from surfuse.confidence.gate import GateParameters, limits_of, validate, without_needless_vertices
from surfuse.errors import ConfigError
from surfuse.geometry.polygons import signed_distance
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FusionScene, Gate, Outline, SensorSpec, Status, Sweep
from surfuse.records.kernel_columns import empty_points, scan_of

SPEC = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 0.0003)
BOX = Outline(np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]), np.eye(4))
FACING = pose(rotation_about([1, 0, 0], np.pi), [0, 0, 0.43])


def codes(
    ranges: list[float],
    *,
    status: list[int] | None = None,
    position: np.ndarray | None = None,
    axis: np.ndarray | None = None,
    outline: Outline | None = BOX,
    depth_max_m: float = math.inf,
    parameters: GateParameters | None = None,
) -> tuple[list[int], np.ndarray]:
    n = len(ranges)
    if position is None:
        position = np.tile([0.0, 0.0, 0.43], (n, 1))
    if axis is None:
        axis = np.tile([0.0, 0.0, -1.0], (n, 1))
    sweep = Sweep(
        stop=0, row=0, world_from_grip=FACING, t_s=np.zeros(n), sensor=np.arange(n), position_m=position, axis=axis,
        range_m=ranges, status=np.zeros(n) if status is None else status, amplitude=np.ones(n),
        spread_m=np.full(n, np.nan), count=np.ones(n),
    )  # fmt: skip
    scene = FusionScene((SPEC,) * n, np.eye(4), outline, depth_max_m)
    out, value = empty_points(1, n), np.full(n, np.nan)
    limits = limits_of(scene, parameters or GateParameters())
    validate(scan_of(sweep), limits, (0, 1), out.gate, value, np.empty(n), np.empty(n))
    return out.gate.tolist(), value


def test_the_sensors_own_word_comes_first_and_keeps_its_code() -> None:
    got, _ = codes([math.inf, -math.inf, math.nan, 0.43, 0.43, 0.43, 0.43], status=[1, 2, 3, 0, 1, 2, 3])
    assert got == [Gate.NO_ECHO, Gate.TOO_CLOSE, Gate.FAULT, Gate.PASSED, Gate.NO_ECHO, Gate.TOO_CLOSE, Gate.FAULT]


def test_an_infinite_range_is_no_number_whatever_the_status_says() -> None:
    assert codes([math.inf, -math.inf, math.nan])[0] == [Gate.NO_ECHO, Gate.TOO_CLOSE, Gate.FAULT]


def test_range_limits_belong_to_the_range() -> None:
    got, _ = codes([0.2, 0.1999, 1.2, 1.2001, 0.0, -0.3])
    assert got == [Gate.PASSED, Gate.OUT_OF_RANGE, Gate.PASSED] + [Gate.OUT_OF_RANGE] * 3


def test_nothing_lies_behind_the_cell_or_behind_the_grip() -> None:
    assert codes([0.5, 0.51], depth_max_m=0.5)[0] == [Gate.PASSED, Gate.BEHIND_CELL]
    backwards = np.array([[0.0, 0.0, 1.0]])
    assert codes([0.43], axis=backwards, outline=None)[0] == [Gate.BEHIND_CELL]


def test_a_pose_that_is_not_finite_is_a_fault() -> None:
    position = np.array([[math.nan, 0.0, 0.43], [0.0, 0.0, 0.43]])
    assert codes([0.43, 0.43], position=position)[0] == [Gate.FAULT, Gate.PASSED]


def test_only_what_is_clearly_outside_is_refused() -> None:
    spread = 0.43 * math.tan(math.radians(6.5))
    limit = 0.1 + spread + 0.010
    u = [0.0, 0.0999, 0.12, limit - 1e-6, limit + 1e-6, 0.5]
    position = np.column_stack([u, np.zeros(6), np.full(6, 0.43)])
    got, _ = codes([0.43] * 6, position=position)
    assert got == [Gate.PASSED] * 4 + [Gate.OUTSIDE_PART] * 2
    assert codes([0.43] * 6, position=position, outline=None)[0] == [Gate.PASSED] * 6
    strict = GateParameters(gate_footprints=0.0, gate_allowance_m=0.0)
    assert codes([0.43] * 6, position=position, parameters=strict)[0] == [Gate.PASSED] * 2 + [Gate.OUTSIDE_PART] * 4


def test_the_outline_is_that_of_the_part_before_its_margin() -> None:
    enlarged = Outline(BOX.vertices_m * 1.2, np.eye(4), margin_m=0.02)
    position = np.column_stack([np.linspace(-0.2, 0.2, 81), np.zeros(81), np.full(81, 0.43)])
    assert codes([0.43] * 81, position=position, outline=enlarged)[0] == codes([0.43] * 81, position=position)[0]


def test_inside_a_hole_nothing_is_on_the_part_whichever_hole_it_is() -> None:
    square = 0.01 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    holed = Outline(BOX.vertices_m, np.eye(4), holes_m=tuple(square + np.array([u, 0.0]) for u in (-0.06, 0.06)))
    position = np.column_stack([[-0.06, 0.0, 0.06], np.zeros(3), np.full(3, 0.43)])
    strict = GateParameters(gate_footprints=0.0, gate_allowance_m=0.0)
    got, _ = codes([0.43] * 3, position=position, outline=holed, parameters=strict)
    assert got == [Gate.OUTSIDE_PART, Gate.PASSED, Gate.OUTSIDE_PART]


@pytest.mark.parametrize("tilt_deg", [0.0, 40.0])
def test_sigma_is_the_stated_one_or_the_sensor_s_seen_along_the_grip_axis(tilt_deg: float) -> None:
    tilt = math.radians(tilt_deg)
    stated = np.array([0.002, 0.0007, math.nan, math.inf, 0.0])
    sweep = Sweep(
        stop=0, row=0, world_from_grip=FACING, t_s=np.zeros(5), sensor=np.arange(5),
        position_m=np.tile([0.0, 0.0, 0.43], (5, 1)), axis=np.tile([math.sin(tilt), 0.0, -math.cos(tilt)], (5, 1)),
        range_m=np.full(5, 0.43), status=np.zeros(5), amplitude=np.ones(5), spread_m=np.full(5, np.nan),
        count=np.ones(5), sigma_m=stated,
    )  # fmt: skip
    limits = limits_of(FusionScene((SPEC,) * 5, np.eye(4)), GateParameters())
    out, sigma = empty_points(1, 5), np.empty(5)
    validate(scan_of(sweep), limits, (0, 1), out.gate, np.empty(5), sigma, np.empty(5))
    known = np.where((stated > 0.0) & np.isfinite(stated), stated, SPEC.sigma_m)
    np.testing.assert_allclose(sigma, known * math.cos(tilt))


def test_footprint_is_where_the_surface_was_met() -> None:
    tilt = math.radians(45.0)
    axis = np.array([[math.sin(tilt), 0.0, -math.cos(tilt)]] * 2)
    position = np.tile([-0.3, 0.0, 0.43], (2, 1))
    assert codes([0.43, 0.75], axis=axis, position=position)[0] == [Gate.PASSED, Gate.OUTSIDE_PART]


def test_value_is_the_hit_points_place_on_the_grip_axis() -> None:
    axis = np.array([[0.0, 0.0, -1.0], [0.0, math.sin(0.3), -math.cos(0.3)]])
    position = np.array([[0.02, 0.0, 0.43], [0.0, -0.1, 0.40]])
    _, value = codes([0.41, 0.42], axis=axis, position=position)
    np.testing.assert_allclose(value, [0.41, 0.42 * math.cos(0.3) + 0.03], rtol=1e-15)


@pytest.mark.parametrize("value", [-1.0, math.nan])
def test_gate_parameters_are_checked(value: float) -> None:
    with pytest.raises(ConfigError, match="gate_footprints"):
        GateParameters(gate_footprints=value)


def test_needless_vertices_go_and_the_boundary_stays() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)
    circle = 0.1 * np.column_stack([np.cos(angle), np.sin(angle)])
    edge = np.linspace(-0.1, 0.1, 100, endpoint=False)
    box = np.concatenate([np.c_[edge, 0 * edge - 0.1], np.c_[0 * edge + 0.1, edge], np.c_[-edge, 0 * edge + 0.1],
                          np.c_[0 * edge - 0.1, -edge]])  # fmt: skip
    points = np.random.default_rng(0).uniform(-0.15, 0.15, (300, 2))
    assert len(without_needless_vertices(np.roll(box, 37, axis=0))) <= 5
    for ring in (circle, box):
        kept = without_needless_vertices(ring)
        assert 4 <= len(kept) < len(ring)
        np.testing.assert_allclose(signed_distance(points, kept), signed_distance(points, ring), atol=21e-6)


def test_status_codes_are_those_of_the_records() -> None:
    assert [int(s) for s in (Status.OK, Status.NO_ECHO, Status.TOO_CLOSE, Status.FAULT)] == [0, 1, 2, 3]
