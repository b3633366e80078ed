"""Gated carving: bounds written out plainly, quantiles, steps, late readings that must not drill."""

from __future__ import annotations

import math

import numpy as np

from surfuse.fusing.cones import Beams, Nodes
from surfuse.fusion import carving

NODES = np.array([-0.02, -0.01, 0.0, 0.01, 0.02])


def test_bounds_are_the_spheres_over_each_node():
    rng = np.random.default_rng(0)
    starts = np.column_stack([rng.uniform(-0.03, 0.03, (50, 2)), np.full(50, 0.4)])
    ranges, spread = rng.uniform(0.39, 0.41, 50), 0.06
    beams = Beams(starts, np.tile([0.0, 0.0, -1.0], (50, 1)), ranges, np.full(50, spread))
    nodes = Nodes(NODES, NODES, np.ones((5, 5), dtype=bool))
    lowest, number, _ = carving.bounds(beams, np.full(50, 3e-4), nodes)
    for k, v in enumerate(NODES):
        for c, u in enumerate(NODES):
            plain = []
            for start, r in zip(starts, ranges, strict=True):
                side = math.hypot(u - start[0], v - start[1])
                if math.asin(side / r) <= spread:
                    plain.append(start[2] - math.sqrt(r * r - side * side))
            plain = sorted(plain)
            assert number[k, c] == len(plain)
            kept = min(len(plain), carving.DEEPEST)
            np.testing.assert_allclose(lowest[k, c, :kept], plain[:kept], atol=1e-12)


def test_the_envelope_is_a_quantile_of_the_bounds():
    lowest = np.full((1, 2, carving.DEEPEST), np.inf)
    lowest[0, 0] = np.arange(carving.DEEPEST) * 1e-3
    height, sigma = carving.envelope(lowest, np.array([[100, 0]]), np.array([[3e-4, np.inf]]), 0.05)
    assert height[0, 0] == 5e-3
    assert np.isnan(height[0, 1])
    assert sigma[0, 0] >= 2.5e-3


def test_a_facing_plate_with_late_readings_has_no_holes(cone_scan, mapped):
    scene, readings = cone_scan(lambda u, v: 0.0 * u, nu=16, nv=14, outlined=False, noise_m=3e-4, outliers=0.05, seed=1)
    gated = mapped("carving", scene, readings)
    assert gated.mask.mean() > 0.95
    assert np.nanmax(np.abs(gated.height_m)) < 0.0015
    drilled = mapped("carving", scene, readings, despike=False, quantile=0.0)
    assert np.nanmin(drilled.height_m) < -0.01


def test_the_edge_of_a_step_stays_where_it_is(cone_scan, mapped):
    scene, readings = cone_scan(lambda u, v: np.where(u > 0.0, 0.09, 0.0), nu=24, nv=12, outlined=False)
    surface = mapped("carving", scene, readings)
    low, high = surface.grid.u_m < -0.006, surface.grid.u_m > 0.006
    assert np.nanmedian(np.abs(surface.height_m[:, low])) < 0.002
    assert np.nanmedian(np.abs(surface.height_m[:, high] - 0.09)) < 0.001
    own = mapped("own_axis_median", scene, readings)
    beside = (surface.grid.u_m > -0.035) & (surface.grid.u_m < -0.006)
    assert np.nanmean(surface.height_m[:, beside]) < 0.3 * np.nanmean(own.height_m[:, beside])


def test_sensors_whose_axis_misses_the_part_do_not_eat_its_corners(cone_scan, mapped):
    # Beside the part there is a floor, 10 cm behind.
    def plate(u, v):
        return np.where((np.abs(u) <= 0.08) & (np.abs(v) <= 0.06), 0.0, -0.1)

    scene, readings = cone_scan(plate, nu=16, nv=12)
    surface = mapped("carving", scene, readings)
    assert surface.mask.any()
    assert np.nanmin(surface.height_m) > -0.004
