"""Where kernels are kept: never where another user can write, and never a reason to fail."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import surfuse
from surfuse.geometry.kernel_folder import only_ours

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="rights of POSIX")

NOBODY = 65534
NO_HOME = "/proc/nowhere"
PROGRAM = """
import numpy as np
from surfuse.geometry.polygons import signed_distance
from surfuse.geometry.kernel_folder import kernel_folder
square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
assert signed_distance([[1.0, 0.5]], square)[0] == 0.5
folder = kernel_folder()
print(folder and folder.lasting, folder and folder.path)
"""


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """A copy of what the program needs, in which not even root can make a folder for kernels."""
    site, here = tmp_path / "site", Path(surfuse.__file__).parent
    for name in ("geometry", "records"):
        shutil.copytree(here / name, site / "surfuse" / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("__init__.py", "errors.py"):
        shutil.copy(here / name, site / "surfuse" / name)
    (site / "surfuse" / "__pycache__").write_text("a file")
    return site


def run(site: Path, **environment: str) -> tuple[str, str]:
    """`lasting path` of a process that uses a kernel of that installation, and what it said on stderr."""
    path = os.pathsep.join([str(site), *(entry for entry in sys.path if "site-packages" in entry)])
    bare = {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "PATH": os.environ["PATH"], **environment}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM],
        env=bare,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr


def test_without_rights_on_the_installation_the_users_cache_is_taken(installed: Path, tmp_path: Path) -> None:
    told, stderr = run(installed, XDG_CACHE_HOME=str(tmp_path / "cache"), HOME=NO_HOME)
    assert told.startswith(f"True {tmp_path / 'cache'}")
    assert stderr == ""
    assert list((tmp_path / "cache").rglob("*.nbi"))


def test_without_a_home_either_a_temporary_folder_is_taken_that_goes(installed: Path, tmp_path: Path) -> None:
    (tmp_path / "tmp").mkdir()
    told, stderr = run(installed, HOME=NO_HOME, TMPDIR=str(tmp_path / "tmp"))
    assert told.startswith(f"False {tmp_path / 'tmp'}")
    assert stderr == ""
    assert not list((tmp_path / "tmp").iterdir())


def test_a_cache_that_others_can_write_is_not_used(installed: Path, tmp_path: Path) -> None:
    for name in ("chosen", "home"):
        (tmp_path / name).mkdir()
        (tmp_path / name).chmod(0o777)
    told, _ = run(installed, NUMBA_CACHE_DIR=str(tmp_path / "chosen"), HOME=str(tmp_path / "home"))
    assert told.startswith("False ")
    assert not list(tmp_path.rglob("*.nbi"))


def test_a_folder_is_ours_when_nobody_else_can_write_it_or_move_it(tmp_path: Path) -> None:
    folder = tmp_path / "above" / "cache"
    folder.mkdir(parents=True, mode=0o700)
    assert only_ours(folder)
    folder.chmod(0o702)
    assert not only_ours(folder)
    folder.chmod(0o1702)  # the sticky bit keeps others from moving files, not from adding them
    assert not only_ours(folder)
    folder.chmod(0o700)
    folder.parent.chmod(0o777)
    assert not only_ours(folder)
    folder.parent.chmod(0o1777)
    assert only_ours(folder)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give folders away")
def test_a_folder_of_another_user_is_not_ours(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir()
    os.chown(tmp_path / "theirs", NOBODY, NOBODY)
    assert not only_ours(tmp_path / "theirs")
    (tmp_path / "group").mkdir(mode=0o770)
    os.chown(tmp_path / "group", 0, NOBODY)
    (tmp_path / "group").chmod(0o770)
    assert not only_ours(tmp_path / "group")
