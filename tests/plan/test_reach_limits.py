"""A stop is reached exactly when every distance is known and at least its limit."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, READY_RAD, STAND_HEIGHT_M, Puma560
from surfuse.geometry.poses import pose
from surfuse.motion.clearance import Clearances
from surfuse.plan.raster import grip_targets
from surfuse.plan.reach import ReachParameters, reach
from surfuse.records import FloatArray

BASE, TOOL = pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M])
ARM = Puma560(BASE, TOOL)
PART = pose(np.column_stack([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]), [1.05, 0.0, 1.0])
UV = np.column_stack([np.linspace(-0.25, 0.25, 21), np.linspace(0.0, 0.5, 21)])
TARGETS = grip_targets(PART, UV)


def clear(joints_rad: FloatArray) -> Clearances:
    n = len(joints_rad)
    return Clearances(np.full(n, 1.0), np.zeros(n, int), np.zeros(n, int), ("rod",), ("the wall",))


def test_all_stops_at_least_so_far_from_a_singularity_are_reached_and_no_others() -> None:
    everywhere = reach(TARGETS, ARM, READY_RAD, None, ReachParameters(singularity_min=0.0))
    assert everywhere.reached.all()
    away = ARM.singularity_distance(everywhere.joints_rad).min(axis=1)
    for limit in np.quantile(away, [0.1, 0.5, 0.9]):
        checked = reach(TARGETS, ARM, READY_RAD, None, ReachParameters(singularity_min=limit))
        # The same configuration: another one may be further from a singularity and reach more.
        same = np.nanmax(np.abs(checked.joints_rad - everywhere.joints_rad)) < 1e-9
        kept = away if same else ARM.singularity_distance(checked.joints_rad[checked.reached]).min(axis=1)
        if same:
            np.testing.assert_array_equal(checked.reached, away >= limit)
        assert kept[checked.reached if same else slice(None)].min() >= limit
        assert all(why.startswith("singularity: ") for why in np.array(checked.reason)[~checked.reached])


def test_an_unknown_distance_to_a_singularity_is_no_reason_to_go_there() -> None:
    class Unsure(Puma560):
        def singularity_distance(self, joints_rad: FloatArray) -> FloatArray:
            away = super().singularity_distance(joints_rad).copy()
            away[7] = np.nan
            return away

    checked = reach(TARGETS, Unsure(BASE, TOOL), READY_RAD, None, ReachParameters(singularity_min=0.0))
    assert np.flatnonzero(~checked.reached).tolist() == [7]
    assert np.isnan(checked.joints_rad[7]).all()


@pytest.mark.parametrize(("distance_m", "reached"), [(0.0051, True), (0.0049, False), (np.nan, False)])
def test_the_least_clearance_of_a_stop_is_the_limit(distance_m: float, reached: bool) -> None:
    def one_is_near(joints_rad: FloatArray) -> Clearances:
        found = clear(joints_rad)
        there = np.all(np.abs(joints_rad - wanted) < 1e-9, axis=1)
        return Clearances(np.where(there, distance_m, 1.0), found.part, found.obstacle, found.parts, found.obstacles)

    wanted = reach(TARGETS, ARM, READY_RAD, None).joints_rad[4]
    assert reach(TARGETS, ARM, READY_RAD, one_is_near).reached.tolist() == [reached or i != 4 for i in range(21)]


@pytest.mark.parametrize("resolution_rad", [0.02, 0.004])
def test_the_ways_between_stops_are_looked_at_everywhere(resolution_rad: float) -> None:
    asked: list[FloatArray] = []

    def noting(joints_rad: FloatArray) -> Clearances:
        asked.append(np.array(joints_rad))
        return clear(joints_rad)

    found = reach(TARGETS, ARM, READY_RAD, noting, ReachParameters(path_resolution_rad=resolution_rad))
    assert found.reached.all()
    # The last question is that for the ways; between the stops it goes on in their order.
    places, stops = asked[-1], found.joints_rad
    assert len(places) > len(stops)
    for start, end in pairwise(stops):
        way = end - start
        share = (places - start) @ way / (way @ way)
        on_the_way = (np.abs(places - start - share[:, None] * way).max(axis=1) < 1e-9) & (share > 0) & (share < 1)
        line = np.concatenate([[start], places[on_the_way], [end]])
        assert np.abs(np.diff(line, axis=0)).max() <= resolution_rad
