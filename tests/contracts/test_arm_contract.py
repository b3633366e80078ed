"""What every arm that takes joints does, whatever drives it: each against its stand-in."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

sys.path.insert(0, str(Path(__file__).parent))
from plug_in_bench import ArmBench, arms_that_take, nothing_opened, opened_bench

from surfuse import registry
from surfuse.errors import DeviceError, SafetyStopError
from surfuse.records import FloatArray, JointState


@pytest.fixture(params=arms_that_take(poses=False))
def name(request) -> str:
    return request.param


@pytest.fixture
def bench(name, tmp_path) -> Iterator[ArmBench]:
    with opened_bench("arms", name, tmp_path) as made:
        yield made


@pytest.fixture
def create(name):
    return registry.load("arms", name).create


def test_making_one_opens_nothing(bench, create):
    with nothing_opened():
        assert create(bench.parameters).kinematics is bench.parameters.surroundings.kinematics


def test_it_arrives_where_it_was_sent_and_says_so(bench, create):
    with create(bench.parameters) as arm:
        before = arm.joint_state()
        reached = arm.move_to(bench.target_rad)
        after = arm.joint_state()
    assert isinstance(reached, JointState)
    assert before.position_rad.shape == bench.target_rad.shape
    assert np.abs(before.position_rad - bench.target_rad).max() > 10 * bench.close_rad
    assert_allclose(reached.position_rad, bench.target_rad, atol=bench.close_rad)
    assert_allclose(after.position_rad, reached.position_rad, atol=bench.close_rad)
    assert before.t_s < reached.t_s <= after.t_s


def test_targets_outside_a_limit_are_refused_and_it_has_not_moved(bench, create):
    limits = bench.parameters.surroundings.limits
    with create(bench.parameters) as arm:
        before = arm.joint_state().position_rad
        for joint in range(len(limits)):
            for edge in (limits.lower_rad[joint] - 1e-3, limits.upper_rad[joint] + 1e-3, np.nan):
                target = before.copy()
                target[joint] = edge
                with pytest.raises(SafetyStopError, match=rf"joint {joint + 1} "):
                    arm.move_to(target)
        assert_allclose(arm.joint_state().position_rad, before, atol=bench.close_rad)


def test_the_guard_of_the_rig_may_refuse_the_way(bench, create):
    seen: list[FloatArray] = []

    def guard(start: FloatArray, target: FloatArray) -> None:
        seen.extend([start, target])
        raise SafetyStopError("the wrist would be inside the table")

    around = replace(bench.parameters.surroundings, guard=guard)
    with create(replace(bench.parameters, surroundings=around)) as arm:
        before = arm.joint_state().position_rad
        with pytest.raises(SafetyStopError, match="inside the table"):
            arm.move_to(bench.target_rad)
        assert_allclose(arm.joint_state().position_rad, before, atol=bench.close_rad)
    assert_allclose(seen[0], before, atol=bench.close_rad)
    assert_allclose(seen[1], bench.target_rad)


def test_closing_twice_is_fine(bench, create):
    arm = create(bench.parameters)
    with arm:
        arm.joint_state()
    arm.__exit__(None, None, None)


def test_one_that_vanishes_is_a_device_error(bench, create):
    if bench.vanish is None:
        return
    arm = create(bench.parameters)
    with pytest.raises(DeviceError), arm:  # noqa: PT012 - the arm is open when it vanishes
        bench.vanish()
        arm.move_to(bench.target_rad)
