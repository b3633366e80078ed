"""Fusion methods that make their map from all readings at once: they collect live, and estimate at the end.

Such a method is one function from a survey and a grid to heights (`mapwise`), or from all readings to a map. Live and
replayed fusion bring the same readings in the same order to the same function, so the numbers agree to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from surfuse.confidence.gate import GateParameters
from surfuse.errors import DataError
from surfuse.fusing.median_of_sweep import medians
from surfuse.fusing.places import counted, nodes_on_part, reach_of
from surfuse.fusing.survey import Survey, survey
from surfuse.interfaces import FusionMethod
from surfuse.records import (
    BoolArray,
    FloatArray,
    FusedPoints,
    FusionResult,
    FusionScene,
    MapGrid,
    Readings,
    Regime,
    SurfaceMap,
    Sweep,
    readings_from_sweeps,
)


@dataclass(frozen=True)
class Estimate:
    """Heights and their standard deviation (R, C), nan where there is none, and which readings (N,) they rest on.

    `height_m` and `sigma_m` in m along w of the part frame; `used` counts from the first reading of the survey.
    """

    height_m: FloatArray
    sigma_m: FloatArray
    used: BoolArray


Estimator = Callable[[Survey, MapGrid], Estimate]
Mapper = Callable[[FusionScene, Readings, FusedPoints, MapGrid], SurfaceMap]


@dataclass
class MapwiseState:
    """Where a live fusion stands: the scene, the state of the points, the sweeps so far.

    `local` is the state of the method that makes the points; the map is made of the `sweeps` when it is asked for.
    """

    scene: FusionScene
    local: object
    sweeps: list[Sweep] = field(default_factory=list)


@dataclass(frozen=True)
class MapwiseFusion:
    """A `FusionMethod` made of a name, a sweep-wise method for its points, and a function for its map.

    `local` fuses stop by stop; `mapper` makes an `Estimate` of a survey and a grid, once all readings are there.
    """

    name: str
    local: FusionMethod
    mapper: Mapper

    def start(self, scene: FusionScene) -> MapwiseState:
        """A fresh state."""
        return MapwiseState(scene, self.local.start(scene))

    def step(self, state: object, sweep: Sweep) -> FusedPoints:
        """Keep the sweep; the point of this stop is that of the sweep-wise method."""
        own = self._own(state)
        point = self.local.step(own.local, sweep)
        own.sweeps.append(sweep)
        return point

    def finish(self, state: object, grid: MapGrid) -> FusionResult:
        """The points so far and the map of all their readings."""
        own = self._own(state)
        points = self.local.finish(own.local, grid).points
        readings = readings_from_sweeps(own.scene.specs, own.sweeps)
        return FusionResult(points, self.mapper(own.scene, readings, points, grid))

    def replay(self, scene: FusionScene, readings: Readings, grid: MapGrid) -> FusionResult:
        """The whole scan at once."""
        points = self.local.replay(scene, readings, grid).points
        return FusionResult(points, self.mapper(scene, readings, points, grid))

    def _own(self, state: object) -> MapwiseState:
        if not isinstance(state, MapwiseState):
            raise DataError(
                f"'{self.name}' was given a state of type {type(state).__name__}", cure="pass what its start() returned"
            )
        return state


def mapwise(name: str, gates: GateParameters, estimator: Estimator, local: FusionMethod | None = None) -> FusionMethod:
    """The method whose map is the estimator's, and whose points are those of `local` (default: medians of sweeps)."""

    def mapped(scene: FusionScene, readings: Readings, points: FusedPoints, grid: MapGrid) -> SurfaceMap:
        heard = survey(scene, readings, points.gate, grid)
        nothing = np.full(grid.shape, np.nan)
        none = Estimate(nothing, nothing, np.zeros(0, dtype=np.bool_))
        return map_of_estimate(name, heard, grid, estimator(heard, grid) if len(heard) else none)

    return MapwiseFusion(name, local or medians(gates), mapped)


def map_of_estimate(name: str, heard: Survey, grid: MapGrid, estimate: Estimate) -> SurfaceMap:
    """The map of an estimate: nodes off the part are masked.

    Count is the number of readings that the estimate rests on within reach of a node; confidence is their share of all
    readings that were taken there, refused ones included.
    """
    with np.errstate(invalid="ignore"):
        mask = np.isfinite(estimate.height_m) & (estimate.sigma_m > 0.0) & np.isfinite(estimate.sigma_m)
    mask &= nodes_on_part(grid, heard.outline, estimate.height_m)
    reach = reach_of(heard, grid)
    count = counted(heard.foot_m[estimate.used, :2], grid, reach)
    taken = np.maximum(counted(heard.seen_m, grid, reach), 1)
    return SurfaceMap(
        grid=grid,
        height_m=np.where(mask, estimate.height_m, np.nan),
        sigma_m=np.where(mask, estimate.sigma_m, np.nan),
        confidence=np.where(mask, np.minimum(1.0, count / taken), 0.0),
        count=np.where(mask, count, 0),
        mask=mask,
        regime=np.where(mask, int(Regime.MEASURED), int(Regime.EMPTY)).astype(np.uint8),
        method=name,
    )
