"""The log of a run: every record comes back bit by bit, and other people's readers open it."""

from __future__ import annotations

import json
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from surfuse.errors import DataError, StorageError
from surfuse.records import CameraFrame, CameraModel, FusionScene, Outline, ScanPlan, SensorSpec, Sweep
from surfuse.runs import log_writer
from surfuse.runs import own_messages as own
from surfuse.runs.log_reader import is_own_log, read_log
from surfuse.runs.log_records import Damage, Level, LogEvent
from surfuse.runs.log_writer import LogWriter
from surfuse.runs.progress import read_progress
from surfuse.runs.scan_source import load_scan


def write(folder, scans, stops, with_plan=True):
    with LogWriter(folder) as log:
        log.append_event(LogEvent(0.1, Level.INFO, "search", "joint 1 turns"))
        log.append_frame(scans.frame())
        log.append_scene(scans.scene())
        if with_plan:
            log.append_plan(scans.plan())
        for stop in stops:
            log.append_sweep(scans.sweep(stop))
        log.append_event(LogEvent(1 / 3, Level.WARN, "scan", "Störung: 3 µs\nsecond line"))


def test_every_record_reads_back_bit_by_bit(tmp_path, scans):
    write(tmp_path / "log", scans, range(6))
    for path in (tmp_path, tmp_path / "log", tmp_path / "log" / "000.mcap"):
        log = read_log(path)
        assert log.damage == ()
        assert scans.same(log.sweeps, tuple(scans.sweep(stop) for stop in range(6)))
        assert scans.same(log.scene, scans.scene())
        assert scans.same(log.plan, scans.plan())
        assert scans.same(log.frames, (scans.frame(),))
        assert [event.text for event in log.events] == ["joint 1 turns", "Störung: 3 µs\nsecond line"]
        assert log.events[1].t_s == 1 / 3
        assert log.events[1].level is Level.WARN


def test_the_log_has_a_place_for_every_field_of_the_records(scans):
    """A record that grows must not lose its new field on disk."""
    outline_names = {"hole_size", "hole_vertices_m"}
    assert set(own.sweep_message(scans.sweep(0))) == {field.name for field in fields(Sweep)}
    assert set(own.outline_message(scans.outline())) - outline_names == {f.name for f in fields(Outline)} - {"holes_m"}
    sensor = own.scene_message(scans.scene())["sensors"][0]
    assert set(sensor) == {field.name for field in fields(SensorSpec)}
    skipped = {"skipped_uv_m", "skipped_reason", "joints"}
    assert set(own.plan_message(scans.plan())) - skipped == {f.name for f in fields(ScanPlan)} - {"skipped"}
    scene = {"format_version", "sensors"}
    assert set(own.scene_message(scans.scene())) - scene == {f.name for f in fields(FusionScene)} - {"specs"}
    view = set(own.view_message(scans.frame())) | {"image", "camera"}
    assert view == {f.name for f in (*fields(CameraFrame), *fields(CameraModel))}


def test_readings_of_the_log_are_those_of_its_sweeps(tmp_path, scans):
    write(tmp_path / "log", scans, range(20))
    readings = read_log(tmp_path).readings()
    for stop in range(20):
        back = readings.sweep(stop)
        for name in ("t_s", "sensor", "position_m", "axis", "range_m", "status", "amplitude", "sigma_m", "count"):
            assert scans.same(getattr(back, name), getattr(scans.sweep(stop), name)), name


def test_a_long_scan_is_split_into_segments_that_each_hold_the_scene(tmp_path, scans, monkeypatch):
    monkeypatch.setattr(log_writer, "SWEEPS_PER_SEGMENT", 5)
    write(tmp_path / "log", scans, range(12))
    names = sorted(path.name for path in (tmp_path / "log").iterdir())
    assert names == ["000.mcap", "001.mcap", "002.mcap", "metadata.yaml"]
    assert scans.same(read_log(tmp_path).sweeps, tuple(scans.sweep(stop) for stop in range(12)))
    alone = read_log(tmp_path / "log" / "002.mcap")
    assert scans.same(alone.scene, scans.scene())
    assert [sweep.stop for sweep in alone.sweeps] == [10, 11]


