"""The run folder: its names, who may write in it, and how files get into it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from surfuse import durable
from surfuse.errors import DataError, StorageError
from surfuse.runs.log_files import segment_paths
from surfuse.runs.run_lock import HOLDER_NAME, LOCK_NAME, RunLock


@dataclass(frozen=True)
class RunFolder:
    """Paths of one run; `create` and `open` check, the constructor does not touch the disk."""

    path: Path

    @property
    def log(self) -> Path:
        """Folder of the MCAP segments, itself a ROS 2 bag."""
        return self.path / "log"

    @property
    def surface(self) -> Path:
        """The native map."""
        return self.path / "surface.nc"

    @property
    def report(self) -> Path:
        """The self-contained page."""
        return self.path / "report.html"

    @property
    def configuration(self) -> Path:
        """The whole configuration with seed and versions."""
        return self.path / "run.toml"

    @property
    def summary(self) -> Path:
        """The result in numbers."""
        return self.path / "summary.json"

    @property
    def truth(self) -> Path:
        """The twin's true surface, for evaluation only; absent on a real cell."""
        return self.path / "truth.ply"

    @classmethod
    def create(cls, path: Path) -> RunFolder:
        """Make a new run folder; an empty one, or what a run left that was killed before it began, is taken as it is.

        Raises
        ------
        StorageError : a file, a folder with something in it, or a place where nothing can be written.
        """
        if path.exists() and not path.is_dir():
            raise StorageError("it is a file", where=str(path), cure="choose another folder with --out")
        try:
            path.mkdir(parents=True, exist_ok=True)
            if not _unused(path):
                raise StorageError(
                    "the folder is not empty and nothing in it is overwritten",
                    where=str(path),
                    cure="choose another folder with --out, or go on with 'surfuse resume'",
                )
            (path / "log").mkdir(exist_ok=True)
            durable.sync_folder(path)
            durable.sync_folder(path.parent)
        except OSError as error:
            raise durable.storage_error(error, path, "create the run folder") from error
        return cls(path)

    @classmethod
    def open(cls, path: Path, need_log: bool = True) -> RunFolder:
        """An existing run folder: one with a configuration and, unless `need_log` is false, at least one segment.

        A run that was killed right at its start has no segment yet; `resume` begins it afresh.

        Raises
        ------
        DataError : not there, or not a run folder; the message names what is missing.
        """
        if not path.is_dir():
            what = "it is a file" if path.exists() else "there is no such folder"
            raise DataError(what, where=str(path), cure="give a run folder")
        run = cls(path)
        if not run.configuration.is_file() and run.log.is_dir() and _unused(path):
            raise DataError("the run was killed before it began", where=str(path), cure="acquire into it again")
        missing = [] if run.configuration.is_file() else ["run.toml"]
        if need_log and not (run.log.is_dir() and segment_paths(run.log)):
            missing.append("log/*.mcap")
        if missing:
            raise DataError(
                f"not a run folder: {' and '.join(missing)} missing", where=str(path), cure="give a run folder"
            )
        return run

    def lock(self) -> RunLock:
        """The right to write in this folder, to be taken with `with`."""
        return RunLock(self.path)

    def write_text(self, path: Path, content: str) -> None:
        """Replace a file of this run, atomically and durably."""
        durable.write_text(path, content, overwrite=True)

    def write_bytes(self, path: Path, content: bytes) -> None:
        """Replace a file of this run, atomically and durably."""
        durable.write_bytes(path, content, overwrite=True)


def _unused(path: Path) -> bool:
    """Whether a folder holds nothing but what a run makes before its configuration is written."""
    return all(
        entry.name in (LOCK_NAME, HOLDER_NAME)
        or (entry.name.startswith(".run-") and entry.suffix == ".toml")
        or (entry.name == "log" and entry.is_dir() and not any(entry.iterdir()))
        for entry in path.iterdir()
    )
