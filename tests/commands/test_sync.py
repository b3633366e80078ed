from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from surfuse.commands.calibrate.sync import sync
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import DataError

LAG_S = -0.080
"""Ranges that come 80 ms late: they belong to poses of earlier."""


def moving_log(
    path: Path, lag_s: float = LAG_S, noise_m: float = 0.003, still: bool = False, n: int = 800, wild: float = 0.0
) -> Path:
    """A sensor that swings in front of a plane at x = 1 while it comes and goes; poses at 50 Hz."""
    rng = np.random.default_rng(4)
    t = np.arange(n) * 0.02

    def pose_at(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        time = 0.0 * time if still else time
        place = np.column_stack([0.2 * np.sin(1.3 * time), 0.3 * np.sin(0.7 * time), 0.5 + 0.1 * np.sin(1.9 * time)])
        yaw, pitch = 0.25 * np.sin(2.1 * time), 0.15 * np.cos(1.7 * time)
        axis = np.column_stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        return place, axis

    place, axis = pose_at(t + lag_s)
    ranges = (1.0 - place[:, 0]) / axis[:, 0] + rng.normal(size=n) * noise_m
    bad = rng.random(n) < wild
    ranges[bad] += rng.uniform(0.2, 1.0, int(bad.sum()))
    place, axis = pose_at(t)
    lines = ["t,sensor,px,py,pz,ax,ay,az,range_m"]
    for k in range(n):
        numbers = ",".join(repr(float(x)) for x in (*place[k], *axis[k], ranges[k]))
        lines.append(f"{float(t[k])!r},tof,{numbers}")
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def test_a_known_lag_comes_back_within_its_interval(tmp_path: Path) -> None:
    told = sync(moving_log(tmp_path / "log.csv"), None, 300.0, SilentWatcher()).summary
    low, high = told["interval_95_ms"]
    assert low < 1e3 * LAG_S < high
    assert high - low < 6.0
    assert told["lag_ms"] == pytest.approx(1e3 * LAG_S, abs=3.0)
    assert told["residual_after_mm"] == pytest.approx(3.0, rel=0.15)
    assert told["residual_before_mm"] > 3.0 * told["residual_after_mm"]


def test_one_plane_explains_a_plane(tmp_path: Path) -> None:
    """More planes always fit the noise a little better: they must pay for their number."""
    told = sync(moving_log(tmp_path / "log.csv"), None, 300.0, SilentWatcher()).summary
    assert told["surface"] == "a plane"


def test_wild_readings_do_not_move_the_lag(tmp_path: Path) -> None:
    told = sync(moving_log(tmp_path / "log.csv", wild=0.15), None, 300.0, SilentWatcher()).summary
    assert told["lag_ms"] == pytest.approx(1e3 * LAG_S, abs=5.0)


def test_a_given_mesh_serves_as_surface(tmp_path: Path) -> None:
    wall = np.array([[1.0, -3.0, -3.0], [1.0, 3.0, -3.0], [1.0, 3.0, 3.0], [1.0, -3.0, 3.0]])
    trimesh.Trimesh(wall, [[0, 1, 2], [0, 2, 3]], process=False).export(tmp_path / "wall.ply")
    told = sync(moving_log(tmp_path / "log.csv"), tmp_path / "wall.ply", 300.0, SilentWatcher()).summary
    assert told["surface"] == "the given mesh"
    assert told["lag_ms"] == pytest.approx(1e3 * LAG_S, abs=2.0)


def test_no_lag_is_found_as_none(tmp_path: Path) -> None:
    told = sync(moving_log(tmp_path / "log.csv", lag_s=0.0), None, 300.0, SilentWatcher()).summary
    low, high = told["interval_95_ms"]
    assert low < 0.0 < high


def test_logs_that_cannot_tell_are_refused(tmp_path: Path, plate: Callable[..., Path]) -> None:
    with pytest.raises(DataError, match="stand still"):
        sync(moving_log(tmp_path / "still.csv", still=True), None, 300.0, SilentWatcher())
    with pytest.raises(DataError, match="end of the search"):
        sync(moving_log(tmp_path / "far.csv", lag_s=-0.2), None, 60.0, SilentWatcher())
    with pytest.raises(DataError, match="at least 30"):
        sync(moving_log(tmp_path / "short.csv", n=40), None, 300.0, SilentWatcher())
    # Last, for it writes its sensors.toml beside the others.
    with pytest.raises(DataError, match="stood still for every sweep"):
        sync(plate(), None, 300.0, SilentWatcher())
