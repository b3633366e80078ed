"""Which stops the arm can reach, in one configuration, clear of limits, singularities and obstacles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError
from surfuse.interfaces import Kinematics
from surfuse.motion.choice import follow
from surfuse.motion.clearance import Clearances
from surfuse.records import BoolArray, FloatArray, IntArray

ClearanceCheck = Callable[[FloatArray], Clearances]


@dataclass(frozen=True)
class ReachParameters:
    """How far the arm must stay away from what it must not touch.

    `clearance_min_m`: least distance to obstacles, in m. `singularity_min`: least distance to a singularity, in
    [0, 1] (see `Kinematics.singularity_distance`). `path_resolution_rad`: largest joint angle between the samples
    at which the way between two stops is checked.

    They hold at the stops and, but for the singularities, on the ways between them.
    """

    clearance_min_m: float = 0.005
    singularity_min: float = 0.05
    path_resolution_rad: float = 0.02

    def __post_init__(self) -> None:
        if not (np.isfinite(self.clearance_min_m) and self.clearance_min_m >= 0.0):
            raise ConfigError(f"clearance_min_m = {self.clearance_min_m}", cure="give 0 m or more")
        if not 0.0 <= self.singularity_min < 1.0:
            raise ConfigError(f"singularity_min = {self.singularity_min}", cure="give a share from 0 to below 1")
        if not (np.isfinite(self.path_resolution_rad) and self.path_resolution_rad > 0.0):
            raise ConfigError(f"path_resolution_rad = {self.path_resolution_rad}", cure="give an angle > 0 rad")


@dataclass(frozen=True)
class Reach:
    """Which of N targets can be visited in order: `reached` (N,), `joints_rad` (N, J) there (else nan), `reason` (N,).

    A reason is empty where the stop is reached; else it begins with its kind, up to the first colon.
    """

    reached: BoolArray
    joints_rad: FloatArray
    reason: tuple[str, ...]


@dataclass(frozen=True)
class _Solutions:
    """Of N targets in K configurations: `joints_rad` (N, K, J; nan: none) and which are within the limits (N, K).

    `away` (N, K, S) is the distance from each of the arm's S singularities, in [0, 1].
    """

    joints_rad: FloatArray
    valid: BoolArray
    away: FloatArray


def reach(
    world_from_grip: FloatArray,
    kinematics: Kinematics,
    start_rad: FloatArray,
    clearance: ClearanceCheck | None = None,
    parameters: ReachParameters = ReachParameters(),
) -> Reach:
    """Check targets (N, 4, 4) in visiting order, for an arm that comes from joints `start_rad` (J,).

    The whole scan uses one configuration of the arm, the one that reaches most stops (of equals, the one nearest to
    the start): a change of configuration in the middle of a scan is a sweeping motion. Of the stops left, one is
    also dropped when the straight joint move to it from the stop before is not clear.

    In visiting order means that each stop is reached from the one before it. Targets are poses of the tool in the
    world; `clearance` measures joints (N, J) in rad (None: not checked).
    """
    targets = np.ascontiguousarray(world_from_grip, dtype=np.float64)
    if len(targets) == 0:
        return Reach(np.zeros(0, dtype=bool), np.zeros((0, len(kinematics.lower_rad))), ())
    joints, valid = kinematics.inverse(targets)
    away = kinematics.singularity_distance(joints)
    solutions = _Solutions(joints, valid, away)
    regular = np.all(away >= parameters.singularity_min, axis=-1)
    k, cleared = _best_configuration(joints, valid & regular, start_rad, clearance, parameters)
    chosen = joints[:, k]
    path = follow(chosen, start_rad, kinematics.lower_rad, kinematics.upper_rad)
    path[~cleared] = np.nan
    reached, blocked = _passable(path, clearance, parameters)
    path[~reached] = np.nan
    reasons = [""] * len(targets)
    for i in np.flatnonzero(~cleared).tolist():
        reasons[i] = _reason(i, k, solutions, kinematics, clearance, parameters)
    for i, words in blocked.items():
        reasons[i] = words
    return Reach(reached, path, tuple(reasons))


def _best_configuration(
    joints: FloatArray,
    usable: BoolArray,
    start_rad: FloatArray,
    clearance: ClearanceCheck | None,
    parameters: ReachParameters,
) -> tuple[int, BoolArray]:
    """The configuration k with most clear stops, and which (N,) those are."""
    count = usable.sum(axis=0)
    gap = np.where(usable[..., None], np.angle(np.exp(1j * (joints - start_rad))), 0.0)
    distance = np.sum(gap**2, axis=(0, 2)) / np.maximum(count, 1)
    best, cleared = -1, np.zeros(len(joints), dtype=bool)
    for k in np.lexsort((distance, -count)).tolist():
        # The number of usable stops bounds the number of clear ones.
        if best >= 0 and count[k] <= cleared.sum():
            break
        clear = usable[:, k].copy()
        if clearance is not None and clear.any():
            clear[clear] = clearance(joints[clear, k]).distance_m >= parameters.clearance_min_m
        if best < 0 or clear.sum() > cleared.sum():
            best, cleared = k, clear
    return best, cleared


def _passable(
    path: FloatArray, clearance: ClearanceCheck | None, parameters: ReachParameters
) -> tuple[BoolArray, dict[int, str]]:
    """Which rows of a path (N, J) stay when moves that are not clear lose their end; and the words for the others."""
    kept = np.all(np.isfinite(path), axis=1)
    blocked: dict[int, str] = {}
    if clearance is None:
        return kept, blocked
    order = np.flatnonzero(kept)
    neighbours = np.column_stack([order[:-1], order[1:]])
    at_once = _blocked_moves(path, neighbours, clearance, parameters)
    last = -1
    for m, (before, stop) in enumerate(neighbours.tolist()):
        if before in blocked:
            # The way from the stop before that one has not been looked at.
            words = _blocked_moves(path, np.array([[last, stop]]), clearance, parameters).get(0)
        else:
            last = before
            words = at_once.get(m)
        if words is not None:
            blocked[stop] = words
    if blocked:
        kept[list(blocked)] = False
    return kept, blocked


def _blocked_moves(
    path: FloatArray, moves: IntArray, clearance: ClearanceCheck, parameters: ReachParameters
) -> dict[int, str]:
    """Of moves (M, 2) between rows of a path, those that are not clear on the way, each with its reason."""
    start, end = path[moves[:, 0]], path[moves[:, 1]]
    turn = np.max(np.abs(end - start), axis=1)
    inner = np.ceil(turn / parameters.path_resolution_rad).astype(np.int64)
    move = np.repeat(np.arange(len(moves)), inner)
    place = np.arange(len(move)) - np.repeat(np.cumsum(inner) - inner, inner)
    t = ((place + 1.0) / (inner[move] + 1.0))[:, None]
    if len(move) == 0:
        return {}
    gaps = clearance(start[move] + t * (end[move] - start[move]))
    short = np.flatnonzero(gaps.distance_m < parameters.clearance_min_m)
    words: dict[int, str] = {}
    for sample in short.tolist():
        words.setdefault(int(move[sample]), f"way from the stop before: {gaps.describe(sample)}")
    return words


def _reason(
    i: int,
    k: int,
    solutions: _Solutions,
    kinematics: Kinematics,
    clearance: ClearanceCheck | None,
    parameters: ReachParameters,
) -> str:
    """Why stop i is not usable in configuration k; the words before the colon are the kind of the reason."""
    joints, valid, away = solutions.joints_rad, solutions.valid, solutions.away
    if not np.any(np.isfinite(joints[i])):
        return "out of reach: the arm is too short, or the stop too near its first axis"
    if not valid[i, k]:
        if np.any(valid[i]):
            return "configuration: reached only in another configuration of the arm than the rest of the scan"
        return _limit_reason(joints[i, k], kinematics)
    worst = int(np.argmin(away[i, k]))
    if away[i, k, worst] < parameters.singularity_min:
        return (
            f"singularity: {away[i, k, worst]:.3f} from the {kinematics.singularities[worst]} singularity, "
            f"at least {parameters.singularity_min:g}"
        )
    if clearance is None:
        return "configuration: not usable"
    gaps = clearance(joints[i : i + 1, k])
    obstacle = gaps.obstacles[int(gaps.obstacle[0])]
    return f"clearance to {obstacle}: {gaps.describe(0)}, at least {1e3 * parameters.clearance_min_m:.0f} mm"


def _limit_reason(joints: FloatArray, kinematics: Kinematics) -> str:
    outside = ~((joints >= kinematics.lower_rad) & (joints <= kinematics.upper_rad))
    if not np.all(np.isfinite(joints)):
        return "out of reach: no solution in the configuration of the scan"
    j = int(np.argmax(outside))
    low, high = np.degrees([kinematics.lower_rad[j], kinematics.upper_rad[j]])
    return f"joint limit: joint {j + 1} would be at {np.degrees(joints[j]):.1f} deg, limits {low:.1f} to {high:.1f} deg"
