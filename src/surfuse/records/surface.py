"""Maps of the surface and how good they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import DataError
from surfuse.records.checks import (
    BoolArray,
    ByteArray,
    FloatArray,
    IntArray,
    check_increasing,
    check_least,
    check_share,
    own,
    own_pose,
)
from surfuse.records.codes import Regime
from surfuse.records.columns import ArrayRecord
from surfuse.records.fused import FusedPoints
from surfuse.records.guard import RegionDecision


@dataclass(frozen=True, eq=False)
class MapGrid(ArrayRecord):
    """Node-registered axes of a map: `u_m` (C,) and `v_m` (R,) increasing, in a part frame."""

    u_m: FloatArray
    v_m: FloatArray
    world_from_part: FloatArray

    def __post_init__(self) -> None:
        own(self, np.float64, u_m=(None,), v_m=(None,))
        own_pose(self, "world_from_part")
        for name, nodes in (("u_m", self.u_m), ("v_m", self.v_m)):
            if len(nodes) == 0:
                raise DataError(f"MapGrid.{name} is empty", cure="give at least one node")
            check_increasing(nodes, f"MapGrid.{name}")

    @property
    def shape(self) -> tuple[int, int]:
        """(R, C): nodes along v, nodes along u."""
        return len(self.v_m), len(self.u_m)


@dataclass(frozen=True, eq=False)
class SurfaceMap(ArrayRecord):
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
        own(self, np.float64, height_m=shape, sigma_m=shape, confidence=shape)
        own(self, np.int64, count=shape)
        own(self, np.bool_, mask=shape)
        own(self, np.uint8, regime=shape)
        self._check_layers()
        self._own_alternative()

    def _check_layers(self) -> None:
        empty = self.mask & ~np.isfinite(self.height_m)
        if np.any(empty):
            row, column = np.argwhere(empty)[0]
            raise DataError(
                f"{np.count_nonzero(empty)} cells are marked as measured without a finite height, the first at "
                f"u = {self.grid.u_m[column]:g} m, v = {self.grid.v_m[row]:g} m",
                cure="mark only cells that have a value",
            )
        check_least(self.sigma_m, "SurfaceMap.sigma_m", 0.0)
        check_least(self.count, "SurfaceMap.count", 0.0)
        check_share(self.confidence, "SurfaceMap.confidence")
        if np.any(self.regime > max(Regime)):
            raise DataError(f"SurfaceMap.regime holds {self.regime.max()}", cure=f"give 0 to {int(max(Regime))}")

    def _own_alternative(self) -> None:
        """The second surface: both of its layers, or neither."""
        if self.alternative_height_m is None and self.alternative_weight is None:
            return
        if self.alternative_height_m is None or self.alternative_weight is None:
            given = "height" if self.alternative_weight is None else "weight"
            raise DataError(f"a map has the {given} of a second surface alone", cure="give both layers, or neither")
        own(self, np.float64, alternative_height_m=self.grid.shape, alternative_weight=self.grid.shape)
        check_share(self.alternative_weight, "SurfaceMap.alternative_weight")

    @property
    def measured(self) -> BoolArray:
        """Cells (R, C) whose value rests on readings: those with a value, but without what only the prior says."""
        return np.asarray(self.mask & (self.regime != int(Regime.PRIOR)), dtype=np.bool_)


@dataclass(frozen=True, eq=False)
class FusionResult(ArrayRecord):
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


@dataclass(frozen=True)
class DenseScore:
    """Errors (map minus truth, along w) over the whole true part, in m.

    `off_edge_rmse_m` leaves out the places within a step (8 mm within 6 mm). `edge_m` is the mean signed error of
    the edges of all steps, across them; positive: the higher side reaches out too far; nan: truth has no step, or the
    map has none of its edges. `within` is the share (0 to 1) of the places that are right to 3 mm, where the map has
    no value it is wrong; `coverage` the share where it has one. `places`: how many places both have.
    """

    rmse_m: float
    off_edge_rmse_m: float
    edge_m: float
    within: float
    coverage: float
    places: int