def test_resume_appends_a_new_segment_and_the_last_take_of_a_stop_counts(tmp_path, scans):
    write(tmp_path / "log", scans, range(3))
    with LogWriter(tmp_path / "log") as log:
        log.append_scene(scans.scene())
        for stop in (4, 2, 3):
            log.append_sweep(scans.sweep(stop, seed=1))
    sweeps = read_log(tmp_path).sweeps
    assert [sweep.stop for sweep in sweeps] == [0, 1, 2, 3, 4]
    assert scans.same(sweeps[2], scans.sweep(2, seed=1))
    assert scans.same(sweeps[1], scans.sweep(1))
    assert (tmp_path / "log" / "001.mcap").exists()


def test_an_unfinished_segment_is_sealed_when_the_run_is_resumed(tmp_path, scans):
    write(tmp_path / "log", scans, range(6))
    path = tmp_path / "log" / "000.mcap"
    whole = path.read_bytes()
    cut = len(whole) - 7000
    path.write_bytes(whole[:cut])
    before = read_log(tmp_path)
    assert before.damage[-1].kind in (Damage.UNFINISHED, Damage.CUT_OFF)
    with LogWriter(tmp_path / "log"):
        pass
    after = read_log(tmp_path)
    assert after.damage == ()
    assert scans.same(after.sweeps, before.sweeps)
    assert scans.same(after.plan, before.plan)
    with path.open("rb") as stream:
        topics = {channel.topic for _, channel, _ in make_reader(stream, validate_crcs=True).iter_messages()}
    assert "/surfuse/sweep" in topics


def test_mcap_ros2_support_reads_the_ranges_with_inf_and_nan(tmp_path, scans):
    write(tmp_path / "log", scans, range(30))
    expected = [
        (scans.SPECS[int(i)].name, np.float32(r))
        for stop in range(30)
        for i, r in zip(scans.sweep(stop).sensor, scans.sweep(stop).range_m, strict=True)
    ]
    with (tmp_path / "log" / "000.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = [
            (item.decoded_message.header.frame_id, np.float32(item.decoded_message.range))
            for item in reader.iter_decoded_messages()
            if item.schema.name == "sensor_msgs/msg/Range"
        ]
    assert len(found) == len(expected)
    for (name, r), (frame, got) in zip(expected, found, strict=True):
        assert name == frame
        assert np.array_equal(r, got, equal_nan=True)
    assert {np.inf, -np.inf} <= {float(r) for _, r in found}


def test_rosbags_opens_the_log_folder_as_a_bag(tmp_path, scans, monkeypatch):
    highlevel = pytest.importorskip("rosbags.highlevel")
    monkeypatch.setattr(log_writer, "SWEEPS_PER_SEGMENT", 4)
    write(tmp_path / "log", scans, range(10))
    with LogWriter(tmp_path / "log") as log:
        log.append_scene(scans.scene())
        log.append_sweep(scans.sweep(10))
    with highlevel.AnyReader([tmp_path / "log"]) as bag:
        messages = [(c.topic, c.msgtype, bag.deserialize(raw, c.msgtype)) for c, _, raw in bag.messages()]
    ranges = [m for _, kind, m in messages if kind == "sensor_msgs/msg/Range"]
    assert len(ranges) == sum(len(scans.sweep(stop).sensor) for stop in range(11))
    assert {np.inf, -np.inf} <= {m.range for m in ranges}
    assert any(np.isnan(m.range) for m in ranges)
    image = next(m for topic, _, m in messages if topic == "/camera/image")
    assert np.array_equal(image.data.reshape(58, 50), scans.frame().image)
    joints = [m for topic, _, m in messages if topic == "/joint_states"]
    assert np.array_equal(joints[3].position, scans.sweep(3).joints_rad)
    info = next(m for topic, _, m in messages if topic == "/camera/camera_info")
    assert np.array_equal(info.k.reshape(3, 3), scans.frame().camera.matrix)
    log_line = next(m for topic, _, m in messages if topic == "/events")
    assert (log_line.level, log_line.msg) == (20, "joint 1 turns")
    topics = {topic for topic, kind, _ in messages if kind == "sensor_msgs/msg/Range"}
    # "us 1" and "us-1" would share one topic: they get their numbers.
    assert topics == {"/range/us0", "/range/us_1_1", "/range/us_1_2", "/range/links_oben"}


