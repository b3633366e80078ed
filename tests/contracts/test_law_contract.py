"""What every control law of the joint servo does."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

sys.path.insert(0, str(Path(__file__).parent))
from plug_in_bench import LawBench, opened_bench

from surfuse import registry
from surfuse.arm_models.puma560 import LIMITS, READY_RAD
from surfuse.motion.control_law import ControlLaw
from surfuse.motion.trapezoid import TrapezoidalMove
from surfuse.records import FloatArray

STILL = np.zeros(6)
OFF = np.radians([0.3, -0.2, 0.25, 0.4, -0.3, 0.2])


@pytest.fixture(params=registry.found("control_laws").built_in)
def name(request) -> str:
    return request.param


@pytest.fixture
def bench(name, tmp_path) -> Iterator[LawBench]:
    with opened_bench("control_laws", name, tmp_path) as made:
        yield made


@pytest.fixture
def law(name, bench) -> ControlLaw:
    return registry.load("control_laws", name).create(bench.parameters)


def ask(law: ControlLaw, error: FloatArray, speed: FloatArray = STILL) -> FloatArray:
    torque = np.full(6, np.nan)
    law.torque(READY_RAD, STILL, STILL, READY_RAD - error, speed, torque)
    return torque


def test_it_is_called_as_its_file_and_has_a_period(name, law):
    assert law.name == name
    assert 1e-4 < law.period_s < 1e-2


def test_it_pushes_each_joint_towards_its_target_and_against_its_speed(law):
    level = ask(law, STILL)
    law.reset()
    assert np.all(np.sign(ask(law, OFF) - level) == np.sign(OFF))
    law.reset()
    assert np.all(np.sign(ask(law, STILL, 0.05 * np.ones(6)) - level) == -1.0)


def test_it_never_asks_for_more_torque_than_there_is(law, bench):
    most = bench.parameters.surroundings.dynamics.torque_max_nm
    for error in (2.0 * np.ones(6), -2.0 * np.ones(6), OFF):
        for _ in range(50):
            assert np.all(np.abs(ask(law, error)) <= most * (1.0 + 1e-12))


def test_reset_forgets_and_two_laws_share_nothing(law, name, bench):
    other = registry.load("control_laws", name).create(bench.parameters)
    first = ask(law, OFF)
    for _ in range(30):
        ask(law, OFF)
    assert_allclose(ask(other, OFF), first, rtol=0.0)
    law.reset()
    assert_allclose(ask(law, OFF), first, rtol=0.0)


def test_its_commands_lead_to_the_end_of_the_motion(law):
    move = TrapezoidalMove(READY_RAD, READY_RAD + OFF, LIMITS)
    commands = law.commands(move)
    assert commands.position_rad.shape == commands.velocity_rad_s.shape == commands.acceleration_rad_s2.shape
    assert_allclose(commands.position_rad[-1], READY_RAD + OFF, atol=1e-12)
    assert len(commands) * law.period_s >= move.duration_s - 1e-9
