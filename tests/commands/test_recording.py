"""`surfuse record`: an arm that somebody else moves over a known plane, behind a bridge with a time of its own."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from surfuse import settings
from surfuse.acquisition.tool_track import HIDDEN_M_S2, ToolTrack
from surfuse.commands.acquire.acquisition import resume
from surfuse.commands.acquire.recording import record_run
from surfuse.commands.explain.map_source import source_of
from surfuse.commands.fuse.fuse_log import fuse
from surfuse.commands.outcome import SilentWatcher
from surfuse.commands.show.map_so_far import MapSoFar
from surfuse.errors import ConfigError, DataError, DeviceError, UsageError
from surfuse.exporters import nc
from surfuse.geometry.poses import pose, transform_points
from surfuse.records import ToolState
from surfuse.runs.log_reader import read_log
from surfuse.runs.scan_source import load_scan

BRIDGE = Path(__file__).parent / "moving_bridge.py"
SLOPE = 0.4
SENSOR = """
[[sensor]]
name = "{name}"
driver = "bridge"
kind = "laser"
position_m = [{x_m}, 0.0, 0.0]
beam_full_angle_deg = 1.0
range_min_m = 0.05
range_max_m = 1.2
sigma_m = 0.0005
lag_s = {lag_s}
"""
AREA = """
[area]
origin_m = [-0.05, -0.03, 0.0]
width_m = 0.10
height_m = 0.06
"""


def cell(folder, *words, more="", late_s=0.03):
    command = json.dumps([sys.executable, str(BRIDGE), *map(str, words)])
    sensors = SENSOR.format(name="us0", x_m=-0.02, lag_s=0.0) + SENSOR.format(name="us1", x_m=0.02, lag_s=late_s)
    file = folder / "rig.toml"
    file.write_text(f'[arm]\ndriver = "bridge"\ncommand = {command}\n{sensors}{more}', "utf-8")
    return file


class Until(SilentWatcher):
    """Wants a stop after so many sweeps, or questions whether to stop."""

    def __init__(self, sweeps, questions=10_000):
        self.sweeps, self.questions, self.notes = sweeps, questions, []

    def advance(self, steps=1):
        self.sweeps -= steps

    def warn(self, text):
        self.notes.append(text)

    def stop_requested(self):
        self.questions -= 1
        return self.sweeps <= 0 or self.questions < 0


def off_plane_m(surface):
    u, v = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    there = transform_points(surface.grid.world_from_part, np.stack([u, v, surface.height_m], axis=-1))[surface.mask]
    return (there[:, 2] - SLOPE * there[:, 0]) / math.hypot(1.0, SLOPE)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    outcome = record_run(settings.load(cell(folder)), folder / "run", Until(150))
    return folder / "run", outcome


def test_the_map_of_a_moving_arm_is_right_to_a_millimetre(recorded):
    run, outcome = recorded
    surface = nc.read(run / "surface.nc")
    assert outcome.complete
    assert outcome.summary["stops"] == 150
    assert outcome.summary["left_out"] == 0
    assert surface.mask.sum() > 80
    assert np.abs(off_plane_m(surface)).max() < 5e-4


def test_readings_lie_where_the_moving_sensors_were(recorded):
    readings = load_scan(recorded[0]).readings
    feet = readings.position_m + readings.range_m[:, None] * readings.axis
    assert_allclose(feet[:, 2], SLOPE * feet[:, 0], atol=2e-4)
    # It accelerates all the time: less sure than a standing one, by less than a tenth of a millimetre here.
    assert np.all((readings.sigma_m > 5e-4) & (readings.sigma_m < 6e-4))


def test_a_lag_that_is_not_told_shows(tmp_path):
    record_run(settings.load(cell(tmp_path, late_s=0.0)), tmp_path / "run", Until(60))
    readings = load_scan(tmp_path / "run").readings
    feet = readings.position_m + readings.range_m[:, None] * readings.axis
    assert np.abs(feet[:, 2] - SLOPE * feet[:, 0]).max() > 1e-3


def test_a_recorded_run_opens_as_any_other(recorded, tmp_path):
    run, _ = recorded
    fuse(run, tmp_path / "again", SilentWatcher())
    first, again = nc.read(run / "surface.nc"), nc.read(tmp_path / "again" / "surface.nc")
    assert_array_equal(first.height_m, again.height_m)
    assert_array_equal(first.grid.world_from_part, again.grid.world_from_part)
    source = source_of(run)
    assert source.readings.n_sweeps == 150
    assert len(np.unique(source.readings.row)) > 1
    assert "<title>Surface of &#x27;run&#x27;" in (run / "report.html").read_text("utf-8")
    with pytest.raises(DataError, match=r"is a recording .* cannot be resumed; make its map with"):
        resume(run, SilentWatcher())


def test_the_area_gives_the_part_frame_and_the_step(tmp_path):
    more = AREA + "\n[scan]\nstep_m = 0.02\n"
    outcome = record_run(settings.load(cell(tmp_path, more=more)), tmp_path / "run", Until(100))
    surface = nc.read(tmp_path / "run" / "surface.nc")
    assert outcome.summary["frame_estimated"] is False
    assert_allclose(surface.grid.world_from_part, pose(np.eye(3), (-0.05, -0.03, 0.0)))
    assert_allclose(np.diff(surface.grid.u_m), 0.02)
    assert np.abs(off_plane_m(surface)).max() < 1e-3


def test_an_arm_that_surfuse_could_move_may_be_guided(tmp_path):
    outcome = record_run(settings.load(cell(tmp_path, "guided")), tmp_path / "run", Until(30))
    assert outcome.summary["stops"] == 30


def test_sweeps_whose_place_nobody_knows_are_left_out_and_told(tmp_path):
    watcher = Until(60, questions=60)
    with pytest.raises(DataError, match=r"no sweep was recorded \(60 left out\)"):
        record_run(settings.load(cell(tmp_path, "shakes")), tmp_path / "run", watcher)
    (note,) = watcher.notes
    assert "60 of 60 sweeps are left out" in note
    assert "at most 10 mm" in note


def test_a_bridge_that_dies_leaves_everything_on_disk(tmp_path):
    with pytest.raises(DeviceError, match="surfuse fuse") as told:
        record_run(settings.load(cell(tmp_path, "dies", 80)), tmp_path / "run", Until(1000))
    assert told.value.exit_status == 4
    assert "or start another recording" in str(told.value)
    assert "resume" not in str(told.value)
    log = read_log(tmp_path / "run")
    # One question a sweep and one a state, after the greeting and the clock.
    assert len(log.sweeps) >= 30
    assert [event.source for event in log.events] == ["record", "clock", "device"]
    fuse(tmp_path / "run", tmp_path / "map", SilentWatcher())
    assert np.abs(off_plane_m(nc.read(tmp_path / "map" / "surface.nc"))).max() < 1e-3


def test_only_a_real_rig_is_recorded(tmp_path):
    with pytest.raises(ConfigError, match="simulated cell"):
        record_run(settings.load(), tmp_path / "run", SilentWatcher())
    assert not (tmp_path / "run").exists()


class Looker:
    """Keeps what an observer is told."""

    def __init__(self):
        self.scans, self.swept_after, self.maps = [], [], []

    def planned(self, scan):
        self.scans.append(scan)

    def swept(self, sweep):
        self.swept_after.append(sweep)

    def finished(self, surface):
        self.maps.append(surface)


@pytest.mark.parametrize("area", ["", AREA + "[scan]\nstep_m = 0.01\n"])
def test_who_looks_on_sees_the_map_grow_to_the_one_on_disk(tmp_path, area):
    looker = Looker()
    record_run(settings.load(cell(tmp_path, more=area)), tmp_path / "run", Until(100), observer=looker)
    (scan,), (final,) = looker.scans, looker.maps
    assert scan.by_hand
    assert len(scan.done) == (1 if area else 30)
    assert len(scan.done) + len(looker.swept_after) == 100
    assert_array_equal(final.height_m, nc.read(tmp_path / "run" / "surface.nc").height_m)
    so_far, cells = MapSoFar(scan), []
    for sweep in (*scan.done, *looker.swept_after):
        so_far.take(sweep)
        if (surface := so_far.surface(preview=False)) is not None:
            cells.append(int(surface.mask.sum()))
    assert cells[-1] > cells[0]
    assert 0.5 < cells[-1] / int(final.mask.sum()) < 2.0
    assert np.median(np.abs(off_plane_m(surface))) < 1e-3


def test_how_well_the_clocks_agree_is_in_log_summary_table_and_report(recorded):
    run, outcome = recorded
    events = [event.text for event in read_log(run).events if event.source == "clock"]
    assert len(events) == 2
    assert all("all stamps are the bridge's; this computer's and the bridge's agree to" in text for text in events)
    assert outcome.summary["clock"]["keeps_pace"] is False  # 50 ms a question, whatever a question takes
    assert "do not keep pace" in dict(outcome.table)["clock"]
    assert "agree to" in (run / "report.html").read_text("utf-8")


@pytest.mark.parametrize("minutes", [math.inf, math.nan, 0.0, -1.0, 2e5])
def test_minutes_that_are_no_time_are_refused(tmp_path, minutes):
    with pytest.raises(UsageError, match=r"--minutes .* must be above 0 and at most 100000"):
        record_run(settings.load(cell(tmp_path)), tmp_path / "run", SilentWatcher(), minutes)
    assert not (tmp_path / "run").exists()


def test_the_terminal_is_told_rate_cells_and_sigma(tmp_path):
    tallies = []
    record_run(settings.load(cell(tmp_path)), tmp_path / "run", Until(60), show=tallies.append)
    assert re.fullmatch(r"record, \d+ sweeps/s, \d+ cells \(\d+ cm2\), sigma 0\.5\d? mm", tallies[-1].in_words())
    assert tallies[-1].covered.cells > 5


def begun(folder, *words):
    """The command in a process of its own, once it has some sweeps on disk."""
    command = [sys.executable, "-m", "surfuse", "record", "--cell", str(cell(folder, "waits", 0.01)), "--out"]
    process = subprocess.Popen(
        [*command, str(folder / "run"), *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    while process.poll() is None and not enough(folder / "run"):
        time.sleep(0.1)
    return process


def enough(run):
    logs = list((run / "log").glob("*.mcap")) if (run / "log").is_dir() else []
    return bool(logs) and len(read_log(run).sweeps) > 40


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_recording_that_is_killed_is_fused_later(tmp_path):
    process = begun(tmp_path)
    process.kill()
    process.communicate()
    assert not (tmp_path / "run" / "surface.nc").exists()
    outcome = fuse(tmp_path / "run", tmp_path / "map", SilentWatcher())
    assert outcome.summary["stops"] > 40
    assert np.abs(off_plane_m(nc.read(tmp_path / "map" / "surface.nc"))).max() < 1e-3


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_ends_a_recording_with_its_map(tmp_path):
    process = begun(tmp_path, "--json")
    process.send_signal(signal.SIGINT)
    printed, complaints = process.communicate()
    assert process.returncode == 0, complaints
    found = json.loads(printed)
    assert found["stops"] > 40
    assert Path(found["map"]).is_file()
    assert Path(found["report"]).is_file()


def moving(t_s, acceleration_m_s2=0.0, turn_rad_s=0.0):
    """Along x from rest or at 0.2 m/s, turning about y."""
    x = 0.2 * t_s + 0.5 * acceleration_m_s2 * t_s**2
    return ToolState(t_s, pose(Rotation.from_euler("y", turn_rad_s * t_s).as_matrix(), (x, 0.0, 0.5)))


def tracked(times_s, **motion):
    track = ToolTrack()
    for t_s in times_s:
        track.add(moving(t_s, **motion))
    return track


def test_between_states_the_way_is_straight_and_the_turn_even():
    track = tracked([0.0, 0.1, 0.2], turn_rad_s=0.7)
    found = track.at([0.1, 0.13, 0.2], [0.0] * 3)
    for t_s, place in zip([0.1, 0.13, 0.2], found.world_from_grip, strict=True):
        assert_allclose(place, moving(t_s, turn_rad_s=0.7).world_from_tool, atol=1e-12)


@pytest.mark.parametrize("acceleration_m_s2", [0.0, 0.5, 3.0])
def test_what_the_place_may_be_off_holds_the_acceleration(acceleration_m_s2):
    track = tracked([0.0, 0.1, 0.2], acceleration_m_s2=acceleration_m_s2)
    (off,) = track.at([0.15], [0.0]).off_m
    truth = moving(0.15, acceleration_m_s2=acceleration_m_s2).world_from_tool
    assert_allclose(off, max(acceleration_m_s2, HIDDEN_M_S2) * 0.1**2 / 8.0, rtol=1e-9)
    assert np.linalg.norm(track.at([0.15], [0.0]).world_from_grip[0] - truth) <= off + 1e-12
    assert track.at([0.1, 0.2], [0.0, 0.0]).off_m == pytest.approx(0.0)


def test_a_standing_arm_is_known_exactly_and_states_told_twice_count_once():
    track = ToolTrack()
    for t_s in (0.0, 1.0, 1.0, 5.0):
        track.add(ToolState(t_s, pose(np.eye(3), (0.1, 0.2, 0.3))))
    assert track.since_s == 0.0  # it stood from its first state on
    assert track.until_s == 5.0
    assert track.at([3.0], [0.4]).off_m == 0.0
