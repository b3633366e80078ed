"""The way from where the arm is to the first stop: direct if that is clear, else around the part."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from surfuse.errors import SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.interfaces import Kinematics
from surfuse.motion.choice import nearest_configuration
from surfuse.motion.clearance import ClearanceModel, check_move
from surfuse.records import FloatArray

_RETREATS_M = (0.05, 0.10, 0.15, 0.20)


def approach(
    start_rad: FloatArray,
    goal_rad: FloatArray,
    kinematics: Kinematics,
    clearance: ClearanceModel,
    clearance_min_m: float = 0.005,
    from_within: bool = False,
) -> FloatArray:
    """Joint positions (M, J) to visit one after the other, the last being the goal; each move straight and clear.

    Tried in this order: the direct move; first joint 1 and then the others, or the reverse; the same ways to a point
    some centimetres back along the grip axis, from which the grip goes forward to the goal. `start_rad` and `goal_rad`
    (J,) in rad; distances to obstacles stay above `clearance_min_m`; `from_within` as in `check_move`.

    Raises
    ------
    SafetyStopError : none of these ways is clear; the message is that of the direct one.
    """

    def refusal(way: FloatArray) -> SafetyStopError | None:
        return _refusal(way, clearance, clearance_min_m, from_within)

    direct = refusal(np.array([start_rad, goal_rad]))
    if direct is None:
        return np.array([goal_rad])
    for end in ([goal_rad], *([back, goal_rad] for back in _retreats(goal_rad, kinematics))):
        turn_first, turn_last = np.array(start_rad), np.array(end[0])
        turn_first[0], turn_last[0] = end[0][0], start_rad[0]
        for via in ([], [turn_first], [turn_last]):
            way = np.array([start_rad, *via, *end])
            if refusal(way) is None:
                return way[1:]
    raise direct


def _refusal(way: FloatArray, clearance: ClearanceModel, least_m: float, from_within: bool) -> SafetyStopError | None:
    """Why a way (M, J) of straight moves is refused, None where it is clear."""
    try:
        for start, end in pairwise(way):
            check_move(clearance, start, end, least_m, from_within=from_within)
    except SafetyStopError as refusal:
        return refusal
    return None


def _retreats(goal_rad: FloatArray, kinematics: Kinematics) -> list[FloatArray]:
    """Joint positions that hold the grip back from the goal, in the configuration nearest to it."""
    world_from_grip = kinematics.forward(goal_rad)
    targets = np.array([world_from_grip @ pose(np.eye(3), [0.0, 0.0, -back]) for back in _RETREATS_M])
    solutions, valid = kinematics.inverse(targets)
    joints, index = nearest_configuration(solutions, valid, goal_rad, kinematics.lower_rad, kinematics.upper_rad)
    # Another configuration would swing through the part on the last centimetres.
    near = (index >= 0) & (np.max(np.abs(joints - goal_rad), axis=1) < np.radians(60.0))
    return [row for row, is_near in zip(joints, near, strict=True) if is_near]
