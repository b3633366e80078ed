"""Where an interrupted acquisition stands: what its log already holds, and which stops are left."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from surfuse.errors import DataError
from surfuse.records import FusionScene, ScanPlan, Sweep
from surfuse.runs.log_files import has_segments
from surfuse.runs.log_reader import read_log
from surfuse.runs.log_records import RunLog


@dataclass(frozen=True)
class ScanProgress:
    """The state of a scan on disk; search result, outline and plan are those of its start, bit by bit.

    `done` are the sweeps in the order of their stops; `left` the numbers of the stops that have no complete sweep, in
    visiting order (stops are numbered by their place in the plan).
    """

    scene: FusionScene
    plan: ScanPlan
    done: tuple[Sweep, ...]
    left: tuple[int, ...]
    log: RunLog

    @property
    def complete(self) -> bool:
        """Whether every stop of the plan has its sweep."""
        return not self.left


def read_progress(path: Path) -> ScanProgress | None:
    """Progress of the run in `path` (run folder or log folder); None when it ended before its plan was stored.

    In that case nothing was scanned and the search begins afresh.

    Raises
    ------
    DataError : nothing there, or the log holds sweeps but its scene or plan is damaged, and there is no way on.
    """
    if not has_segments(path):
        return None
    log = read_log(path)
    if log.scene is None or log.plan is None:
        if log.sweeps:
            lost = "scene" if log.scene is None else "plan"
            raise DataError(
                f"the log holds {len(log.sweeps)} sweeps, but its {lost} is missing or damaged",
                where=str(path),
                cure="fuse what there is with 'surfuse fuse', or acquire afresh into another folder",
            )
        return None
    taken = {sweep.stop for sweep in log.sweeps}
    return ScanProgress(
        scene=log.scene,
        plan=log.plan,
        done=log.sweeps,
        left=tuple(stop for stop in range(len(log.plan)) if stop not in taken),
        log=log,
    )
