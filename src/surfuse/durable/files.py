"""Files that appear whole or not at all, and stay after a power cut."""

from __future__ import annotations

import errno
import os
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Self

from surfuse.errors import StorageError

_CURES = {
    errno.ENOSPC: "free some disk space and try again",
    errno.EDQUOT: "your disk quota is used up: free some space and try again",
    errno.EFBIG: "the file size limit of this process is reached: raise it (ulimit -f) and try again",
    errno.EROFS: "the file system is read-only: choose another folder",
    errno.EACCES: "you may not write there: choose another folder or change its permissions",
    errno.EPERM: "you may not write there: choose another folder or change its permissions",
    errno.ENOENT: "the folder does not exist (any more): create it or choose another one",
    errno.ENOTDIR: "a part of the path is a file, not a folder: choose another folder",
    errno.EISDIR: "it is a folder: give the name of a file",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.ELOOP: "it is a symbolic link, which is not followed: remove it",
}
_REPLACE_TRIES, _REPLACE_WAIT_S = 10, 0.05


class ExistingFileError(StorageError):
    """Something lies where a file would be written, and nobody asked to replace it."""

    def asked_by(self, asking: str) -> Self:
        """The same error, whose cure names the way in which this caller asks to replace a file."""
        return type(self)(self.what, cure=f"choose another name, or {asking} to replace it", where=self.where)


def storage_error(error: OSError, path: Path, doing: str) -> StorageError:
    """Turn what the operating system said into an error that names the file and the cure."""
    cure = _CURES.get(error.errno or 0, "check the disk and try again")
    return StorageError(f"cannot {doing}: {error.strerror or error}", where=str(path), cure=cure)


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable: a new or renamed file survives a power cut only after this."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except PermissionError:
        # Windows opens no folders; its file system keeps a journal of names by itself.
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network file systems cannot sync a folder; their server orders the names itself.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def refuse_existing(path: Path, overwrite: bool) -> None:
    """Raise StorageError when something lies at `path` that may not be replaced; `ExistingFileError` for a file."""
    if path.is_dir():
        raise StorageError("it is a folder", where=str(path), cure="give the name of a file")
    if path.exists() and not overwrite:
        raise ExistingFileError(
            "the file exists and is not overwritten", where=str(path), cure="choose another name, or remove it first"
        )


@contextmanager
def replacing(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Yield a temporary path in the same folder that becomes `path` when the block ends well.

    The temporary file is synced, renamed over `path`, and the folder is synced. When the block raises, the
    temporary file is removed and whatever was at `path` stays as it was.

    Raises
    ------
    StorageError : `path` exists and `overwrite` is false, or the disk refused.
    """
    refuse_existing(path, overwrite)
    temporary = path.with_name(f".{path.stem[:40]}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix}")
    try:
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        raise storage_error(error, path, "create the file") from error
    try:
        yield temporary
        _publish(temporary, path, overwrite)
    except OSError as error:
        raise storage_error(error, path, "write the file") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _publish(temporary: Path, path: Path, overwrite: bool) -> None:
    # Windows syncs only what is open for writing.
    descriptor = os.open(temporary, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
    if overwrite:
        replace_file(temporary, path)
    else:
        # A hard link refuses an existing name, so that two writers cannot both win.
        try:
            os.link(temporary, path)
        except FileExistsError:
            refuse_existing(path, overwrite)
        except OSError:
            replace_file(temporary, path)
    sync_folder(path.parent)


def replace_file(source: Path, path: Path) -> None:
    """Rename over whatever is at `path`.

    Windows refuses while a reader, often a virus scanner, has the old file open: that passes, so it is tried again.
    """
    for _ in range(_REPLACE_TRIES if os.name == "nt" else 0):
        with suppress(PermissionError):
            source.replace(path)
            return
        time.sleep(_REPLACE_WAIT_S)
    source.replace(path)


def write_bytes(path: Path, content: bytes, *, overwrite: bool = False) -> None:
    """Write a whole file atomically and durably; see `replacing`."""
    with replacing(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, content: str, *, overwrite: bool = False) -> None:
    """Write a whole UTF-8 file atomically and durably; see `replacing`."""
    write_bytes(path, content.encode("utf-8"), overwrite=overwrite)
