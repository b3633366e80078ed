"""From readings to the places from which the surface was heard: which count, from where, and what is merged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surfuse.beam_model.heard.stations import gather, usable


def flat(u, v):
    return 0.0 * u


def test_a_dead_length_moves_the_place_to_the_mouth_of_the_tube_and_no_point(scan):
    scene, readings = scan(flat, nu=5, nv=3)
    tubes = replace(readings, specs=tuple(replace(spec, dead_length_m=0.12) for spec in readings.specs))
    plain, behind = gather(readings, scene), gather(tubes, scene)
    np.testing.assert_allclose(behind.foot_m, plain.foot_m, atol=1e-12)
    np.testing.assert_allclose(behind.position_m, plain.position_m + 0.12 * plain.axis, atol=1e-12)
    np.testing.assert_allclose(behind.range_m, plain.range_m - 0.12, atol=1e-12)


def test_what_looks_away_or_along_the_part_is_not_used(scan):
    scene, readings = scan(flat, nu=5, nv=3)
    assert usable(readings, scene).all()
    axis = readings.axis.copy()
    for k, direction in enumerate(([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, -0.09])):
        axis[k] = np.array(direction) / np.linalg.norm(direction)
    assert np.flatnonzero(~usable(replace(readings, axis=axis), scene)).tolist() == [0, 1, 2]


@pytest.mark.parametrize("depth_max_m", [0.5, 1.0, np.inf])
def test_a_range_counts_within_the_limits_of_its_sensor_and_of_the_cell(scan, depth_max_m):
    scene, readings = scan(flat, nu=5, nv=3)
    low, high = readings.specs[0].range_min_m, readings.specs[0].range_max_m
    ranges = readings.range_m.copy()
    ranges[:7] = (low - 1e-6, low, high, high + 1e-6, 0.5, 0.75, np.nan)
    found = usable(replace(readings, range_m=ranges), replace(scene, depth_max_m=depth_max_m))
    most = min(high, depth_max_m)
    assert found[:7].tolist() == [False, True, high <= most, False, most >= 0.5, most >= 0.75, False]
    assert found[7:].all()


def test_repeats_at_one_place_are_one_station_with_the_mean_of_those_that_agree(scan):
    scene, readings = scan(flat, nu=5, nv=3)
    many = replace(
        readings,
        **{name: np.tile(getattr(readings, name), (5, *[1] * (getattr(readings, name).ndim - 1)))
           for name in ("t_s", "sensor", "position_m", "axis", "status", "amplitude", "sigma_m", "count", "spread_m",
                        "stop", "row", "world_from_grip")},
        range_m=np.tile(readings.range_m, 5) + np.repeat([-0.001, 0.0, 0.0, 0.001, 0.05], len(readings.range_m)),
        start=np.arange(5 * readings.n_sweeps + 1) * 4,
    )  # fmt: skip
    once, merged = gather(readings, scene), gather(many, scene)
    assert len(merged) == len(once)
    # Overlapping squares of sensors meet at one place too: there more than five are merged.
    assert np.all(merged.count == 4 * once.count)
    np.testing.assert_allclose(merged.range_m, once.range_m, atol=1e-9)
    np.testing.assert_allclose(merged.sigma_m, once.sigma_m / 2.0, rtol=1e-9)
    assert np.all((merged.of_reading < 0) == (many.range_m > readings.range_m.max() + 0.02))
