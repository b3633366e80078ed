"""Compiling kernels beside the acquisition that will need them, when they were never compiled here.

The first run after an installation compiles every kernel once; the results are cached on disk. The acquisition begins
with the kernels of the arm and compiles on as it goes; a second process begins with those that are needed last, of the
outline and of the fusion, on a small contour and a small plate.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import llvmlite
import llvmlite.binding
import numba
import numpy as np

import surfuse
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.outcome import Watcher
from surfuse.geometry.kernel_folder import PACKAGE, kernel_folder
from surfuse.geometry.kernel_sources import sources_key
from surfuse.geometry.poses import pose
from surfuse.interfaces import LiveMapping
from surfuse.records import FusionScene, MapGrid, Outline, Readings, SensorSpec, Status
from surfuse.settings import FusionSettings
from surfuse.vision.dominant_points import dominant_points

STAGE = "compile, once"
_STANDOFF_M = 0.43
_STOPS = 12
_PROGRAM = f"""
import sys
sys.path.append(sys.argv[1])
from {__name__} import compile_last
compile_last(sys.argv[2])
"""


def start_warm_up(method: str) -> subprocess.Popen[bytes] | None:
    """Start compiling in a process of its own, unless all of it was compiled before.

    The process looks for modules where this one found them, never in the current folder.
    """
    folder, stamp = kernel_folder(), _stamp(method)
    if folder is None or stamp is None or stamp.is_file() or not sys.executable:
        return None
    safe = "-I" if sys.flags.isolated else "-P"
    with suppress(OSError):
        # A failure costs only the time that it would have saved.
        return subprocess.Popen(
            [sys.executable, safe, "-c", _PROGRAM, str(PACKAGE.parent), method],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=folder.environment(),
        )
    return None


@contextmanager
def warm_up_beside(method: str) -> Iterator[subprocess.Popen[bytes] | None]:
    """The second process while the block runs, to be waited for; it never outlives the block."""
    process = start_warm_up(method)
    try:
        yield process
    finally:
        if process is not None:
            process.terminate()
            process.wait()


def wait_for(process: subprocess.Popen[bytes] | None, watcher: Watcher) -> None:
    """Wait until the second process has compiled all that it was started for, or the user asks for a stop."""
    if process is not None and process.poll() is None:
        watcher.stage(STAGE)
        while process.poll() is None and not watcher.stop_requested():
            time.sleep(0.05)


def compiled_before(method: str) -> bool:
    """Whether all that a method needs, its preview too, lies compiled on disk."""
    stamp = _stamp(method)
    return stamp is not None and stamp.is_file()


def compile_last(method: str) -> None:
    """Compile what an acquisition needs last, and leave a stamp that says so."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    wavy = 50.0 + 8.0 * np.cos(3.0 * angle)
    dominant_points(np.column_stack([wavy * np.cos(angle), wavy * np.sin(angle)]))
    compile_fusion(method)
    if (stamp := _stamp(method)) is not None:
        with suppress(OSError):
            stamp.touch()


def _stamp(method: str) -> Path | None:
    """The file that says that a method was compiled, by this version and these libraries, for this processor."""
    folder = kernel_folder()
    if folder is None:
        return None
    cpu = (llvmlite.binding.get_host_cpu_name(), llvmlite.binding.get_host_cpu_features().flatten())
    made = (surfuse.__version__, sys.version, llvmlite.__version__, numba.__version__, *cpu)
    key = hashlib.sha256(repr(made).encode()).hexdigest()[:12]
    return folder.path / f"compiled-{method}-{sources_key(Path(__file__), __name__)}-{key}"


def small_scan() -> tuple[FusionScene, Readings, MapGrid]:
    """A facing plate with a step, scanned by four sensors 5 cm apart every centimetre."""
    specs = tuple(
        SensorSpec(f"us{k}", "ultrasonic", 0.2, 1.2, 0.23, 3e-4, frequency_hz=63e3, aperture_m=0.04) for k in range(4)
    )
    nodes = np.arange(_STOPS, dtype=np.float64) * 0.01
    u, v = (axis.ravel() for axis in np.meshgrid(nodes, nodes))
    down = np.diag([1.0, -1.0, -1.0])
    grips = np.array([pose(down, [x, y, _STANDOFF_M]) for x, y in zip(u, v, strict=True)])
    offset = 0.025 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    position = (grips[:, None, :3, 3] + offset).reshape(-1, 3)
    n = len(position)
    ranges = _STANDOFF_M - 0.03 * (position[:, 1] < nodes.mean())
    readings = Readings(
        specs=specs,
        t_s=np.arange(n, dtype=np.float64) * 0.05,
        sensor=np.tile(np.arange(4), len(grips)),
        position_m=position,
        axis=np.tile([0.0, 0.0, -1.0], (n, 1)),
        range_m=ranges,
        status=np.full(n, int(Status.OK)),
        amplitude=np.ones(n),
        start=4 * np.arange(len(grips) + 1),
        stop=np.arange(len(grips)),
        row=np.repeat(np.arange(_STOPS), _STOPS),
        world_from_grip=grips,
    )
    low, high = -0.005, float(nodes[-1]) + 0.005
    outline = Outline(np.array([[low, low], [high, low], [high, high], [low, high]]), np.eye(4))
    return FusionScene(specs, np.eye(4), outline), readings, MapGrid(nodes, nodes, np.eye(4))


def compile_fusion(name: str) -> None:
    """Fuse the small scan with the method of that name, and with the paper's, which the report shows."""
    scene, readings, grid = small_scan()
    method = create_method(FusionSettings(), name)
    state = method.start(scene)
    for sweep in range(2 * _STOPS):
        method.step(state, readings.sweep(sweep))
    if isinstance(method, LiveMapping):
        method.preview(state, grid)
    method.replay(scene, readings, grid)
    create_method(FusionSettings(), "weighted_average").replay(scene, readings, grid)