def test_tf_places_each_sensor_with_its_beam_along_x(tmp_path, scans):
    write(tmp_path / "log", scans, [0, 1])
    with (tmp_path / "log" / "000.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [item.decoded_message for item in reader.iter_decoded_messages(topics=["/tf"])]
    sweep = scans.sweep(0)
    grip, *sensors = next(m.transforms for m in messages if m.transforms[0].child_frame_id == "grip")
    assert (grip.header.frame_id, grip.child_frame_id) == ("world", "grip")
    for i, item in enumerate(sensors):
        q, p = item.transform.rotation, item.transform.translation
        x_axis = [1 - 2 * (q.y**2 + q.z**2), 2 * (q.x * q.y + q.z * q.w), 2 * (q.x * q.z - q.y * q.w)]
        assert np.allclose(x_axis, sweep.axis[i], atol=1e-12)
        assert np.allclose([p.x, p.y, p.z], sweep.position_m[i], atol=0)
        assert item.child_frame_id == scans.SPECS[int(sweep.sensor[i])].name


def test_a_sweep_needs_its_scene(tmp_path, scans):
    with LogWriter(tmp_path / "log") as log, pytest.raises(DataError, match="scene"):
        log.append_sweep(scans.sweep(0))


def test_a_log_of_a_newer_format_is_refused(tmp_path, scans, monkeypatch):
    monkeypatch.setattr("surfuse.runs.own_messages.FORMAT_VERSION", 99)
    write(tmp_path / "log", scans, [0])
    monkeypatch.undo()
    with pytest.raises(DataError, match=r"version 99.*up to 1"):
        read_log(tmp_path)


def test_progress_names_the_stops_that_are_left(tmp_path, scans):
    (tmp_path / "log").mkdir()
    assert read_progress(tmp_path) is None
    write(tmp_path / "log", scans, [0, 1, 3])
    progress = read_progress(tmp_path)
    assert progress.left == (2, 4, 5)
    assert not progress.complete
    assert scans.same(progress.plan, scans.plan())
    assert [sweep.stop for sweep in progress.done] == [0, 1, 3]


def test_progress_before_the_plan_starts_afresh_and_without_plan_but_sweeps_is_an_error(tmp_path, scans):
    write(tmp_path / "a" / "log", scans, [], with_plan=False)
    assert read_progress(tmp_path / "a") is None
    write(tmp_path / "b" / "log", scans, [0], with_plan=False)
    with pytest.raises(DataError, match="plan is missing"):
        read_progress(tmp_path / "b")


def test_load_scan_takes_run_folder_log_folder_and_segment(tmp_path, scans):
    run = tmp_path / "Läufe mit Leerzeichen"
    write(run / "log", scans, range(4))
    for path in (run, run / "log", run / "log" / "000.mcap"):
        assert is_own_log(path)
        scan = load_scan(path)
        assert scan.readings.n_sweeps == 4
        assert scans.same(scan.scene(), scans.scene())
        assert scan.warnings == ()


def test_a_nearest_range_inside_the_tube_is_read_as_the_tube_s_end(scans):
    """Version 0.1.0 wrote what the blanking left, wherever that lay."""
    message = own.scene_message(scans.scene())
    message["sensors"][2] |= {"range_min_m": 0.0, "dead_length_m": 0.2}
    decoded = json.loads(json.dumps(message), object_hook=lambda fields: SimpleNamespace(**fields))
    specs = own.scene_record(decoded).specs
    assert (specs[2].range_min_m, specs[2].dead_length_m) == (0.2, 0.2)
    assert [specs[i] for i in (0, 1, 3)] == [scans.SPECS[i] for i in (0, 1, 3)]


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"hello", bytes(2000), b"\x89MCAP0\r\n" + bytes(500)])
def test_a_file_that_is_no_log_is_refused(tmp_path, content):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"x\.mcap: nothing in it can be read as an MCAP log; give a run folder"):
        load_scan(path)


def test_other_things_than_logs_are_refused_by_name(tmp_path):
    (tmp_path / "x.bag").write_bytes(b"#ROSBAG V2.0\n")
    (tmp_path / "empty").mkdir()
    for path, words in (("x.bag", "no kind of log"), ("empty", "no log segment"), ("gone", "no such file")):
        with pytest.raises(DataError, match=words):
            load_scan(tmp_path / path)


def test_a_log_folder_that_is_a_file_is_a_storage_error(tmp_path):
    (tmp_path / "log").write_text("a file")
    with pytest.raises(StorageError), LogWriter(tmp_path / "log"):
        pass
