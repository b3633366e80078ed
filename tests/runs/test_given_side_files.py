"""Side files that are given for a log which says everything itself: they count, or are refused."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from surfuse.geometry.poses import inverse, pose, rotation_about, transform_points
from surfuse.records import Outline, Status
from surfuse.runs.given_side_files import moved_outline
from surfuse.runs.scan_source import LogSource, load_scan, source_of_table
from surfuse.runs.side_files import frame_toml, outline_csv, sensors_toml

PAPER = ("--method", "weighted_average")


def frame_file(folder, world_from_part):
    (folder / "frame.toml").write_text(frame_toml(world_from_part))
    return folder / "frame.toml"


@pytest.mark.parametrize("option", ["--sensors", "--frame", "--outline"])
def test_a_side_file_that_is_not_there_is_an_error_for_a_run_too(command, flat_run, tmp_path, option):
    command("fuse", flat_run, option, tmp_path / "none", "--out", tmp_path / "run").error(3, "none", "no such file")
    assert not (tmp_path / "run").exists()


def test_the_sensors_of_a_run_are_corrected_by_name(flat_run, tmp_path):
    scan = load_scan(flat_run)
    text = sensors_toml((replace(scan.readings.specs[2], sigma_m=0.0123),))
    (tmp_path / "sensors.toml").write_text(text + "offset_m = 0.004\nscale = 1.01\n")
    found = load_scan(flat_run, tmp_path / "sensors.toml")
    assert [spec.name for spec in found.readings.specs] == [spec.name for spec in scan.readings.specs]
    assert found.readings.specs[2].sigma_m == 0.0123
    assert found.readings.specs[:2] == scan.readings.specs[:2]
    heard = scan.readings.status == int(Status.OK)
    mine = heard & (scan.readings.sensor == 2)
    wanted = (scan.readings.range_m[mine] - 0.004) / 1.01
    assert found.readings.range_m[mine] == pytest.approx(wanted, abs=1e-12)
    others = scan.readings.sensor != 2
    assert np.array_equal(found.readings.range_m[others], scan.readings.range_m[others], equal_nan=True)
    assert any("sensors.toml corrects 1 of 4" in note for note in found.warnings)


def test_a_sensor_that_the_log_does_not_have_is_refused(command, flat_run, tmp_path):
    text = sensors_toml(load_scan(flat_run).readings.specs).replace('"us2"', '"us9"')
    (tmp_path / "sensors.toml").write_text(text)
    answer = command("fuse", flat_run, "--sensors", tmp_path / "sensors.toml", "--out", tmp_path / "run")
    answer.error(3, "no sensor 'us9'", "did you mean")


def test_another_frame_moves_the_map_and_its_outline(flat_run, tmp_path):
    scan = load_scan(flat_run)
    moved = scan.world_from_part @ pose(rotation_about([0, 0, 1], 0.1), [0.02, 0.03, 0.0])
    found = load_scan(flat_run, frame=frame_file(tmp_path, moved))
    assert found.world_from_part == pytest.approx(moved, abs=1e-12)
    assert found.targets_uv_m is None
    assert not found.frame_estimated
    places = [
        transform_points(
            one.world_from_part, np.column_stack([one.outline.vertices_m, np.zeros(len(one.outline.vertices_m))])
        )
        for one in (scan, found)
    ]
    assert places[1] == pytest.approx(places[0], abs=1e-9)


def test_an_outline_given_for_a_run_is_the_one_that_counts(flat_run, tmp_path):
    scan = load_scan(flat_run)
    small = Outline(0.5 * scan.outline.vertices_m, scan.world_from_part)
    (tmp_path / "outline.csv").write_text(outline_csv(small))
    found = load_scan(flat_run, outline=tmp_path / "outline.csv")
    assert np.ptp(found.outline.vertices_m, axis=0) == pytest.approx(0.5 * np.ptp(scan.outline.vertices_m, axis=0))


def test_the_side_files_of_a_fused_run_are_used_whenever_its_log_is_read_again(command, flat_run, tmp_path):
    scan = load_scan(flat_run)
    moved = scan.world_from_part @ pose(np.eye(3), [0.1, 0.0, 0.0])
    run = tmp_path / "run"
    frame = frame_file(tmp_path, moved)
    assert command("fuse", flat_run, "--frame", frame, "--out", run, "--quiet", *PAPER).status == 0
    source = source_of_table({"log": str(flat_run.resolve()), "frame": str(frame.resolve())})
    assert f'frame = "{frame.resolve()}"' in (run / "run.toml").read_text()
    assert source.load().world_from_part == pytest.approx(moved)
    told = command("why", run, "-100", "100", "--json").json
    assert told["recomputed_mm"] == pytest.approx(told["height_mm"], abs=1e-6)


def test_a_source_reads_back_from_its_table(tmp_path):
    source = LogSource(tmp_path / "a", sensors=tmp_path / "s", outline=tmp_path / "o")
    assert source_of_table(json.loads(json.dumps(source.table()))) == source
    assert source_of_table({"sensors": "x"}) is None
    assert source_of_table(None) is None


SEEN = Outline([[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.0, 0.1]], np.eye(4), viewpoint_m=np.array([0.1, 0.05, 1.0]))


def test_an_outline_seen_by_a_camera_is_seen_from_the_same_place_on_a_turned_plane():
    turned = pose(rotation_about([0, 1, 0], 0.3), [0.0, 0.0, 0.05])
    found = moved_outline(SEEN, turned)
    corners = transform_points(turned, np.column_stack([found.vertices_m, np.zeros(4)]))
    for corner, seen in zip(corners, SEEN.vertices_m, strict=True):
        way, wanted = corner - SEEN.viewpoint_m, np.append(seen, 0.0) - SEEN.viewpoint_m
        assert np.linalg.norm(np.cross(way, wanted)) < 1e-12
    assert found.viewpoint_m == pytest.approx(transform_points(inverse(turned), SEEN.viewpoint_m[None])[0])


@pytest.mark.parametrize("frame", [pose(np.eye(3), [0.0, 0.0, 2.0]), pose(rotation_about([0, 1, 0], np.pi), [0, 0, 0])])
def test_an_outline_that_cannot_be_seen_from_there_is_none(frame):
    assert moved_outline(SEEN, frame) is None


def test_an_outline_without_a_viewpoint_stays_on_parallel_planes():
    flat = Outline(SEEN.vertices_m, np.eye(4))
    assert moved_outline(flat, pose(np.eye(3), [0.1, 0.0, 0.3])).vertices_m[0] == pytest.approx([-0.1, 0.0])
    assert moved_outline(flat, pose(rotation_about([0, 1, 0], 0.01), [0, 0, 0])) is None
