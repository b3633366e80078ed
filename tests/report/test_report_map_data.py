import base64
import json
from dataclasses import replace

import numpy as np
import pytest

from surfuse.records import FusedPoints, Gap, Gate, Regime
from surfuse.report.map_data import group_data, legends, stop_data, stop_positions
from surfuse.report.packing import KINDS
from surfuse.report.scan_counts import count_scan


def numbers(packed, n):
    if packed["t"] == "c":
        return np.full(n, np.nan if packed["v"] is None else packed["v"])
    return np.frombuffer(base64.b64decode(packed["b"]), dtype=KINDS[packed["t"]]).astype(float)


def test_the_page_holds_the_map_in_millimetres(run_content):
    data = group_data(run_content.maps, run_content.truth, 10**6)
    surface, first = run_content.maps[0].surface, data["maps"][0]
    shape = (first["nv"], first["nu"])
    assert shape == surface.height_m.shape
    height = numbers(first["layers"]["height"], surface.height_m.size).reshape(shape)
    assert np.allclose(height, 1000 * surface.height_m, atol=1e-5, equal_nan=True)
    error = numbers(first["layers"]["error"], surface.height_m.size).reshape(shape)
    truth = run_content.truth.surface.height_m[::2, ::2]
    assert np.allclose(error, 1000 * (surface.height_m - truth), atol=1e-4, equal_nan=True)
    assert np.allclose(numbers(first["u"], first["nu"]), 1000 * surface.grid.u_m, atol=1e-5)


def test_a_cell_without_a_value_stays_without(run_content):
    data = group_data(run_content.maps, None, 10**6)["maps"][0]
    mask = run_content.maps[0].surface.mask.ravel()
    for name in ("height", "sigma"):
        assert np.array_equal(np.isfinite(numbers(data["layers"][name], mask.size)), mask)
    assert "error" not in data["layers"]


def test_truth_has_no_uncertainty_and_stands_last(run_content):
    data = group_data(run_content.maps, run_content.truth, 10**6)
    assert [one["truth"] for one in data["maps"]] == [False, False, False, True]
    assert set(data["maps"][-1]["layers"]) == {"height"}


def test_large_maps_are_thinned_to_the_budget_with_their_border(run_content):
    data = group_data(run_content.maps, None, 100)["maps"][1]
    assert data["stride"] > 1
    assert data["nu"] * data["nv"] < 200
    u = numbers(data["u"], data["nu"])
    assert u[0] == pytest.approx(-100, abs=1e-4)
    assert u[-1] == pytest.approx(100, abs=1e-4)


def test_colour_limits_hold_the_truth_and_error_limits_are_symmetric(run_content):
    spans = group_data(run_content.maps, run_content.truth, 10**6)["spans"]
    assert spans["height"][0] <= 0.0
    assert spans["height"][1] >= 90.0
    assert spans["error"][0] == -spans["error"][1]
    assert spans["confidence"] == [0.0, 1.0]


def test_one_outlier_does_not_rule_the_colours(run_content):
    named = run_content.maps[0]
    height = named.surface.height_m.copy()
    height[0, 0] = 50.0
    spiked = replace(named, surface=replace(named.surface, height_m=height))
    assert group_data((spiked,), None, 10**6)["spans"]["height"][1] < 1000


def test_stops_keep_factors_gates_and_ranges(run_content):
    points, readings = run_content.points, run_content.readings
    data = stop_data(points, readings, run_content.maps[0].surface.grid.world_from_part, 10**6)
    n = len(points.sensor)
    assert data["sensors"] == ["us0", "us1", "us2", "us3"]
    assert np.array_equal(numbers(data["gate"], n), points.gate)
    assert np.allclose(numbers(data["dc3"], n) / 65534, points.dc3, atol=1e-5)
    assert np.allclose(numbers(data["range"], n), 1000 * readings.range_m, atol=1e-3, equal_nan=True)


def test_a_gap_is_placed_where_the_grip_axis_meets_the_part(run_content):
    pose = run_content.maps[0].surface.grid.world_from_part
    uv = stop_positions(run_content.points, run_content.readings, pose)
    gaps = np.asarray(run_content.points.gap) != Gap.NONE
    assert gaps.any()
    assert np.allclose(uv, run_content.plan.stops_m, atol=1e-9)


def test_long_scans_are_thinned_by_whole_stops(run_content):
    pose = run_content.maps[0].surface.grid.world_from_part
    data = stop_data(run_content.points, run_content.readings, pose, 100)
    stride = data["stride"]
    assert stride == -(-len(run_content.points.sensor) // 100)
    assert data["stop"] == list(range(0, len(run_content.points), stride))
    assert data["start"] == [4 * k for k in range(len(data["stop"]) + 1)]
    wanted = run_content.points.gate.reshape(-1, 4)[::stride].ravel()
    assert np.array_equal(numbers(data["gate"], len(wanted)), wanted)


def test_points_without_readings_are_enough(run_content):
    data = stop_data(run_content.points, None, np.eye(4), 10**6)
    assert "range" not in data
    assert data["sensors"] == ["sensor 0", "sensor 1", "sensor 2", "sensor 3"]


def test_every_code_has_a_word_and_all_of_it_is_json(run_content):
    words = legends()
    assert len(words["gates"]) == len(Gate)
    assert len(words["gaps"]) == len(Gap)
    assert len(words["regimes"]) == len(Regime)
    group = group_data(run_content.maps, run_content.truth, 1000)
    json.dumps([words, group], allow_nan=False)


def test_counts_of_gates_and_gaps():
    points = FusedPoints(
        stop=[0, 1],
        row=[0, 0],
        depth_m=[0.4, np.nan],
        sigma_m=[0.1, np.nan],
        point_m=np.zeros((2, 3)),
        gap=[Gap.NONE, Gap.NO_VALID_READING],
        reset=[True, False],
        start=[0, 2, 3],
        sensor=[0, 1, 1],
        dc=np.ones(3),
        dc1=np.ones(3),
        dc2=np.ones(3),
        dc3=np.ones(3),
        gate=[Gate.PASSED, Gate.FAULT, Gate.NO_ECHO],
    )
    counts = count_scan(points, 3)
    assert counts.gates.shape == (3, len(Gate))
    assert counts.gates[0, Gate.PASSED] == counts.gates[1, Gate.FAULT] == counts.gates[1, Gate.NO_ECHO] == 1
    assert counts.gates.sum() == 3
    assert (counts.stops, counts.resets, counts.gaps[Gap.NO_VALID_READING]) == (2, 1, 1)
