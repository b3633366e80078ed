"""What to tell the user about stops that cannot be visited: which ones, why, and how to move the part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from surfuse.geometry.poses import rotation_about
from surfuse.interfaces import Kinematics
from surfuse.plan.raster import grip_targets
from surfuse.plan.reach import ClearanceCheck, ReachParameters, reach
from surfuse.records import FloatArray, Outline, ScanPlan, SkippedStop

BELOW = "below the table top"
_SHIFTS_M = np.arange(0.05, 0.65, 0.05)
_TURNS_RAD = tuple(np.radians([15.0, 30.0, 45.0]).tolist())
_SHIFT_M, _TURN_RAD = 0.10, float(np.radians(15.0))  # moves that are as much trouble as each other


def where_and_why(skipped: Sequence[SkippedStop], kind: str) -> str:
    """Stops of one kind in words: where they lie on the part, and the reason of the first one if it has one.

    `kind` is the beginning of the reasons, up to the colon.
    """
    those = [stop for stop in skipped if stop.reason.split(":")[0] == kind]
    u, v = 1e3 * np.array([stop.u_m for stop in those]), 1e3 * np.array([stop.v_m for stop in those])
    why = those[0].reason.partition(": ")[2]
    where = f"u {u.min():.0f} to {u.max():.0f} mm, v {v.min():.0f} to {v.max():.0f} mm"
    return f"{where}; {why}" if why else where


@dataclass(frozen=True)
class PartMove:
    """How to move the part: away from joint 1 by `shift_m` (negative: towards it), and about the vertical through its
    foot by `turn_rad`, anticlockwise as seen from above.
    """

    shift_m: float
    turn_rad: float

    def applied(self, world_from_part: FloatArray) -> FloatArray:
        """The part frame (4, 4) after the move."""
        moved = np.array(world_from_part, dtype=np.float64)
        outwards = moved[:3, 3] * [1.0, 1.0, 0.0]
        distance = float(np.linalg.norm(outwards))
        moved[:3, :3] = rotation_about([0.0, 0.0, 1.0], self.turn_rad) @ moved[:3, :3]
        if distance > 0.0:
            moved[:3, 3] += self.shift_m * outwards / distance
        return moved

    def describe(self) -> str:
        """In words for a person at the table."""
        words = []
        if self.shift_m:
            direction = "towards the arm" if self.shift_m < 0.0 else "away from the arm"
            words.append(f"move the part {1e3 * abs(self.shift_m):.0f} mm {direction}")
        if self.turn_rad:
            sense = "anticlockwise" if self.turn_rad > 0.0 else "clockwise"
            words.append(f"turn it {np.degrees(abs(self.turn_rad)):.0f} degrees {sense} as seen from above")
        return " and ".join(words)


def way_to_move(
    plan: ScanPlan,
    kinematics: Kinematics,
    start_rad: FloatArray,
    clearance: Callable[[Outline], ClearanceCheck] | None = None,
    limits: ReachParameters | None = None,
) -> PartMove | None:
    """The smallest move of the part after which the arm, at joints `start_rad` (J,), visits every stop of the plan.

    Tried are shifts along the line from joint 1 up to 0.6 m either way, and turns about the vertical up to 45 degrees,
    10 cm counting as much as 15 degrees. `clearance` makes the collision check for the outline at its new place. None
    where no such move helps.
    """
    places = np.array([[stop.u_m, stop.v_m] for stop in plan.skipped if not stop.reason.startswith(BELOW)])
    places = np.vstack([places.reshape(-1, 2), plan.uv_m])
    if len(places) == 0:
        return None
    places = places[np.lexsort((places[:, 0], places[:, 1]))]
    few = places[_outermost(places)]
    for move in _moves():
        outline = replace(plan.outline, world_from_part=move.applied(plan.outline.world_from_part))
        targets = grip_targets(outline.world_from_part, few, plan.standoff_m)
        if not kinematics.inverse(targets)[1].all(axis=0).any():
            continue
        check = None if clearance is None else clearance(outline)
        targets = grip_targets(outline.world_from_part, places, plan.standoff_m)
        if reach(targets, kinematics, start_rad, check, limits or ReachParameters()).reached.all():
            return move
    return None


def _moves() -> list[PartMove]:
    """Moves worth trying, the smallest first."""
    shifts = [0.0, *(sign * shift for shift in _SHIFTS_M.tolist() for sign in (-1.0, 1.0))]
    turns = [0.0, *(sign * turn for turn in _TURNS_RAD for sign in (1.0, -1.0))]
    tried = [PartMove(shift, 0.0) for shift in shifts[1:]]
    # Both at once only for the nearest: each is an inverse of its own, which arms from files pay for.
    tried += [PartMove(shift, turn) for shift in (0.0, -0.1, 0.1, -0.2, 0.2) for turn in turns[1:]]
    return sorted(tried, key=lambda move: abs(move.shift_m) / _SHIFT_M + abs(move.turn_rad) / _TURN_RAD)


def _outermost(places: FloatArray) -> list[int]:
    """Indices of the outermost of places (N, 2) in eight directions."""
    angles = np.arange(8) * np.pi / 4.0
    along = places @ np.array([np.cos(angles), np.sin(angles)])
    return sorted(set(np.argmax(along, axis=0).tolist()))
