"""Maps of the surface and how good they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import DataError
from surfuse.records.checks import BoolArray, ByteArray, FloatArray, IntArray, own, own_pose
from surfuse.records.codes import Regime
from surfuse.records.fused import FusedPoints
from surfuse.records.guard import RegionDecision


@dataclass(frozen=True)
class MapGrid:
    """Node-registered axes of a map: `u_m` (C,) and `v_m` (R,) increasing, in a part frame."""

    u_m: FloatArray
    v_m: FloatArray
    world_from_part: FloatArray

    def __post_init__(self) -> None:
        own(self, np.float64, u_m=(None,), v_m=(None,))
        own_pose(self, "world_from_part")
        for name, nodes in (("u_m", self.u_m), ("v_m", self.v_m)):
            if len(nodes) == 0 or not np.all(np.isfinite(nodes)) or np.any(np.diff(nodes) <= 0.0):
                raise DataError(f"MapGrid.{name} must be finite, increasing and not empty")

    @property
    def shape(self) -> tuple[int, int]:
        """(R, C): nodes along v, nodes along u."""
        return len(self.v_m), len(self.u_m)


@dataclass(frozen=True)
class SurfaceMap:
    """The fused surface w over (u, v): all layers (R, C), rows along v, columns along u.

    `mask` marks the cells that have a value; elsewhere height and sigma are nan. `count` says how many readings a
    cell rests on, `regime` (see `Regime`) what kind of evidence. Where two surfaces compete (beside a step), a method
    may give the second one: its height (nan: none) and its probability (0: none); both or neither.
    """

    grid: MapGrid
    height_m: FloatArray
    sigma_m: FloatArray
    confidence: FloatArray
    count: IntArray
    mask: BoolArray
    regime: ByteArray
    method: str
    alternative_height_m: FloatArray | None = None
    alternative_weight: FloatArray | None = None
    decisions: tuple[RegionDecision, ...] = ()

    def __post_init__(self) -> None:
        shape = self.grid.shape
        if self.alternative_height_m is not None and self.alternative_weight is not None:
            own(self, np.float64, alternative_height_m=shape, alternative_weight=shape)
        own(self, np.float64, height_m=shape, sigma_m=shape, confidence=shape)
        own(self, np.int64, count=shape)
        own(self, np.bool_, mask=shape)
        own(self, np.uint8, regime=shape)
        if not np.all(np.isfinite(self.height_m[self.mask])):
            raise DataError("a map has cells marked as measured without a finite height")

    @property
    def measured(self) -> BoolArray:
        """Cells (R, C) whose value rests on readings: those with a value, but without what only the prior says."""
        return np.asarray(self.mask & (self.regime != int(Regime.PRIOR)), dtype=np.bool_)


@dataclass(frozen=True)
class FusionResult:
    """What a fusion method returns: its points, and its own map when it makes one (None: grid the points)."""

    points: FusedPoints
    surface: SurfaceMap | None = None


@dataclass(frozen=True)
class Score:
    """Errors of a map against truth over the cells where both have a value; coverage over all cells of the truth."""

    rmse_m: float
    mae_m: float
    bias_m: float
    p95_m: float
    coverage: float
    cells: int
