"""The scan plan of an arm that is sent to poses: its own controller finds the joints."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from surfuse.geometry.poses import inverse
from surfuse.plan.margin import enlarged
from surfuse.plan.raster import StopRaster, grip_targets, nearest_quarter, raster
from surfuse.plan.scan_plan import PlanParameters, too_low
from surfuse.records import BoolArray, FloatArray, Outline, ScanPlan, SkippedStop

OUT_OF_REACH = "the arm cannot take this pose"
_SAME_RAD = 1e-3

Reachable = Callable[[FloatArray], BoolArray]


def pose_plan(
    outline: Outline, reachable: Reachable, start_world_from_grip: FloatArray, parameters: PlanParameters
) -> ScanPlan:
    """Plan the scan of an outline for an arm that says itself which grip poses (N, 4, 4) it can take.

    The beams look along -w. About them the grip is turned so that the array lies square to the lines, by the quarter
    turn that is nearest to how it stands now; an arm that cannot turn keeps the turn that it has. The outline is what
    shall be scanned, so it is enlarged only by a margin that is given. The plan has no joints. Lines below
    `lowest_v_m` are left out.
    """
    area = enlarged(outline, parameters.margin_m or 0.0)
    whole = raster(area, parameters.step_m, parameters.same_side)
    low = whole.uv_m[:, 1] < parameters.lowest_v_m - 1e-9
    stops = StopRaster(whole.uv_m[~low], whole.row[~low])
    best, can = np.zeros((0, 4, 4)), np.zeros(0, dtype=np.bool_)
    for turn in _turns(inverse(outline.world_from_part)[:3, :3] @ start_world_from_grip[:3, :3]):
        targets = grip_targets(outline.world_from_part, stops.uv_m, parameters.standoff_m, turn)
        found = np.asarray(reachable(targets), dtype=np.bool_) if len(targets) else np.zeros(0, dtype=np.bool_)
        if len(best) == 0 or np.count_nonzero(found) > np.count_nonzero(can):
            best, can = targets, found
        if can.any():
            break
    return ScanPlan(
        world_from_grip=best[can],
        uv_m=stops.uv_m[can],
        row=stops.row[can],
        joints_rad=np.zeros((int(np.count_nonzero(can)), 0)),
        outline=area,
        step_m=parameters.step_m,
        standoff_m=parameters.standoff_m,
        skipped=(
            *(SkippedStop(u, v, too_low(v, parameters.lowest_v_m)) for u, v in whole.uv_m[low].tolist()),
            *(SkippedStop(u, v, OUT_OF_REACH) for u, v in stops.uv_m[~can].tolist()),
        ),
    )


def _turns(now: FloatArray) -> Iterator[FloatArray]:
    """Rotations (3, 3) of the grip in the part frame, the wanted one first; `now` is how it is turned."""
    nearest = nearest_quarter(now)
    yield nearest
    x = now[:, 0] * np.array([1.0, 1.0, 0.0])
    if float(np.linalg.norm(x)) < _SAME_RAD:
        return
    x /= np.linalg.norm(x)
    z = np.array([0.0, 0.0, -1.0])
    kept = np.column_stack([x, np.cross(z, x), z])
    if float(np.trace(kept.T @ nearest)) < 3.0 - _SAME_RAD**2:
        yield kept
