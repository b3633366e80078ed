"""From an outline to the scan plan: margin, raster, targets, reach."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.poses import inverse
from surfuse.interfaces import Kinematics
from surfuse.plan.margin import enlarged, scan_area
from surfuse.plan.raster import FACING, grip_targets, nearest_quarter, raster
from surfuse.plan.reach import ClearanceCheck, ReachParameters, reach
from surfuse.records import FloatArray, Outline, ScanPlan, SkippedStop


@dataclass(frozen=True)
class PlanParameters:
    """The raster scan.

    `step_m`: distance between stops and between lines (paper: a fifth of the sensor spacing). `standoff_m`: from the
    transducers to the acquisition plane, w = 0 of the part frame. `margin_m`: how far the outline is enlarged (None: by
    what its uncertainty asks for, or two steps, around the part as seen along w).
    `same_side`: start every line at the same extreme instead of alternating. `lowest_v_m`: lines below this are left
    out; the part stands on the table at v = 0, the one edge known without error, and below it the sensors would see
    the table's rim (-inf: no such limit). `nearest_turn`: the grip is turned about its axis by the quarter that is
    nearest to how it stands, instead of y up.
    """

    step_m: float = 0.01
    standoff_m: float = 0.43
    margin_m: float | None = None
    same_side: bool = False
    lowest_v_m: float = 0.0
    nearest_turn: bool = False

    def __post_init__(self) -> None:
        for name, value in (("step_m", self.step_m), ("standoff_m", self.standoff_m)):
            if not (np.isfinite(value) and value > 0.0):
                raise ConfigError(f"{name} = {value}", cure="give a length > 0 m")
        if np.isnan(self.lowest_v_m):
            raise ConfigError("lowest_v_m is nan", cure="give a height in m")


def scan_plan(
    outline: Outline,
    kinematics: Kinematics,
    start_rad: FloatArray,
    clearance: ClearanceCheck | None = None,
    parameters: PlanParameters = PlanParameters(),
    limits: ReachParameters | None = None,
) -> ScanPlan:
    """Plan the scan of an outline, not yet enlarged, for an arm at joints `start_rad` whose tool frame is the grip.

    What cannot be visited is in `skipped`, each stop with its reason; a part out of reach gives a plan of no stops.
    `outline` of the plan is the enlarged one.

    `start_rad` (J,) in rad. `clearance` measures the distance of the arm at joints (N, J) from all that it must not
    touch (None: not checked).
    """
    area = area_to_scan(outline, parameters)
    stops = raster(area, parameters.step_m, parameters.same_side)
    high_enough = stops.uv_m[:, 1] >= parameters.lowest_v_m - 1e-9
    turn = FACING
    if parameters.nearest_turn:
        turn = nearest_quarter(inverse(outline.world_from_part) @ kinematics.forward(start_rad))
    targets = grip_targets(outline.world_from_part, stops.uv_m, parameters.standoff_m, turn)
    checked = reach(targets[high_enough], kinematics, start_rad, clearance, limits or ReachParameters())
    visited = np.flatnonzero(high_enough)[checked.reached]
    reasons = dict(zip(np.flatnonzero(high_enough).tolist(), checked.reason, strict=True))
    skipped = tuple(
        SkippedStop(u, v, reasons.get(i) or too_low(v, parameters.lowest_v_m))
        for i, (u, v) in enumerate(stops.uv_m.tolist())
        if reasons.get(i) != ""
    )
    return ScanPlan(
        world_from_grip=targets[visited],
        uv_m=stops.uv_m[visited],
        row=stops.row[visited],
        joints_rad=checked.joints_rad[checked.reached],
        outline=area,
        step_m=parameters.step_m,
        standoff_m=parameters.standoff_m,
        skipped=skipped,
    )


def area_to_scan(outline: Outline, parameters: PlanParameters) -> Outline:
    """The outline enlarged by the margin of the parameters."""
    given = parameters.margin_m
    return scan_area(outline, parameters.step_m) if given is None else enlarged(outline, given)


def too_low(v_m: float, lowest_v_m: float) -> str:
    """Why a stop at height v is left out, where the lowest line is at `lowest_v_m`."""
    return f"below the table top: the grip axis would point {1e3 * (lowest_v_m - v_m):.0f} mm below the lowest line"


def skipped_by_kind(plan: ScanPlan) -> tuple[tuple[str, int], ...]:
    """How many stops were left out for each kind of reason, most frequent first."""
    return tuple(Counter(stop.reason.split(":")[0] for stop in plan.skipped).most_common())
