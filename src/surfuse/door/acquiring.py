"""Acquisitions from Python: the main job, and going on with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from surfuse.commands.acquire import acquisition
from surfuse.commands.judge.findings import findings_of
from surfuse.commands.outcome import Outcome, SilentWatcher
from surfuse.door.arguments import FilePath, path_of, plain_values
from surfuse.door.logs import Log, read
from surfuse.door.maps import open_map
from surfuse.door.surface_map import SurfaceMap
from surfuse.settings import load


@dataclass(frozen=True, eq=False)
class Run:
    """An acquisition on disk: `path` of its folder, `summary` as `surfuse acquire --json` prints it, and `warnings`.

    `complete` is false when it was interrupted and can be resumed; it has no map then.
    """

    path: Path
    summary: Mapping[str, object]
    complete: bool
    warnings: tuple[str, ...] = ()

    @property
    def surface(self) -> SurfaceMap:
        """The map of the run.

        Raises
        ------
        DataError : the run is not complete.
        """
        opened = open_map(self.path)
        findings = findings_of(self.warnings, opened.record)
        return SurfaceMap(opened.record, opened.points, findings, judged=True, path=opened.path)

    @property
    def log(self) -> Log:
        """The readings of the run."""
        return read(self.path)


@dataclass
class _Listener(SilentWatcher):
    """A watcher that keeps the warnings."""

    warnings: list[str] = field(default_factory=list)

    def warn(self, text: str) -> None:
        self.warnings.append(text)


def acquire(
    scene: FilePath | None = None,
    out: FilePath | None = None,
    seed: int | None = None,
    cell: FilePath | None = None,
    method: str | None = None,
    settings: Mapping[str, object] | None = None,
    yes: bool = False,
) -> Run:
    """Find the part, outline it, plan, scan and fuse, as `surfuse acquire` does; the simulated cell without `cell`.

    `scene` is "flat", "tilted", "relief" or a mesh file (None: that of the cell file, or the relief); `out` the folder
    of the run, which must not exist yet (None: a new one under runs/); `settings` values by key path, as
    `{"scan.margin_m": 0.03}` (docs/reference/settings.md lists them). Arguments with a name of their own win. A
    real arm only moves with `yes`.

    Raises
    ------
    SurfuseError : of the kind of what went wrong; whatever was scanned before is on disk.
    """
    name = None if scene is None else str(path_of(scene, "scene"))
    named: dict[str, object] = {"scene.name": name, "fusion.method": method, "seed": seed}
    values = plain_values(settings, "settings")
    values |= {key: value for key, value in plain_values(named, "arguments").items() if value is not None}
    configuration = load(None if cell is None else path_of(cell, "cell"), values=values)
    watcher = _Listener()
    folder = None if out is None else path_of(out, "out")
    return _run(acquisition.acquire(configuration, folder, watcher, yes=yes), watcher)


def resume(path: FilePath, yes: bool = False) -> Run:
    """Go on with an interrupted acquisition; its map is the one that the uninterrupted run would have given.

    A real arm only moves with `yes`.

    Raises
    ------
    DataError : not the folder of an acquisition.
    StorageError : another process is writing in it.
    """
    watcher = _Listener()
    return _run(acquisition.resume(path_of(path, "path"), watcher, yes=yes), watcher)


def _run(outcome: Outcome, watcher: _Listener) -> Run:
    return Run(Path(str(outcome.summary["run"])), outcome.summary, outcome.complete, tuple(watcher.warnings))
