"""The map of a scan that still runs, made beside it from the sweeps that came so far."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from surfuse.commands.show.observer import PlannedScan
from surfuse.interfaces import LiveMapping
from surfuse.records import FusedPoints, MapGrid, SurfaceMap, Sweep, stacked_points
from surfuse.surface.gridding import grid_points, lattice


@dataclass
class WorkShare:
    """A share of the time: work may begin while what was spent before is within it."""

    share: float
    clock_s: Callable[[], float] = time.monotonic
    spent_s: float = 0.0

    def __post_init__(self) -> None:
        self._began_s = self.clock_s()

    def allows(self, expected_s: float = 0.0) -> bool:
        """Whether work that is expected to cost so much processor time may begin now."""
        return self.spent_s + expected_s <= self.share * (self.clock_s() - self._began_s)

    def spend(self, work_s: float) -> None:
        """So much processor time was worked."""
        self.spent_s += work_s


@dataclass
class MapSoFar:
    """Fusion beside the fusion of the scan, with a state of its own.

    A method that can show its own map is asked for it now and then; the cells that this map does not know yet have the
    fused points of their stops, as all cells have with any other method.
    """

    scan: PlannedScan
    _waiting: list[Sweep] = field(default_factory=list)
    _points: list[FusedPoints] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._method = self.scan.fresh_method()
        self._state = self._method.start(self.scan.scene)
        self._own: SurfaceMap | None = None
        self._grid = _given_grid(self.scan)

    def take(self, sweep: Sweep) -> None:
        """One sweep more; the work is done when the map is wanted."""
        self._waiting.append(sweep)

    def can_preview(self) -> bool:
        """Whether the method can show its own map, without compiling anything for it."""
        return self._grid is not None and isinstance(self._method, LiveMapping) and self.scan.may_preview()

    def surface(self, preview: bool) -> SurfaceMap | None:
        """The map now, None before the first fused point; with the method's own map brought up to now if `preview`."""
        self._points += [self._method.step(self._state, sweep) for sweep in self._waiting]
        self._waiting.clear()
        if not self._points:
            return None
        self._points = [stacked_points(self._points)]
        grid = self._grid or _seen_grid(self.scan, self._points[0])
        if grid is None:
            return None
        plain = grid_points(self._points[0], grid, self._method.name, self.scan.scene.outline)
        if preview and isinstance(self._method, LiveMapping):
            self._own = self._method.preview(self._state, grid)
        return plain if self._own is None else filled(self._own, plain)


def _given_grid(scan: PlannedScan) -> MapGrid | None:
    """The grid of the planned stops, or of the area; None where nobody said what will be seen."""
    frame, outline = scan.scene.world_from_part, scan.scene.outline
    if not scan.by_hand:
        return lattice(scan.plan.uv_m, frame)
    return None if outline is None else lattice(outline.vertices_m, frame, scan.plan.step_m)


def _seen_grid(scan: PlannedScan, points: FusedPoints) -> MapGrid | None:
    """The grid of what was seen so far; None before there is anything."""
    places = points.point_m[:, :2]
    if not np.isfinite(places).all(axis=1).any():
        return None
    return lattice(places, scan.scene.world_from_part, scan.plan.step_m)


def filled(first: SurfaceMap, second: SurfaceMap) -> SurfaceMap:
    """The first map, and where it has no value the second one, on the same grid."""
    take = first.mask | ~second.mask
    return replace(
        first,
        height_m=np.where(take, first.height_m, second.height_m),
        sigma_m=np.where(take, first.sigma_m, second.sigma_m),
        confidence=np.where(take, first.confidence, second.confidence),
        count=np.where(take, first.count, second.count),
        mask=first.mask | second.mask,
        regime=np.where(take, first.regime, second.regime),
        alternative_height_m=None,
        alternative_weight=None,
    )
