"""Where compiled kernels are kept between processes: a folder of this user's, and of no one else's.

A kept kernel is loaded by pickle, which runs what it finds. So a folder that another user can write to is never used.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from numba import config

PACKAGE = Path(__file__).resolve().parents[1]
POSIX = sys.platform != "win32" and "geteuid" in vars(os)


@dataclass(frozen=True)
class KernelFolder:
    """The folder, whether it outlives the process, and the folders that were refused before it.

    `path` is the folder itself; `lasting` is false for one in the temporary files of this process.
    """

    path: Path
    lasting: bool
    refused: tuple[Path, ...] = ()

    def environment(self) -> dict[str, str]:
        """The environment of a process that shall use the same folder."""
        return {**os.environ, "NUMBA_CACHE_DIR": str(self.path)}


@cache
def kernel_folder() -> KernelFolder | None:
    """The first folder that can be used: chosen by NUMBA_CACHE_DIR, in the package, the user's, a temporary one.

    None where not even a temporary folder can be made: kernels are then compiled and not kept.
    """
    refused: list[Path] = []
    for path in _candidates():
        if _usable(path):
            return KernelFolder(path, True, tuple(refused))
        refused.append(path)
    try:
        temporary = Path(tempfile.mkdtemp(prefix="surfuse-kernels-"))
    except OSError:
        return None
    atexit.register(_remove, temporary, os.getpid())
    return KernelFolder(temporary, False, tuple(refused))


def _candidates() -> Iterator[Path]:
    if chosen := vars(config)["CACHE_DIR"]:
        yield Path(chosen)
    yield PACKAGE / "__pycache__" / "kernels"
    installation = hashlib.sha256(os.fsencode(PACKAGE)).hexdigest()[:12]
    if (caches := _users_caches()) is not None:
        yield caches / "surfuse" / f"kernels-{installation}"


def _users_caches() -> Path | None:
    """Where the platform wants the caches of a user; None for a user without a home."""
    chosen = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME", "")
    if Path(chosen).is_absolute():
        return Path(chosen)
    try:
        home = Path.home()
    except RuntimeError:
        return None
    return home / ("Library/Caches" if sys.platform == "darwin" else ".cache")


def _usable(path: Path) -> bool:
    """Whether this process can write there (making the folder if need be), and no other user can."""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not only_ours(path.resolve()):
            return False
        tempfile.TemporaryFile(dir=path).close()
    except OSError:
        return False
    return True


def only_ours(path: Path) -> bool:
    """Whether nobody but this user and root can put files into a folder, nor move one above it out of the way.

    Without POSIX the folders of a user are private by inherited rights that are not looked at here.
    """
    if not POSIX:
        return True
    for folder in (path, *path.parents):
        found = folder.stat()
        if found.st_uid not in (0, os.geteuid()):
            return False
        by_others = found.st_mode & stat.S_IWOTH or (found.st_mode & stat.S_IWGRP and not _group_of_one(found.st_gid))
        # In a folder with the sticky bit nobody can move what is ours.
        if by_others and (folder == path or not found.st_mode & stat.S_ISVTX):
            return False
    return True


def _group_of_one(group: int) -> bool:
    """Whether a group is root's or the user's private one, with no other members."""
    import grp
    import pwd

    try:
        user, found = pwd.getpwuid(os.geteuid()).pw_name, grp.getgrgid(group)
    except KeyError:
        return False
    return found.gr_name in (user, "root") and set(found.gr_mem) <= {user, "root"}


def _remove(path: Path, process: int) -> None:
    if os.getpid() == process:
        shutil.rmtree(path, ignore_errors=True)
