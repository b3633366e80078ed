"""A map as one array of heights at equal steps: what the profilometry formats hold."""

from __future__ import annotations

import numpy as np

from surfuse.errors import DataError
from surfuse.map_files.placement import Placement
from surfuse.records import FloatArray, MapGrid, Regime, SurfaceMap

_STEP_TOLERANCE = 1e-6


def equal_step(nodes_m: FloatArray, name: str) -> float:
    """The step of an axis whose nodes are equally far apart.

    In m; `nodes_m` (N,) are increasing, `name` is that of the axis in the message.

    Raises
    ------
    DataError : one node only, or steps that differ by more than 1e-6 of their mean.
    """
    if len(nodes_m) < 2:
        raise DataError(f"the map has one node along {name}", cure="export to .csv or .nc instead")
    steps = np.diff(nodes_m)
    step = float(nodes_m[-1] - nodes_m[0]) / (len(nodes_m) - 1)
    if float(np.max(np.abs(steps - step))) > _STEP_TOLERANCE * step:
        raise DataError(
            f"the steps along {name} differ ({float(steps.min()):g} to {float(steps.max()):g} m), "
            "but this format has one step",
            cure="export to .csv or .nc instead",
        )
    return step


def heights_or_nan(surface: SurfaceMap) -> FloatArray:
    """Heights (R, C) with nan in every cell that was not measured, those that only the prior fills included.

    Raises
    ------
    DataError : no cell was measured.
    """
    if not surface.measured.any():
        raise DataError("the map has no measured cell", cure="nothing can be exported from an empty map")
    return np.where(surface.measured, surface.height_m, np.nan)


def map_of_heights(
    heights_m: FloatArray, du_m: float, dv_m: float, kind: str, placement: Placement | None = None
) -> SurfaceMap:
    """A map of plain heights (R, C); sigma and confidence are unknown (nan).

    Without a placement the part frame is the world, its origin the first node.
    """
    where = placement or Placement(np.eye(4))
    rows, columns = heights_m.shape
    mask = np.isfinite(heights_m)
    u_m: FloatArray = where.first_u_m + np.arange(columns, dtype=np.float64) * du_m
    v_m: FloatArray = where.first_v_m + np.arange(rows, dtype=np.float64) * dv_m
    frame = np.eye(4) if where.world_from_part is None else where.world_from_part
    unknown = np.full((rows, columns), np.nan)
    return SurfaceMap(
        grid=MapGrid(u_m=u_m, v_m=v_m, world_from_part=frame),
        height_m=np.where(mask, heights_m, np.nan),
        sigma_m=unknown,
        confidence=unknown,
        count=np.zeros((rows, columns), dtype=np.int64),
        mask=mask,
        regime=np.where(mask, np.uint8(Regime.MEASURED), np.uint8(Regime.EMPTY)),
        method=kind,
    )
