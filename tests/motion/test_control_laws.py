"""The control laws: their formulas against plain ones, their limits, their integrators."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.arm_models.puma560 import READY_RAD
from surfuse.arm_models.puma560_dynamics import FIXTURE, loaded_puma560
from surfuse.errors import ConfigError
from surfuse.motion.control import computed_torque, gravity_pd, independent_pid, set_points_28ms
from surfuse.motion.control_law import ControlLaw, LawSurroundings, LoopGains
from surfuse.records import FloatArray

MODEL = loaded_puma560(FIXTURE)
GAINS = LoopGains(natural_rad_s=30.0, damping=0.8, integral_share=0.3)
RNG = np.random.default_rng(1)
WANTED, WANTED_SPEED, WANTED_RATE = READY_RAD, RNG.normal(0.0, 0.3, 6), RNG.normal(0.0, 1.0, 6)
MEASURED, SPEED = READY_RAD + RNG.normal(0.0, 2e-3, 6), RNG.normal(0.0, 0.3, 6)
ERROR = WANTED - MEASURED
DIAGONAL = np.diag(MODEL.inertia(READY_RAD))


AROUND = LawSurroundings(MODEL, READY_RAD)


def laws(gains: LoopGains = GAINS) -> list[ControlLaw]:
    return [
        plug_in.create(plug_in.Parameters(gains=gains, surroundings=AROUND))
        for plug_in in (independent_pid, set_points_28ms, gravity_pd, computed_torque)
    ]


def ask(law: ControlLaw, wanted: FloatArray = WANTED) -> FloatArray:
    torque = np.empty(6)
    law.torque(wanted, WANTED_SPEED, WANTED_RATE, MEASURED, SPEED, torque)
    return torque


def test_independent_pid_is_pid() -> None:
    integral = 1e-3 * DIAGONAL * 0.3 * 30.0**3 * ERROR
    wanted = DIAGONAL * (900.0 * ERROR + 48.0 * (WANTED_SPEED - SPEED)) + integral
    assert_allclose(ask(laws()[0]), wanted, rtol=1e-12)


def test_the_old_loop_damps_speed_and_does_not_feed_it_forward() -> None:
    law = laws()[1]
    integral = law.period_s * DIAGONAL * 0.3 * 30.0**3 * ERROR
    wanted = DIAGONAL * 900.0 * ERROR - (48.0 * DIAGONAL - MODEL.viscous_nm_s) * SPEED + integral
    assert_allclose(ask(law), wanted, rtol=1e-12)
    assert law.period_s == pytest.approx(0.875e-3)


def test_gravity_pd_is_weight_plus_pd() -> None:
    wanted = MODEL.gravity(MEASURED) + DIAGONAL * (900.0 * ERROR + 48.0 * (WANTED_SPEED - SPEED))
    assert_allclose(ask(laws()[2]), wanted, rtol=1e-12)


def test_computed_torque_is_inverse_dynamics_of_the_corrected_acceleration() -> None:
    acceleration = WANTED_RATE + 900.0 * ERROR + 48.0 * (WANTED_SPEED - SPEED) + 1e-3 * 0.3 * 30.0**3 * ERROR
    push = np.clip((WANTED_SPEED + 30.0 * ERROR) / 0.003, -1.0, 1.0)
    dry = np.where(push > 0.0, MODEL.coulomb_nm[:, 0], MODEL.coulomb_nm[:, 1]) * push
    wanted = MODEL.rigid_torque(MEASURED, SPEED, acceleration) + 0.9 * (MODEL.viscous_nm_s * WANTED_SPEED + dry)
    assert_allclose(ask(laws()[3]), wanted, rtol=1e-12)


@pytest.mark.parametrize("law", laws(), ids=lambda law: str(law.name))
def test_no_law_asks_for_more_torque_than_there_is(law: ControlLaw) -> None:
    for far in (READY_RAD + 2.0, READY_RAD - 2.0):
        assert_allclose(np.abs(ask(law, far)), MODEL.torque_max_nm)


@pytest.mark.parametrize("law", laws(), ids=lambda law: str(law.name))
def test_reset_empties_the_integrators(law: ControlLaw) -> None:
    first = ask(law)
    for _ in range(20):
        ask(law)
    law.reset()
    assert_allclose(ask(law), first, rtol=1e-12)


def test_errors_inside_the_dead_band_are_not_integrated() -> None:
    law = laws(replace(GAINS, dead_band_rad=0.5))[0]
    first = ask(law)
    assert_allclose(ask(law), first, rtol=0.0)


def test_hostile_gains_are_refused() -> None:
    for changes in ({"natural_rad_s": 0.0}, {"damping": -1.0}, {"integral_share": 1.7}, {"dead_band_rad": np.nan}):
        with pytest.raises(ConfigError, match=next(iter(changes))):
            replace(GAINS, **changes)
    with pytest.raises(ConfigError, match="friction_share"):
        computed_torque.Parameters(friction_share=1.1)
    with pytest.raises(ConfigError, match="breakaway_rad_s"):
        computed_torque.Parameters(breakaway_rad_s=0.0)
