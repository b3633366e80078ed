"""Settings that all tests share, and the commands of surfuse as a user calls them."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import io
import json
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples on every machine and every day: a red test is a change of the code, never of the dice.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a command gave back."""

    status: int
    out: str
    err: str

    @property
    def json(self):
        """The document on stdout, which holds nothing else; numbers as JSON knows them."""

        def refuse(name: str) -> None:
            raise AssertionError(f"{name} is not JSON")

        return json.loads(self.out, parse_constant=refuse)

    def error(self, status: int, *words: str) -> str:
        """The one line that says what, where and what to do."""
        assert self.status == status, f"exit {self.status}: {self.err}"
        assert self.out == ""
        (line,) = self.err.splitlines()
        assert line.startswith("surfuse: ")
        assert len(line) < 1000
        for word in words:
            assert word in line, f"'{word}' is not in: {line}"
        return line


def run_command(*words: object) -> Answer:
    """Run `surfuse WORDS...` in this process, exactly as its console script does."""
    from surfuse import cli
    from surfuse.cli import _progress

    # A slow machine would otherwise add a line of progress to what a test reads.
    _progress.LINE_EVERY_S = 1e6
    out, err = io.StringIO(), io.StringIO()
    before, sys.argv = sys.argv, ["surfuse", *map(str, words)]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            cli.main()
    except SystemExit as ended:
        return Answer(int(ended.code), out.getvalue(), err.getvalue())
    finally:
        sys.argv = before
    raise AssertionError("a command always ends with an exit status")


@pytest.fixture
def ctrl_c_interrupts() -> Iterator[None]:
    """A Ctrl-C is a KeyboardInterrupt, also where the tests run in the background of a shell, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def command() -> Callable[..., Answer]:
    return run_command


def quick_scan(scene: str, folder: Path, *more: str) -> Path:
    """A scan of few stops with the paper's method: a minute of the robot's time, about a second of ours."""
    how = ("--method", "weighted_average", "--set", "scan.step_m=0.04", "--arm-driver", "kinematic", "--json", *more)
    answer = run_command("acquire", scene, "--out", folder, *how)
    assert answer.status == 0, answer.err
    assert answer.err == ""
    return folder


@pytest.fixture(scope="session")
def flat_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A complete run of the flat plate; tests read it and never write to it."""
    return quick_scan("flat", tmp_path_factory.mktemp("scans") / "flat")


def bits_of_map(run: Path) -> dict[str, bytes]:
    """Every array of the map and of the fused points, bit by bit."""
    from surfuse.exporters import nc

    surface, points = nc.read(run / "surface.nc"), nc.read_points(run / "surface.nc")
    parts = (surface, surface.grid, points)
    return {
        f"{type(part).__name__}.{field.name}": getattr(part, field.name).tobytes()
        for part in parts
        for field in dataclasses.fields(part)
        if hasattr(getattr(part, field.name), "tobytes")
    }


@pytest.fixture(scope="session")
def map_bits() -> Callable[[Path], dict[str, bytes]]:
    return bits_of_map


def digests_of(folder: Path) -> dict[str, str]:
    """Content of every file under a folder, by name; huge ones are left out."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.stat().st_size < 2**24)
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="session")
def digests() -> Callable[[Path], dict[str, str]]:
    return digests_of
