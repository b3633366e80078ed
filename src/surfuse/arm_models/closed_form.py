"""Closed-form inverse kinematics of six-axis arms, where the library EAIK has one (extra `closed-form`).

Ostermeier, Kuelz and Althoff, "Automatic geometric decomposition for analytical inverse kinematics", IEEE Robotics and
Automation Letters, 2025. Not every arm has one: three axes must be parallel or meet, or two neighbours must.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from surfuse.arm_models.screw_chain import place_many
from surfuse.geometry.compiled import compiled
from surfuse.motion.choice import nearest_turn
from surfuse.records import BoolArray, FloatArray

SOLUTIONS = 16
_EXACT = 1e-8  # metres and radians; least-squares solutions and those at singularities may miss the pose
_STEP_RAD = 0.8  # further from its last joints than this, a solution is taken for another configuration
_TRIALS = 12

Solver = Callable[[FloatArray], FloatArray]
"""Poses (N, 4, 4) in the base frame -> joints (N, SOLUTIONS, 6) in any turn, nan where there are fewer."""


def closed_form(axis: FloatArray, point: FloatArray, home: FloatArray) -> Solver | None:
    """A solver for the chain of joint axes and points (J, 3), frames `home` (J + 1, 4, 4) at angle 0; None without one.

    The library's answers are not trusted: it must find joints that are drawn at random again, and every solution that
    misses its pose is dropped.
    """
    if len(axis) != 6:
        return None
    try:
        from eaik.IK_HP import HPRobot  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        return None
    steps = np.vstack([point[:1], np.diff(point, axis=0), home[-1:, :3, 3] - point[-1:]])
    robot = HPRobot(np.array(axis), steps)
    if not robot.hasKnownDecomposition():
        return None
    straight = home[-1, :3, :3].T

    def solve(targets: FloatArray) -> FloatArray:
        asked = targets.copy()
        asked[:, :3, :3] = targets[:, :3, :3] @ straight
        found = np.full((len(targets), SOLUTIONS, 6), np.nan)
        for row, answer in zip(found, robot.IK_batched(asked, 1), strict=True):
            kept = np.array(answer.Q, dtype=np.float64).reshape(-1, 6)[:SOLUTIONS]
            row[: len(kept)] = kept
        frames, _ = place_many(axis, point, home, np.nan_to_num(found.reshape(-1, 6)))
        reached = frames[:, -1].reshape(len(targets), SOLUTIONS, 4, 4)
        missed = np.abs(reached - targets[:, None]).max(axis=(2, 3)) > _EXACT
        found[missed] = np.nan
        return found

    return solve if _finds_what_was_drawn(solve, axis, point, home) else None


def _finds_what_was_drawn(solve: Solver, axis: FloatArray, point: FloatArray, home: FloatArray) -> bool:
    drawn = np.random.default_rng(0).uniform(-2.5, 2.5, (_TRIALS, 6))
    frames, _ = place_many(axis, point, home, drawn)
    off = np.abs(np.angle(np.exp(1j * (solve(np.ascontiguousarray(frames[:, -1])) - drawn[:, None])))).max(axis=2)
    return bool(np.all(np.nanmin(np.where(np.isnan(off), np.inf, off), axis=1) < 1e-6))


@compiled
def in_columns(found: FloatArray, lower: FloatArray, upper: FloatArray, columns: int) -> tuple[FloatArray, BoolArray]:
    """Solutions (N, S, J), nan where there is none, as joints (N, K, J) within their limits; which (N, K) there are.

    Column k follows one configuration: it takes the solution nearest to its last one. Solutions that are far from all
    of these begin new columns while there are any.
    """
    count, many, joints = found.shape
    result = np.full((count, columns, joints), np.nan)
    reached = np.zeros((count, columns), dtype=np.bool_)
    last = np.zeros((columns, joints))
    middle = 0.5 * (lower + upper)
    used = 0
    for i in range(count):
        free = np.zeros(many, dtype=np.bool_)
        for s in range(many):
            free[s] = not math.isnan(found[i, s, 0])
        for attempt in range(2):
            for k in range(columns):
                if reached[i, k] or (attempt == 0 and k >= used):
                    continue
                near = last[k] if k < used else middle
                best, chosen = np.inf, -1
                for s in range(many):
                    if not free[s]:
                        continue
                    apart = 0.0
                    for j in range(joints):
                        turned = nearest_turn(found[i, s, j], near[j], lower[j], upper[j])
                        apart = max(apart, np.inf if math.isnan(turned) else abs(turned - near[j]))
                    if apart < best:
                        best, chosen = apart, s
                if chosen < 0 or (k < used and best > _STEP_RAD):
                    continue
                for j in range(joints):
                    result[i, k, j] = nearest_turn(found[i, chosen, j], near[j], lower[j], upper[j])
                last[k] = result[i, k]
                reached[i, k] = True
                free[chosen] = False
                used = max(used, k + 1)
    return result, reached
