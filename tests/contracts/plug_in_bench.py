"""What a bench of a plug-in offers to the contract suites, and how the bench of a name is found."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import get_type_hints

import cv2
import pytest

from surfuse import registry
from surfuse.interfaces import PoseArm
from surfuse.records import FloatArray

BENCHES = Path(__file__).parent / "benches"


class TickingClock:
    """Simulated time that also goes on a little whenever somebody looks."""

    def __init__(self) -> None:
        self.time_s = 100.0

    def now_s(self) -> float:
        self.time_s += 1e-6
        return self.time_s

    def advance(self, duration_s: float) -> None:
        assert duration_s >= 0.0
        self.time_s += duration_s


@dataclass(frozen=True)
class SensorBench:
    """A ranger with its stand-in before a plate at `range_m`.

    `values` is the table of a file that says the same as `parameters`. `vanish` takes the device away. `always_open`:
    it has no connection. `own_time`: its times are those of a record.
    """

    parameters: object
    values: Mapping[str, object]
    range_m: float
    vanish: Callable[[], object] | None = None
    always_open: bool = False
    own_time: bool = False


@dataclass(frozen=True)
class ArmBench:
    """An arm with its stand-in, which can be sent to `target_rad` (J,) and arrives there within `close_rad`.

    `vanish` takes the arm away. `own_time`: its times are those of a record.
    """

    parameters: object
    values: Mapping[str, object]
    target_rad: FloatArray
    close_rad: float
    vanish: Callable[[], object] | None = None
    own_time: bool = False


@dataclass(frozen=True)
class PoseArmBench:
    """An arm that is sent to poses, with its stand-in.

    It can be sent to `world_from_tool` (4, 4), arrives there within `close_m`, and cannot take `out_of_reach` (4, 4).
    `displace` moves the tool without being asked, `vanish` takes the arm away.
    """

    parameters: object
    values: Mapping[str, object]
    world_from_tool: FloatArray
    out_of_reach: FloatArray
    close_m: float
    displace: Callable[[], object]
    vanish: Callable[[], object]


@dataclass(frozen=True)
class CameraBench:
    """A camera with its stand-in that shows more than one picture."""

    parameters: object
    values: Mapping[str, object]
    vanish: Callable[[], object] | None = None
    always_open: bool = False


@dataclass(frozen=True)
class LawBench:
    """A control law for the PUMA 560."""

    parameters: object
    values: Mapping[str, object]


def arm_names(*, takes_poses: bool) -> tuple[str, ...]:
    """Names of the built-in arms that take poses of their tool, or of those that take joints."""
    names = registry.found("arms").built_in
    made = [get_type_hints(registry.load("arms", name).create)["return"] for name in names]
    return tuple(name for name, kind in zip(names, made, strict=True) if issubclass(kind, PoseArm) == takes_poses)


def names_of(kind: str) -> set[str]:
    """Names of the benches of a kind."""
    return {path.stem for path in (BENCHES / kind).glob("*.py")}


def bench_module(kind: str, name: str) -> ModuleType:
    """The bench of a plug-in; it has `bench(folder)`, a context manager."""
    path = BENCHES / kind / f"{name}.py"
    if not path.is_file():
        raise AssertionError(f"the plug-in '{name}' of '{kind}' has no bench: write {path}")
    spec = importlib.util.spec_from_file_location(f"bench_{kind}_{name}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def opened_bench(kind: str, name: str, folder: Path) -> AbstractContextManager[object]:
    """The bench of a plug-in, set up."""
    bench: AbstractContextManager[object] = bench_module(kind, name).bench(folder)
    return bench


@contextmanager
def nothing_opened() -> Iterator[None]:
    """Inside of it no file, port, process or thread can be opened."""
    assert cv2.VideoCapture  # imported before nothing can be read any more

    def refuse(*arguments: object, **named: object) -> object:
        raise AssertionError(f"something was opened: {arguments}")

    with pytest.MonkeyPatch.context() as patch:
        for place in (
            "builtins.open",
            "os.open",
            "pathlib.Path.open",
            "pathlib.Path.read_text",
            "pathlib.Path.iterdir",
            "socket.socket",
            "socket.create_connection",
            "subprocess.Popen",
            "threading.Thread.start",
            "cv2.VideoCapture",
            "cv2.imread",
        ):
            patch.setattr(place, refuse)
        yield
