"""Areal surface texture parameters of ISO 25178-2, with the discretisation that the standard leaves open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from surfuse.errors import DataError
from surfuse.records import FloatArray, SurfaceMap


@dataclass(frozen=True)
class ArealParameters:
    """Heights in m; `sdq` a slope (m/m), `sdr` a ratio (0.05 is 5 %), skewness and kurtosis without unit.

    `sa_m`, `sq_m` are mean and root mean square height, `ssk` skewness, `sku` kurtosis, `sp_m`, `sv_m`, `sz_m` highest
    peak, deepest pit and their sum, `sdq` root mean square gradient, `sdr` developed area over projected area less 1.
    """

    sa_m: float
    sq_m: float
    ssk: float
    sku: float
    sp_m: float
    sv_m: float
    sz_m: float
    sdq: float
    sdr: float


def areal_parameters(surface: SurfaceMap, level: Literal["mean", "plane"] = "mean") -> ArealParameters:
    """Parameters of the cells that have a value; heights count from their mean, or from the least-squares plane.

    Raises
    ------
    DataError : no cell has a value.
    """
    height = np.where(surface.mask, surface.height_m, np.nan)
    if not np.any(surface.mask):
        raise DataError(f"the map of '{surface.method}' has no cell with a value", cure="scan the part first")
    if level == "plane":
        height = height - _plane(height, surface.grid.u_m, surface.grid.v_m)
    return parameters_of(height, surface.grid.u_m, surface.grid.v_m)


def parameters_of(height_m: FloatArray, u_m: FloatArray, v_m: FloatArray) -> ArealParameters:
    """Parameters of heights (R, C) over nodes u (C,), v (R,); nan marks cells without a value.

    Sa, Sq, Ssk, Sku, Sp, Sv, Sz are sums over the cells (ISO 25178-2, 4.1), heights about their mean; Ssk and Sku
    of a level surface are nan. Sdq is the root mean square of the one-sided differences between neighbouring cells,
    each direction averaged by itself. Sdr is the area of two triangles a cell (cut from its
    low-u high-v to its high-u low-v corner), relative to the cell's, minus 1.
    """
    z = height_m[np.isfinite(height_m)]
    z = z - np.mean(z)
    sq = float(np.sqrt(np.mean(z**2)))
    level = sq <= 1e-15 * max(1.0, float(np.max(np.abs(height_m[np.isfinite(height_m)]))))
    sp, sv = float(np.max(z)), float(-np.min(z))
    return ArealParameters(
        sa_m=float(np.mean(np.abs(z))),
        sq_m=sq,
        ssk=float("nan") if level else float(np.mean(z**3)) / sq**3,
        sku=float("nan") if level else float(np.mean(z**4)) / sq**4,
        sp_m=sp,
        sv_m=sv,
        sz_m=sp + sv,
        sdq=_sdq(height_m, u_m, v_m),
        sdr=_sdr(height_m, u_m, v_m),
    )


def _sdq(height: FloatArray, u: FloatArray, v: FloatArray) -> float:
    along_u = (np.diff(height, axis=1) / np.diff(u)).ravel()
    along_v = (np.diff(height, axis=0) / np.diff(v)[:, np.newaxis]).ravel()
    squares = [slope[np.isfinite(slope)] ** 2 for slope in (along_u, along_v)]
    return float(np.sqrt(sum(float(np.mean(square)) for square in squares if len(square))))


def _sdr(height: FloatArray, u: FloatArray, v: FloatArray) -> float:
    du, dv = np.meshgrid(np.diff(u), np.diff(v))
    a, b, c, d = height[:-1, :-1], height[:-1, 1:], height[1:, 1:], height[1:, :-1]
    # Triangles a-b-d and b-c-d: slopes along the two legs of each.
    legs = [((b - a) / du, (d - a) / dv), ((c - d) / du, (c - b) / dv)]
    ratios = [np.hypot(1.0, np.hypot(along_u, along_v)) for along_u, along_v in legs]
    area = np.concatenate([(du * dv)[np.isfinite(ratio)] for ratio in ratios])
    ratio = np.concatenate([ratio[np.isfinite(ratio)] for ratio in ratios])
    return float(np.sum(area * ratio) / np.sum(area) - 1.0) if len(area) else float("nan")


def _plane(height: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """The least-squares plane through the cells with a value, at every node."""
    uu, vv = np.meshgrid(u - np.mean(u), v - np.mean(v))
    known = np.isfinite(height)
    design = np.column_stack([uu[known], vv[known], np.ones(int(np.count_nonzero(known)))])
    slope_u, slope_v, offset = np.linalg.lstsq(design, height[known], rcond=None)[0]
    return np.asarray(slope_u * uu + slope_v * vv + offset, dtype=np.float64)
