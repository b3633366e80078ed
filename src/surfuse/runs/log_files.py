"""Names of the files of a log folder."""

from __future__ import annotations

from pathlib import Path

from surfuse.errors import DataError, StorageError


def segment_paths(folder: Path) -> list[Path]:
    """The MCAP segments of a log folder in the order of their numbers, then others by name."""
    found = [path for path in folder.glob("*.mcap") if path.is_file() and not path.name.startswith(".")]
    return sorted(found, key=lambda path: (not path.stem.isdigit(), int(path.stem) if path.stem.isdigit() else 0, path))


def next_segment(folder: Path) -> Path:
    """Path of the segment that comes after those that are there."""
    numbers = [int(path.stem) for path in segment_paths(folder) if path.stem.isdigit()]
    return folder / f"{max(numbers, default=-1) + 1:03d}.mcap"


def log_segments(path: Path) -> list[Path]:
    """The segments that a LOG argument means: a run folder, its log folder, a bag folder, or one file.

    Raises
    ------
    DataError : nothing there, or no segment in it.
    """
    if path.is_file():
        return [path]
    if not path.exists():
        raise DataError(
            f"there is no such {'file' if path.suffix else 'file or folder'}",
            where=str(path),
            cure="check the path; a log is a run folder, an .mcap or a .csv file",
        )
    for folder in (path / "log", path):
        found = segment_paths(folder) if folder.is_dir() else []
        if found:
            return found
    raise DataError(
        "the folder holds no log segment (*.mcap)", where=str(path), cure="give a run folder, an .mcap or a .csv file"
    )


def has_segments(path: Path) -> bool:
    """Whether a run folder or log folder, which must be there, holds any segment.

    Raises
    ------
    DataError : there is no such folder.
    """
    if not path.is_dir():
        raise DataError("there is no such run folder", where=str(path), cure="give a run folder")
    return any(segment_paths(folder) for folder in (path / "log", path) if folder.is_dir())


def read_whole(path: Path) -> bytes:
    """Content of a file.

    Raises
    ------
    DataError : there is no such file, or it is a folder.
    StorageError : the operating system refuses to read it.
    """
    try:
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise DataError("there is no such file", where=str(path), cure="check the path") from error
    except IsADirectoryError as error:
        raise DataError("it is a folder", where=str(path), cure="give the path of a file") from error
    except OSError as error:
        raise StorageError(
            f"cannot read the file: {error.strerror}", where=str(path), cure="check its permissions"
        ) from error
