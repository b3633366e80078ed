"""What every arm that takes poses of its tool does, whatever drives it: each against its stand-in."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

sys.path.insert(0, str(Path(__file__).parent))
from plug_in_bench import PoseArmBench, arm_names, nothing_opened, opened_bench

from surfuse import registry
from surfuse.errors import DeviceError, SafetyStopError, SurfuseError, UnreachableError
from surfuse.geometry.poses import is_rigid
from surfuse.interfaces import PoseArm
from surfuse.records import ToolState


@pytest.fixture(params=arm_names(takes_poses=True))
def name(request) -> str:
    return request.param


@pytest.fixture
def bench(name, tmp_path) -> Iterator[PoseArmBench]:
    with opened_bench("arms", name, tmp_path) as made:
        yield made


@pytest.fixture
def create(name):
    return registry.load("arms", name).create


def test_making_one_opens_nothing(bench, create):
    with nothing_opened():
        assert isinstance(create(bench.parameters), PoseArm)


def test_it_arrives_where_it_was_sent_and_says_so(bench, create):
    with create(bench.parameters) as arm:
        before = arm.tool_state()
        reached = arm.move_to_pose(bench.world_from_tool)
        after = arm.tool_state()
    assert isinstance(reached, ToolState)
    assert is_rigid(before.world_from_tool)
    assert np.abs(before.world_from_tool - bench.world_from_tool).max() > 10 * bench.close_m
    assert_allclose(reached.world_from_tool, bench.world_from_tool, atol=bench.close_m)
    assert_allclose(after.world_from_tool, reached.world_from_tool, atol=bench.close_m)
    assert before.t_s < reached.t_s <= after.t_s


def test_it_says_which_poses_it_can_take(bench, create):
    with create(bench.parameters) as arm:
        before = arm.tool_state().world_from_tool
        can = arm.reachable(np.array([bench.world_from_tool, bench.out_of_reach, before]))
        assert can.shape == (3,)
        assert can.dtype == np.bool_
        assert can[0]
        assert can[2]
        assert arm.reachable(np.zeros((0, 4, 4))).shape == (0,)
        assert_allclose(arm.tool_state().world_from_tool, before, atol=bench.close_m)


def test_a_pose_out_of_reach_is_refused_it_has_not_moved_and_goes_on(bench, create):
    with create(bench.parameters) as arm:
        before = arm.tool_state().world_from_tool
        with pytest.raises(UnreachableError) as caught:
            arm.move_to_pose(bench.out_of_reach)
        assert caught.value.cure
        assert_allclose(arm.tool_state().world_from_tool, before, atol=bench.close_m)
        reached = arm.move_to_pose(bench.world_from_tool)
    assert_allclose(reached.world_from_tool, bench.world_from_tool, atol=bench.close_m)


@pytest.mark.parametrize("wrong", ["nan", "mirrored", "stretched"])
def test_what_is_no_pose_is_not_sent(bench, create, wrong):
    target = bench.world_from_tool.copy()
    if wrong == "nan":
        target[0, 3] = np.nan
    else:
        target[:3, 0] *= {"mirrored": -1.0, "stretched": 1.5}[wrong]
    with create(bench.parameters) as arm:
        before = arm.tool_state().world_from_tool
        with pytest.raises(SurfuseError):
            arm.move_to_pose(target)
        assert_allclose(arm.tool_state().world_from_tool, before, atol=bench.close_m)


def test_it_moves_between_its_poses_again_and_again(bench, create):
    with create(bench.parameters) as arm:
        start = arm.tool_state().world_from_tool
        for goal in (bench.world_from_tool, start, bench.world_from_tool):
            assert_allclose(arm.move_to_pose(goal).world_from_tool, goal, atol=bench.close_m)


def test_one_that_is_not_open_is_a_device_error(bench, create):
    with pytest.raises(DeviceError, match="not open"):
        create(bench.parameters).tool_state()


def test_a_tool_that_moves_unasked_is_a_safety_stop(bench, create):
    with create(bench.parameters) as arm:
        arm.move_to_pose(bench.world_from_tool)
        bench.displace()
        with pytest.raises(SafetyStopError):
            arm.tool_state()


def test_closing_twice_is_fine_and_it_opens_again(bench, create):
    arm = create(bench.parameters)
    with arm:
        arm.tool_state()
    arm.__exit__(None, None, None)
    with arm:
        arm.tool_state()


def test_one_that_vanishes_is_a_device_error(bench, create):
    arm = create(bench.parameters)
    with pytest.raises(DeviceError) as caught, arm:  # noqa: PT012 - the arm is open when it vanishes
        bench.vanish()
        arm.move_to_pose(bench.world_from_tool)
    assert caught.value.cure
