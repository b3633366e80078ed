"""Compiling a fusion method's kernels beside the scan that will need them, when they were never compiled here.

The first run after an installation compiles every kernel once; the results are cached on disk. The kernels of the
fusion are needed last, so a second process compiles them meanwhile, on a small plate.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

import surfuse
from surfuse.commands.fuse.methods import create_method
from surfuse.geometry.poses import pose
from surfuse.records import FusionScene, MapGrid, Outline, Readings, SensorSpec, Status
from surfuse.settings import FusionSettings

_STANDOFF_M = 0.43
_STOPS = 12


def start_warm_up(method: str) -> subprocess.Popen[bytes] | None:
    """Start compiling in a process of its own if nothing of the fusion was ever compiled; None if it was."""
    package = Path(surfuse.__file__).parent
    if any((package / "confidence" / "__pycache__").glob("*.nbi")):
        return None
    with suppress(OSError):
        # A failure costs only the time that it would have saved.
        return subprocess.Popen(
            [sys.executable, "-m", "surfuse.commands.acquire.warm_up", method],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
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
    method.step(state, readings.sweep(0))
    method.replay(scene, readings, grid)
    create_method(FusionSettings(), "weighted_average").replay(scene, readings, grid)


if __name__ == "__main__":
    compile_fusion(sys.argv[1])
