"""A readings CSV of a plate seen by four parallel rangers, with side files and truth beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FusionScene, Outline, Readings, SensorSpec
from surfuse.runs.readings_csv import write_readings_csv

CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]]) * 0.025
STANDOFF_M = 0.43


def spec(name: str) -> SensorSpec:
    return SensorSpec(name, "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 0.0005)


def write_plate(folder: Path, tilt_deg: float = 0.0, noise_m: float = 0.0005, seed: int = 0) -> Path:
    """Ranges along the axes onto a plate turned about v; a few of them missing, one wild; side files and truth."""
    rng = np.random.default_rng(seed)
    slope = float(np.tan(np.radians(tilt_deg)))
    u, v = np.meshgrid(np.arange(-6, 7) * 0.01, np.arange(9) * 0.01)
    m = u.size
    grip = np.tile(pose(rotation_about([1, 0, 0], np.pi), [0, 0, STANDOFF_M]), (m, 1, 1))
    grip[:, 0, 3], grip[:, 1, 3] = u.ravel(), v.ravel()
    position = (grip[:, None, :3, 3] + CORNERS).reshape(-1, 3)
    ranges = STANDOFF_M - slope * position[:, 0] + rng.normal(size=4 * m) * noise_m
    ranges[5::97] = np.inf
    ranges[7] = 0.05
    ranges[200] += 0.04
    readings = Readings(
        specs=tuple(spec(f"us{k}") for k in range(4)),
        t_s=np.arange(4 * m) * 0.05,
        sensor=np.tile(np.arange(4), m),
        position_m=position,
        axis=np.tile([0.0, 0.0, -1.0], (4 * m, 1)),
        range_m=ranges,
        status=np.where(np.isinf(ranges), 1, 0),
        amplitude=np.full(4 * m, np.nan),
        sigma_m=np.full(4 * m, np.nan),
        count=np.ones(4 * m),
        start=np.arange(m + 1) * 4,
        stop=np.arange(m),
        row=np.repeat(np.arange(9), 13),
        world_from_grip=grip,
    )
    box = np.array([[-0.07, -0.01], [0.07, -0.01], [0.07, 0.09], [-0.07, 0.09]])
    scene = FusionScene(readings.specs, np.eye(4), Outline(box, np.eye(4)))
    write_readings_csv(folder / "readings.csv", readings, scene)
    corners = np.column_stack([box, slope * box[:, 0]])
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False).export(folder / "truth.ply")
    return folder / "readings.csv"


@pytest.fixture
def plate(tmp_path: Path) -> Callable[..., Path]:
    """Write such a log into the folder of the test: `plate(tilt_deg=10.0)`."""

    def write(**how: float) -> Path:
        return write_plate(tmp_path, **how)

    return write
