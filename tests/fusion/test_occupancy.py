"""Occupancy: the sonar model written out plainly, sums of log-odds, crossings, plates and steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surfuse.fusing.cones import Beams, Nodes
from surfuse.fusing.sonar_model import evidence, squared_angle
from surfuse.fusing.voxels import Columns
from surfuse.fusion import occupancy

NODES = np.array([-0.02, -0.01, 0.0, 0.01, 0.02])


def plain_log_odds(starts, ranges, spread, delta, bottom, size, count, alpha0, other):
    """Cones that look along -w, voxel by voxel, straight from the formulas."""
    odds = np.zeros((5, 5, count))
    for start, r in zip(starts, ranges, strict=True):
        weights = 0.0
        for v in NODES:
            for u in NODES:
                side = math.hypot(u - start[0], v - start[1])
                angle = math.asin(side / r) / spread
                weights += max(0.0, 1.0 - angle**2)
        for k, v in enumerate(NODES):
            for c, u in enumerate(NODES):
                side = math.hypot(u - start[0], v - start[1])
                for q in range(count):
                    drop = start[2] - bottom - q * size
                    z, angle = math.hypot(side, drop), math.atan2(side, drop) / spread
                    if angle >= 1.0:
                        continue
                    alpha, x = alpha0 * (1 - angle**2), (r - z) / delta
                    if x < -4:
                        continue
                    normal = math.exp(-0.5 * x * x) / (math.sqrt(2 * math.pi) * delta) if x <= 4 else 0.0
                    below = 0.5 * (1 + math.erf(x / math.sqrt(2))) if x <= 4 else 1.0
                    odds[k, c, q] += math.log(1 + alpha * normal / max(weights, 1) / other) + math.log(
                        1 - alpha * below
                    )
    return odds


def test_log_odds_are_the_sums_of_the_plain_model():
    starts = np.array([[0.0, 0.0, 0.4], [0.013, -0.004, 0.41], [-0.01, 0.02, 0.39]])
    ranges, spread, delta = np.array([0.4, 0.405, 0.395]), 0.05, 0.002
    beams = Beams(starts, np.tile([0.0, 0.0, -1.0], (3, 1)), ranges, np.full(3, spread))
    nodes = Nodes(NODES, NODES, np.ones((5, 5), dtype=bool))
    found = occupancy.log_odds(beams, np.full(3, delta), nodes, Columns(-0.02, 0.002, 25), 0.6, 10.0)
    np.testing.assert_allclose(
        found, plain_log_odds(starts, ranges, spread, delta, -0.02, 0.002, 25, 0.6, 10.0), atol=2e-5
    )


def test_one_reading_empties_its_front_fills_its_shell_and_leaves_its_back():
    assert evidence(0.3, 0.4, 0.6, 0.1, 0.001, 10.0) == pytest.approx(math.log(0.4))
    assert evidence(0.4, 0.4, 0.6, 0.1, 0.001, 10.0) > 0.3
    assert evidence(0.5, 0.4, 0.6, 0.1, 0.001, 10.0) == 0.0


def test_squared_angle_series():
    angles = np.radians([0.0, 1.0, 6.5, 20.0, 45.0, 60.0])
    found = [squared_angle(float(np.cos(a))) for a in angles]
    np.testing.assert_allclose(found, angles**2, rtol=2e-3, atol=1e-12)


def test_the_surface_is_the_first_maximum_below_the_first_occupied_voxel():
    column = np.array([9.0, -2.0, 1.0, 4.0, 3.0, -1.0, -5.0])
    height, sigma = occupancy.crossing(column, 0.1, 0.01)
    # The parabola through 1, 4, 3 has its vertex a quarter of a voxel above the middle one.
    assert height == pytest.approx(0.1 + 0.03 + 0.01 * 0.25)
    assert 0.01 / math.sqrt(12) < sigma < 0.01
    assert math.isnan(occupancy.crossing(-np.ones(5), 0.0, 0.01)[0])


def test_a_facing_plate_is_found_within_a_voxel_or_two(cone_scan, mapped):
    scene, readings = cone_scan(lambda u, v: 0.0 * u, nu=16, nv=14, outlined=False, noise_m=3e-4, outliers=0.05, seed=1)
    surface = mapped("occupancy", scene, readings)
    assert surface.mask.mean() > 0.9
    assert np.sqrt(np.nanmean(surface.height_m**2)) < 0.0025
    assert np.all(surface.sigma_m[surface.mask] >= 0.001)


def test_a_light_sensor_fills_only_the_column_that_it_meets(scan, mapped):
    import dataclasses

    scene, readings = scan(lambda u, v: np.where(u > 0.0, 0.05, 0.0), nu=14, nv=10, outlined=False)
    light = tuple(dataclasses.replace(spec, kind="laser") for spec in scene.specs)
    scene, readings = dataclasses.replace(scene, specs=light), dataclasses.replace(readings, specs=light)
    surface = mapped("occupancy", scene, readings)
    left, right = surface.grid.u_m < -0.011, surface.grid.u_m > 0.011
    assert np.nanmax(np.abs(surface.height_m[:, left])) < 0.002
    assert np.nanmax(np.abs(surface.height_m[:, right] - 0.05)) < 0.002
