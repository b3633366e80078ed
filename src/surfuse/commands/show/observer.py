"""Who looks on while a scan runs: told what happens, asked nothing, and unable to change it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray, FusionScene, ScanPlan, SurfaceMap, Sweep


@dataclass(frozen=True)
class PlannedScan:
    """A scan that begins.

    `scene` is what fusion knows, `plan` the stops to visit, `done` the sweeps of an earlier part of the same scan.
    `fresh_method` makes the fusion method anew: an observer that fuses shares nothing with the scan. `may_preview` says
    whether the method's preview costs no compiling now, which would hold up the scan. `link_poses` maps joints (N, J)
    to poses (N, L, 4, 4) of the arm's links (None: the shape of the arm is not known). `by_hand`: somebody else moves
    the arm, so that `plan` has no stops, only an outline (without an area: of what was seen first) and the map's step.
    """

    scene: FusionScene
    plan: ScanPlan
    done: tuple[Sweep, ...]
    fresh_method: Callable[[], FusionMethod]
    may_preview: Callable[[], bool]
    link_poses: Callable[[FloatArray], FloatArray] | None = None
    by_hand: bool = False


class ScanObserver(Protocol):
    """Told of a scan on the thread that runs it: every call returns at once and raises nothing."""

    def planned(self, scan: PlannedScan) -> None:
        """The scan begins."""

    def swept(self, sweep: Sweep) -> None:
        """A sweep is on disk, and fused."""

    def finished(self, surface: SurfaceMap) -> None:
        """The map of the whole scan."""


class Unobserved:
    """Nobody looks on."""

    def planned(self, scan: PlannedScan) -> None:
        """Ignore."""

    def swept(self, sweep: Sweep) -> None:
        """Ignore."""

    def finished(self, surface: SurfaceMap) -> None:
        """Ignore."""


UNOBSERVED = Unobserved()
