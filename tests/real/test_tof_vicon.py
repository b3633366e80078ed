"""Real time-of-flight frames with motion-capture poses, read in place; skipped where the recordings are not there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.calibrate.sync import sync
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import DataError
from surfuse.runs.scan_source import load_scan
from surfuse.runs.tof_vicon import read_tof_vicon, rotations, zone_directions

RECORDINGS = Path(__file__).parents[3] / "shared" / "data" / "real" / "vl53l5cx_vicon"
real = pytest.mark.skipif(not (RECORDINGS / "A0").is_dir(), reason="the recordings are not on this machine")


@real
@pytest.mark.parametrize("name", ["A0", "R0"])
def test_the_recording_becomes_64_sensors(name: str) -> None:
    scan = load_scan(RECORDINGS / name)
    readings = scan.readings
    assert len(readings.specs) == 64
    assert len(readings.t_s) == 64 * readings.n_sweeps > 10_000
    assert np.all(np.diff(readings.t_s[::64]) > 0.0)
    assert np.linalg.norm(readings.axis, axis=1) == pytest.approx(1.0)
    assert 0.2 < np.mean(readings.status == 0) < 0.6


@real
@pytest.mark.parametrize("name", ["A0", "R0"])
def test_the_ranges_come_late_and_fit_the_target_better_at_their_own_time(name: str) -> None:
    told = sync(RECORDINGS / name, None, 300.0, SilentWatcher()).summary
    low, high = told["interval_95_ms"]
    assert low < high < 0.0
    assert -130.0 < told["lag_ms"] < -40.0
    assert told["residual_after_mm"] < 0.9 * told["residual_before_mm"]
    plane = told["target_plane"]["after"]
    assert plane["angle_deg"] < 3.0
    assert abs(plane["distance_mm"]) < 25.0
    facing = told["by_incidence"]["after"][0]
    assert abs(facing["median_mm"]) < 15.0
    assert facing["scatter_mm"] < 25.0


def write_recording(folder: Path, lag_ms: float = -60.0, frames: int = 200) -> Path:
    """The same files made up: a carrier that swings in front of a target at x = 1, 5 mm of noise."""
    rng = np.random.default_rng(2)
    t = np.arange(frames * 4) * 17.0

    def pose_at(t_ms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s = 1e-3 * t_ms
        yaw = 0.3 * np.sin(2.0 * s)
        place = np.column_stack([0.15 * np.sin(1.3 * s), 0.05 * np.sin(0.9 * s), 0.5 + 0.05 * np.sin(0.7 * s)])
        return place, np.column_stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)])

    place, turned = pose_at(t)
    poses = ["name,timeStamp,posx,posy,posz,qw,qx,qy,qz"]
    for k in range(len(t)):
        poses.append("Drone," + ",".join(repr(float(x)) for x in (t[k], *place[k], *turned[k])))
        poses.append(f"Surface,{t[k]},1.0,0.0,0.5,1.0,0.0,0.0,0.0")
    heard = t[::4]
    place, turned = pose_at(heard + lag_ms)
    towards = np.einsum("fij,zj->fzi", rotations(turned), zone_directions())
    distance = 1e3 * (1.0 - place[:, :1]) / towards[..., 0] + rng.normal(size=(frames, 64)) * 5.0
    rows = []
    for k in range(frames):
        rows.append(f"{heard[k]},0,0")
        rows += [f"{mm:.0f},1,{5 if z % 9 else 255}" for z, mm in enumerate(distance[k])]
    (folder / "state_ToF.csv").write_text("\n".join(rows) + "\n", "utf-8")
    (folder / "state_Vicon.csv").write_text("\n".join(poses) + "\n", "utf-8")
    return folder


def test_a_made_up_recording_gives_back_its_lag(tmp_path: Path) -> None:
    told = sync(write_recording(tmp_path), None, 300.0, SilentWatcher()).summary
    low, high = told["interval_95_ms"]
    assert low - 3.0 < -60.0 < high + 3.0
    assert high - low < 20.0
    assert told["lag_ms"] == pytest.approx(-60.0, abs=5.0)
    assert told["residual_after_mm"] < 8.0
    before, after = told["target_plane"]["before"], told["target_plane"]["after"]
    assert after["angle_deg"] < 0.3
    assert after["distance_mm"] == pytest.approx(0.0, abs=2.0)
    assert before["angle_deg"] > after["angle_deg"]
    assert told["residual_after_mm"] < 0.8 * told["residual_before_mm"]


def test_zones_without_one_valid_target_are_no_echoes(tmp_path: Path) -> None:
    recording = read_tof_vicon(write_recording(tmp_path))
    readings = recording.scan.readings
    silent = np.arange(64) % 9 == 0
    assert np.all(np.isposinf(readings.range_m.reshape(-1, 64)[:, silent]))
    assert np.all(np.isfinite(readings.range_m.reshape(-1, 64)[:, ~silent]))
    assert recording.normal == pytest.approx([-1.0, 0.0, 0.0])


def test_broken_recordings_are_refused(tmp_path: Path) -> None:
    write_recording(tmp_path)
    frames = (tmp_path / "state_ToF.csv").read_text("utf-8")
    (tmp_path / "state_ToF.csv").write_text(frames + "1,2,3\n", "utf-8")
    with pytest.raises(DataError, match="no whole number of frames"):
        read_tof_vicon(tmp_path)
    (tmp_path / "state_ToF.csv").write_text(frames.replace(",255", ",x", 1), "utf-8")
    with pytest.raises(DataError, match="not a table of numbers"):
        read_tof_vicon(tmp_path)
    (tmp_path / "state_ToF.csv").write_text(frames, "utf-8")
    poses = (tmp_path / "state_Vicon.csv").read_text("utf-8")
    (tmp_path / "state_Vicon.csv").write_text(poses.replace("Surface", "Wall"), "utf-8")
    with pytest.raises(DataError, match="no poses of 'Surface'"):
        read_tof_vicon(tmp_path)
