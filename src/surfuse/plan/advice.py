"""What to tell the user about stops that cannot be visited: which ones, why, and how to move the part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surfuse.interfaces import Kinematics
from surfuse.plan.raster import grip_targets
from surfuse.records import FloatArray, ScanPlan, SkippedStop

BELOW = "below the table top"
_SHIFTS_M = np.arange(0.05, 0.65, 0.05)


def where_and_why(skipped: Sequence[SkippedStop], kind: str) -> str:
    """Stops of one kind in words: where they lie on the part, and the reason of the first one.

    `kind` is the beginning of the reasons, up to the colon.
    """
    those = [stop for stop in skipped if stop.reason.split(":")[0] == kind]
    u, v = 1e3 * np.array([stop.u_m for stop in those]), 1e3 * np.array([stop.v_m for stop in those])
    why = those[0].reason.partition(": ")[2]
    return f"u {u.min():.0f} to {u.max():.0f} mm, v {v.min():.0f} to {v.max():.0f} mm; {why}"


def way_to_move(plan: ScanPlan, kinematics: Kinematics) -> float | None:
    """How far (m) the part must go along the line of sight, away from the arm, so that joints reach all stops.

    Negative: towards the arm. None where up to 0.6 m either way do not help. Looks at the outermost stops only, and
    not at clearances.
    """
    places = np.array([[stop.u_m, stop.v_m] for stop in plan.skipped if not stop.reason.startswith(BELOW)])
    places = np.vstack([places.reshape(-1, 2), plan.uv_m])
    if len(places) == 0:
        return None
    targets = grip_targets(plan.outline.world_from_part, places[_outermost(places)], plan.standoff_m)
    sight = targets[0, :3, 2] * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(sight))
    if length == 0.0:
        return None
    for shift in _SHIFTS_M.tolist():
        for signed in (-shift, shift):
            moved = targets.copy()
            moved[:, :3, 3] += signed * sight / length
            if kinematics.inverse(moved)[1].all(axis=0).any():
                return float(signed)
    return None


def _outermost(places: FloatArray) -> list[int]:
    """Indices of the outermost of places (N, 2) in eight directions."""
    angles = np.arange(8) * np.pi / 4.0
    along = places @ np.array([np.cos(angles), np.sin(angles)])
    return sorted(set(np.argmax(along, axis=0).tolist()))
