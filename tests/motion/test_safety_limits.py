"""What guards safety is exact: each limit refuses just beyond it and lets pass just before it; nothing is skipped."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, STAND_HEIGHT_M, Puma560
from surfuse.errors import SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.motion.body import Capsule, body_of
from surfuse.motion.clearance import ClearanceModel, Clearances, check_move
from surfuse.motion.guard import GuardParameters, MotionGuard
from surfuse.motion.planners import tool_speed
from surfuse.motion.trapezoid import TrapezoidalMove
from surfuse.records import FloatArray

ARM = Puma560(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
TURN = np.radians([80.0, 10.0, 0.0, 0.0, 5.0, 0.0])
MOVE = TrapezoidalMove(READY_RAD, READY_RAD + TURN, LIMITS)
# Joint 5 from 45 to 20 degrees: nearer to the singular wrist, not in it.
BENT = TrapezoidalMove(READY_RAD, READY_RAD + np.radians([0.0, 0.0, 0.0, 0.0, -25.0, 0.0]), LIMITS)


class Looked(ClearanceModel):
    """A clearance model without obstacles that notes the joints (N, J) at which it was asked."""

    def __call__(self, joints_rad: FloatArray) -> Clearances:
        self.places.append(np.atleast_2d(joints_rad))
        return super().__call__(joints_rad)

    @property
    def places(self) -> list[FloatArray]:
        return self.__dict__.setdefault("_places", [])


def looked() -> Looked:
    return Looked(ARM.link_poses, body_of([Capsule("rod", 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 0.05)]), ())


def guard(model: ClearanceModel | None = None, kinematics: Puma560 = ARM, **how: float) -> MotionGuard:
    return MotionGuard(kinematics, LIMITS, lambda _: model or looked(), (), GuardParameters(**how))


def widest_gap(places: FloatArray, start: FloatArray, end: FloatArray) -> float:
    """Largest turn of a joint that is not looked at, from start to end."""
    return float(np.abs(np.diff(np.concatenate([[start], places, [end]]), axis=0)).max())


@pytest.mark.parametrize("resolution_rad", [0.02, 0.005, 0.3])
def test_a_straight_move_is_looked_at_everywhere(resolution_rad: float) -> None:
    model = looked()
    check_move(model, MOVE.start_rad, MOVE.end_rad, 0.005, resolution_rad)
    assert widest_gap(np.concatenate(model.places), MOVE.start_rad, MOVE.end_rad) <= resolution_rad
    # No finer than asked for, either: it is what a move costs.
    assert len(np.concatenate(model.places)) <= np.ceil(np.abs(TURN).max() / resolution_rad) + 2


def test_without_a_word_it_is_looked_at_every_fiftieth_of_a_radian() -> None:
    model = looked()
    check_move(model, MOVE.start_rad, MOVE.end_rad, 0.005)
    assert widest_gap(np.concatenate(model.places), MOVE.start_rad, MOVE.end_rad) <= 0.02


@pytest.mark.parametrize("look", [lambda g: g.check(MOVE), lambda g: g(MOVE.start_rad, MOVE.end_rad)])
@pytest.mark.parametrize("resolution_rad", [0.02, 0.004])
def test_the_guard_looks_at_a_motion_everywhere(look: Callable[[MotionGuard], None], resolution_rad: float) -> None:
    model = looked()
    look(guard(model, resolution_rad=resolution_rad, tool_speed_max_m_s=9.0))
    assert widest_gap(np.concatenate(model.places), MOVE.start_rad, MOVE.end_rad) <= resolution_rad


def test_the_limit_of_the_tool_s_speed_is_the_limit() -> None:
    t = np.linspace(0.0, MOVE.duration_s, 3001)
    fastest = tool_speed(ARM, t, MOVE.sample(t)[0])
    guard(tool_speed_max_m_s=1.003 * fastest).check(MOVE)
    with pytest.raises(SafetyStopError, match="the tool would move at"):
        guard(tool_speed_max_m_s=0.98 * fastest).check(MOVE)


@pytest.mark.parametrize("joint", range(6))
def test_the_limit_of_a_joint_s_speed_is_the_limit(joint: int) -> None:
    move = TrapezoidalMove(READY_RAD, READY_RAD + 0.4 * (np.arange(6) == joint), LIMITS)
    speed = np.abs(move.sample(np.linspace(0.0, move.duration_s, 3001))[1]).max()

    def limited(share: float) -> MotionGuard:
        velocity = np.where(np.arange(6) == joint, share * speed, 99.0)
        limits = type(LIMITS)(LIMITS.lower_rad, LIMITS.upper_rad, velocity, LIMITS.acceleration_rad_s2)
        free = GuardParameters(tool_speed_max_m_s=99.0, singularity_min=0.0)
        return MotionGuard(ARM, limits, lambda _: looked(), (), free)

    limited(1.0).check(move)
    with pytest.raises(SafetyStopError, match=f"joint {joint + 1} would turn"):
        limited(0.99).check(move)


def test_the_least_distance_to_a_singularity_is_the_limit() -> None:
    nearest = float(ARM.singularity_distance(BENT.end_rad[None]).min())
    assert nearest < ARM.singularity_distance(BENT.start_rad[None]).min()
    guard(singularity_min=0.999 * nearest).check(BENT)
    with pytest.raises(SafetyStopError, match="singularity at"):
        guard(singularity_min=1.001 * nearest).check(BENT)


class Unsure(Puma560):
    """An arm that does not know how far a singularity is, at some of its positions."""

    def singularity_distance(self, joints_rad: FloatArray) -> FloatArray:
        away = super().singularity_distance(joints_rad).copy()
        away.reshape(-1, away.shape[-1])[-1, 0] = np.nan
        return away


def test_an_unknown_distance_to_a_singularity_is_too_near() -> None:
    unsure = Unsure(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
    guard().check(BENT)
    with pytest.raises(SafetyStopError, match="within nan of the"):
        guard(kinematics=unsure, singularity_min=0.0).check(BENT)


class Near(Looked):
    """A model that says how near it is, whatever the joints are."""

    def __call__(self, joints_rad: FloatArray) -> Clearances:
        n = len(np.atleast_2d(joints_rad))
        return Clearances(np.full(n, self.distance_m), np.zeros(n, int), np.zeros(n, int), ("rod",), ("the wall",))

    @property
    def distance_m(self) -> float:
        return float(self.obstacles[0])  # type: ignore[arg-type]


@pytest.mark.parametrize(("distance_m", "passes"), [(0.0501, True), (0.0499, False), (-0.01, False), (np.nan, False)])
def test_the_least_clearance_is_the_limit_and_an_unknown_one_is_none(distance_m: float, passes: bool) -> None:
    body = body_of([Capsule("rod", 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 0.05)])
    near = guard(Near(ARM.link_poses, body, (distance_m,)), clearance_min_m=0.05, tool_speed_max_m_s=9.0)  # type: ignore[arg-type]
    for check in (lambda: near.check(MOVE), lambda: near(MOVE.start_rad, MOVE.end_rad)):
        if passes:
            check()
        else:
            with pytest.raises(SafetyStopError, match="the wall"):
                check()
