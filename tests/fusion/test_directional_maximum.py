"""Directional maximum: votes counted plainly, ties at their mean, plates and steps."""

from __future__ import annotations

import math

import numpy as np

from surfuse.fusing.cones import Beams, Nodes
from surfuse.fusing.voxels import Columns
from surfuse.fusion import directional_maximum

NODES = np.array([-0.02, -0.01, 0.0, 0.01, 0.02])


def test_votes_are_the_caps_through_each_voxel():
    rng = np.random.default_rng(0)
    starts = np.column_stack([rng.uniform(-0.02, 0.02, (6, 2)), np.full(6, 0.4)])
    ranges, spread = rng.uniform(0.38, 0.42, 6), 0.05
    beams = Beams(starts, np.tile([0.0, 0.0, -1.0], (6, 1)), ranges, np.full(6, spread))
    nodes = Nodes(NODES, NODES, np.ones((5, 5), dtype=bool))
    cast = directional_maximum.votes(beams, nodes, Columns(-0.03, 0.002, 40))
    plain = np.zeros_like(cast)
    for start, r in zip(starts, ranges, strict=True):
        for k, v in enumerate(NODES):
            for c, u in enumerate(NODES):
                side = math.hypot(u - start[0], v - start[1])
                if math.asin(side / r) <= spread:
                    w = start[2] - math.sqrt(r * r - side * side)
                    plain[k, c, math.floor((w + 0.03) / 0.002 + 0.5)] += 1
    np.testing.assert_array_equal(cast, plain)
    assert cast.sum() > 50


def test_most_votes_win_and_ties_meet_at_their_mean():
    cast = np.array([[[0, 5, 1, 0], [0, 3, 0, 3], [0, 0, 0, 0]]])
    height, sigma = directional_maximum.winners(cast, 0.1, 0.01)
    np.testing.assert_allclose(height[0, :2], [0.11, 0.12])
    assert math.isnan(height[0, 2])
    np.testing.assert_allclose(sigma[0, :2], [0.01 / math.sqrt(12), math.hypot(0.01, 0.01 / math.sqrt(12))])


def test_a_facing_plate_with_outliers(cone_scan, mapped):
    scene, readings = cone_scan(lambda u, v: 0.0 * u, nu=16, nv=14, outlined=False, noise_m=3e-4, outliers=0.05, seed=1)
    surface = mapped("directional_maximum", scene, readings)
    assert surface.mask.mean() > 0.9
    assert np.sqrt(np.nanmean(surface.height_m**2)) < 0.003


def test_both_levels_of_a_step_are_found_away_from_it(cone_scan, mapped):
    scene, readings = cone_scan(lambda u, v: np.where(u > 0.0, 0.06, 0.0), nu=20, nv=10, outlined=False)
    surface = mapped("directional_maximum", scene, readings)
    low, high = surface.grid.u_m < -0.06, surface.grid.u_m > 0.01
    assert np.nanmax(np.abs(surface.height_m[:, low])) < 0.004
    assert np.nanmax(np.abs(surface.height_m[:, high] - 0.06)) < 0.004
