"""`surfuse acquire --smooth` as a user runs it: quick, logged, replayed, interrupted, refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.outcome import SilentWatcher
from surfuse.exporters import nc
from surfuse.runs.log_reader import read_log
from surfuse.settings import load

HOW = ["scene.name=flat", "scan.mode=smooth", "scan.step_m=0.03", 'fusion.method="weighted_average"']


class Impatient(SilentWatcher):
    """Asks to stop after so many sweeps."""

    def __init__(self, after: int) -> None:
        self.after, self.sweeps, self.scanning = after, 0, False

    def stage(self, name: str, total: int = 1) -> None:
        self.scanning = name == "scan"

    def advance(self, steps: int = 1) -> None:
        self.sweeps += steps if self.scanning else 0

    def stop_requested(self) -> bool:
        return self.sweeps >= self.after


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("smooth") / "run"
    assert acquire(load(None, HOW), run, SilentWatcher()).complete
    return run


def test_a_smooth_pass_is_several_times_quicker_and_as_good(whole: Path, tmp_path: Path) -> None:
    stops = load(None, [*HOW, "scan.mode=stops"])
    assert acquire(stops, tmp_path / "stops", SilentWatcher()).complete
    quick, slow = (json.loads((run / "summary.json").read_text()) for run in (whole, tmp_path / "stops"))
    assert quick["stops"] == slow["stops"]
    # The search takes as long as before, and so coarse a scan has few stops.
    assert quick["robot_time_s"] < 0.6 * slow["robot_time_s"]
    assert quick["rmse_mm"] < slow["rmse_mm"] + 0.15


def test_the_log_has_the_encoders_all_the_way_and_a_pose_for_every_reading(whole: Path) -> None:
    rosbags = pytest.importorskip("rosbags.highlevel")
    sweeps = read_log(whole).sweeps
    with rosbags.AnyReader([whole / "log"]) as reader:
        topics = [c for c in reader.connections if c.topic == "/joint_states"]
        stamps = [
            message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            for connection, _, raw in reader.messages(topics)
            for message in [reader.deserialize(raw, connection.msgtype)]
        ]
    stamps = np.unique(stamps)
    for sweep in sweeps:
        k = np.searchsorted(stamps, sweep.t_s)
        assert np.all(stamps[np.minimum(k, len(stamps) - 1)] - stamps[k - 1] < 0.0045)
    middle = sweeps[len(sweeps) // 2]
    moved = middle.position_m - middle.world_from_grip[:3, 3]
    assert np.ptp(np.linalg.norm(moved, axis=1)) > 1e-3


def test_the_log_fused_again_gives_the_same_map(whole: Path, tmp_path: Path, command, map_bits) -> None:
    answer = command("fuse", whole, "--method", "weighted_average", "--out", tmp_path / "again", "--json")
    assert answer.status == 0, answer.err
    assert map_bits(tmp_path / "again") == map_bits(whole)


def test_an_interrupted_pass_goes_on_from_its_line_with_the_same_map(whole: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert not acquire(load(None, HOW), run, Impatient(after=12)).complete
    done = len(read_log(run).sweeps)
    assert 12 <= done < 25
    assert resume(run, SilentWatcher()).complete
    one, other = nc.read(whole / "surface.nc"), nc.read(run / "surface.nc")
    assert np.array_equal(one.mask, other.mask)
    assert np.abs(one.height_m - other.height_m)[one.mask].max() < 1e-6


def test_a_pass_that_would_be_too_fast_is_refused_before_the_arm_moves_along_it(tmp_path: Path, command) -> None:
    how = ("--set", "scan.speed_m_s=0.2", "--set", "arm.tool_speed_max_m_s=0.1", "--set", "scan.step_m=0.04")
    answer = command("acquire", "flat", "--smooth", "--arm-driver", "kinematic", *how, "--out", tmp_path / "run")
    answer.error(5, "the tool would move at 0.2", "its limit is 0.10 m/s", "scan.speed_m_s")


def test_a_node_that_cannot_follow_is_refused(command) -> None:
    answer = command("acquire", "flat", "--smooth", "--node", "udp")
    answer.error(3, "scan.mode = 'smooth'", "bus.interface = 'virtual'")
