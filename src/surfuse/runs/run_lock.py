"""One writer at a time in a run folder."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from filelock import FileLock, Timeout

from surfuse import durable
from surfuse.errors import StorageError

LOCK_NAME = ".lock"
HOLDER_NAME = ".lock.pid"


class RunLock:
    """A lock on a file, freed by the system when its holder dies, and beside it the holder's process id.

    The id has a file of its own: where locks are mandatory nobody else can read the locked one. Neither file is
    followed when it is a link.

    Raises
    ------
    StorageError : on entry, when another process holds the lock, or the file cannot be locked.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        # The file stays: removing it would let two processes lock two files of the same name.
        self._lock = FileLock(folder / LOCK_NAME, timeout=0, thread_local=False)

    def __enter__(self) -> Self:
        path = self._folder / LOCK_NAME
        try:
            self._lock.acquire()
        except Timeout as error:
            raise StorageError(
                f"another process (pid {self._holder() or 'unknown'}) is writing in this run folder",
                where=str(self._folder),
                cure="wait until it has ended, or choose another folder",
            ) from error
        except OSError as error:
            raise durable.storage_error(error, path, "lock the run folder") from error
        try:
            self._sign()
        except OSError as error:
            self._lock.release()
            raise durable.storage_error(error, self._folder / HOLDER_NAME, "lock the run folder") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):
            (self._folder / HOLDER_NAME).unlink(missing_ok=True)
        self._lock.release()

    def _sign(self) -> None:
        """Write the process id; a new file, so that no link is followed."""
        path = self._folder / HOLDER_NAME
        path.unlink(missing_ok=True)
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
        try:
            os.write(descriptor, f"{os.getpid()}\n".encode())
        finally:
            os.close(descriptor)

    def _holder(self) -> str:
        """The process id of the holder; empty when it cannot be read, or has not been written yet."""
        try:
            with (self._folder / HOLDER_NAME).open("rb") as file:
                return file.read(20).decode("ascii", "replace").strip()
        except OSError as error:
            if error.errno not in (errno.ENOENT, errno.EACCES):
                raise durable.storage_error(error, self._folder / HOLDER_NAME, "read who writes here") from error
            return ""
