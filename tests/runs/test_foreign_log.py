"""Logs of other rigs: made with another library, read through their transforms; what is missing is said."""

from __future__ import annotations

import re

import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.geometry.poses import inverse, pose, rotation_about
from surfuse.runs.log_writer import LogWriter
from surfuse.runs.ros_messages import beam_rotation, quaternion
from surfuse.runs.scan_source import load_scan
from surfuse.runs.transform_tree import TransformTree

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")
STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
T = STORE.types


def header(t_ns: int, frame: str):
    stamp = T["builtin_interfaces/msg/Time"](sec=t_ns // 10**9, nanosec=t_ns % 10**9)
    return T["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def transform(t_ns, parent, child, matrix):
    x, y, z, w = quaternion(matrix[:3, :3])
    return T["geometry_msgs/msg/TransformStamped"](
        header=header(t_ns, parent),
        child_frame_id=child,
        transform=T["geometry_msgs/msg/Transform"](
            translation=T["geometry_msgs/msg/Vector3"](*matrix[:3, 3].tolist()),
            rotation=T["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
        ),
    )


def range_of(t_ns, frame, value, variance=1e-6, store=STORE):
    fields = {"variance": variance} if store is STORE else {}
    return store.types["sensor_msgs/msg/Range"](
        header=header(t_ns, frame),
        radiation_type=0,
        field_of_view=0.3,
        min_range=0.2,
        max_range=1.2,
        range=value,
        **fields,
    )


def bag(path, messages, store=STORE):
    """A bag by rosbags; messages are (topic, type, time in ns, message)."""
    with rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        connections = {}
        for topic, kind, t_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], t_ns, store.serialize_cdr(message, kind))
    return path


RANGE, TF = "sensor_msgs/msg/Range", "tf2_msgs/msg/TFMessage"
TOOL_FROM_SENSOR = [
    pose(rotation_about([0, 1, 0], np.pi / 2), [0.05 * (i % 2), 0.05 * (i // 2), 0.02]) for i in range(4)
]


def tool_at(t_s: float) -> np.ndarray:
    return pose(rotation_about([1, 0, 0], np.pi) @ rotation_about([0, 0, 1], 0.1 * t_s), [0.2 * t_s, 0.1, 0.45])


def rig(path, moves_hz=20.0, store=STORE, frame_prefix="", first_range_s=0.2):
    """An arm that moves on an arc of position and angle, four sensors fixed on its tool, no stops."""
    messages = []
    static = [transform(0, "tool", f"{frame_prefix}s{i}", TOOL_FROM_SENSOR[i]) for i in range(4)]
    static.append(transform(0, "map", "base", np.eye(4)))
    messages.append(("/tf_static", TF, 10**9, T[TF](transforms=static)))
    for k in range(int(4 * moves_hz) + 1):
        t_ns = 10**9 + round(k / moves_hz * 1e9)
        messages.append(("/tf", TF, t_ns, T[TF](transforms=[transform(t_ns, "base", "tool", tool_at(k / moves_hz))])))
    for k in range(30):
        for i in range(4):
            t_s = first_range_s + 0.1 * k + 0.02 * i
            value = [np.inf, -np.inf, np.nan, 0.43][(k + i) % 4]
            t_ns = 10**9 + round(t_s * 1e9)
            messages.append((f"/sonar{i}", RANGE, t_ns, range_of(t_ns, f"{frame_prefix}s{i}", value, store=store)))
    return bag(path, messages, store)


def test_ranges_are_placed_through_interpolated_transforms(tmp_path):
    rig(tmp_path / "bag")
    scan = load_scan(tmp_path / "bag")
    readings = scan.readings
    assert len(readings.t_s) == 120
    assert readings.n_sweeps == 30
    for n in range(120):
        i = int(readings.sensor[n])
        t_s = float(readings.t_s[n]) - 1.0
        # Between two transforms the position moves on a straight line, so the truth differs by the arc's height.
        expected = tool_at(t_s) @ TOOL_FROM_SENSOR[i]
        assert np.allclose(readings.position_m[n], expected[:3, 3], atol=2e-6)
        assert np.allclose(readings.axis[n], expected[:3, 0], atol=1e-6)
    assert np.sum(readings.range_m == np.inf) == 30
    assert np.sum(np.isnan(readings.range_m)) == 30
    spec = readings.specs[0]
    assert (spec.name, spec.kind) == ("s0", "ultrasonic")
    assert spec.sigma_m == pytest.approx(1e-3)
    assert spec.range_max_m == pytest.approx(1.2)
    assert np.allclose(readings.sigma_m, 1e-3)
    assert scan.frame_estimated


def test_a_bare_mcap_reads_as_its_bag_folder(tmp_path):
    rig(tmp_path / "bag")
    (segment,) = (tmp_path / "bag").glob("*.mcap")
    assert np.array_equal(load_scan(segment).readings.position_m, load_scan(tmp_path / "bag").readings.position_m)


def test_humble_ranges_have_no_variance_and_that_is_told(tmp_path):
    humble = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    scan = load_scan(rig(tmp_path / "bag", store=humble))
    assert len(scan.readings.t_s) == 120
    assert np.all(np.isnan(scan.readings.sigma_m))
    assert any("no variance" in warning for warning in scan.warnings)


def test_ranges_outside_the_time_of_tf_are_left_out_and_told(tmp_path):
    scan = load_scan(rig(tmp_path / "bag", first_range_s=-0.15))
    assert len(scan.readings.t_s) == 120 - 7
    assert any("7 ranges lie outside" in warning for warning in scan.warnings)


def test_a_log_without_ranges_says_what_it_has_and_what_is_needed(tmp_path):
    text = T["std_msgs/msg/String"](data="hello")
    path = bag(tmp_path / "bag", [("/chatter", "std_msgs/msg/String", 1, text)])
    with pytest.raises(DataError, match=r"no sensor_msgs/msg/Range; found: /chatter \(std_msgs/msg/String\).*needed"):
        load_scan(path)


def test_ranges_without_transforms_name_the_frame(tmp_path):
    path = bag(tmp_path / "bag", [("/r", RANGE, 10**9, range_of(10**9, "sonar_link", 0.4))])
    with pytest.raises(DataError, match=r"sonar_link.*frames in the log: none.*tf2_msgs"):
        load_scan(path)


def test_millimetres_in_a_range_message_are_refused(tmp_path):
    messages = [
        ("/tf_static", TF, 10**9, T[TF](transforms=[transform(0, "base", "s", np.eye(4))])),
        ("/r", RANGE, 10**9, range_of(10**9, "s", 430.0)),
    ]
    with pytest.raises(DataError, match="millimetres"):
        load_scan(bag(tmp_path / "bag", messages))


def test_a_truncated_foreign_log_gives_what_is_whole(tmp_path):
    rig(tmp_path / "bag")
    (segment,) = (tmp_path / "bag").glob("*.mcap")
    whole = segment.read_bytes()
    for share in (0.1, 0.5, 0.9, 0.99):
        segment.write_bytes(whole[: int(share * len(whole))])
        if share < 0.6:
            with pytest.raises(DataError, match=re.escape(str(segment))):
                load_scan(segment)
        else:
            assert load_scan(segment).warnings


def test_our_own_log_read_as_a_foreign_one_gives_the_same_scan(tmp_path, scans, monkeypatch):
    with LogWriter(tmp_path / "log") as log:
        log.append_scene(scans.scene())
        for stop in range(8):
            log.append_sweep(scans.sweep(stop))
    own = load_scan(tmp_path / "log").readings
    monkeypatch.setattr("surfuse.runs.scan_source.is_own_log", lambda path: False)
    foreign = load_scan(tmp_path / "log").readings
    assert np.allclose(foreign.t_s, own.t_s, atol=1e-8)
    assert np.allclose(foreign.position_m, own.position_m, atol=1e-12)
    assert np.allclose(foreign.axis, own.axis, atol=1e-12)
    assert np.array_equal(np.float32(own.range_m), np.float32(foreign.range_m), equal_nan=True)
    names = [foreign.specs[i].name for i in foreign.sensor]
    assert names == [own.specs[i].name for i in own.sensor]


def test_transforms_compose_and_interpolate_along_the_great_arc():
    tree = TransformTree()
    a, b = pose(np.eye(3), [0, 0, 0]), pose(rotation_about([0, 0, 1], 2.0), [1, 0, 0])
    for t_ns, matrix in ((0, a), (1000, b)):
        tree.add("world", "arm", t_ns, (*matrix[:3, 3], *quaternion(matrix[:3, :3])), static=False)
    fixed = pose(rotation_about([1, 1, 0], 0.4), [0, 0, 0.1])
    tree.add("arm", "sensor", 0, (*fixed[:3, 3], *quaternion(fixed[:3, :3])), static=True)
    found, known = tree.poses("sensor", np.array([0, 250, 1000, 1001]))
    assert known.tolist() == [True, True, True, False]
    assert np.allclose(found[1], pose(rotation_about([0, 0, 1], 0.5), [0.25, 0, 0]) @ fixed, atol=1e-12)
    assert np.allclose(found[2], b @ fixed, atol=1e-12)


def test_rings_and_double_parents_are_refused():
    tree = TransformTree()
    identity = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    tree.add("a", "b", 0, identity, static=True)
    tree.add("b", "a", 0, identity, static=True)
    with pytest.raises(DataError, match="ring"):
        tree.root("a")
    with pytest.raises(DataError, match="hangs on"):
        tree.add("c", "b", 0, identity, static=True)
    with pytest.raises(DataError, match="transform"):
        tree.add("a", "d", 0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), static=True)


def test_quaternions_and_beam_frames_are_right():
    rng = np.random.default_rng(3)
    for _ in range(200):
        rotation = rotation_about(rng.normal(size=3), rng.uniform(-np.pi, np.pi))
        x, y, z, w = quaternion(rotation)
        tree = TransformTree()
        tree.add("a", "b", 0, (0.0, 0.0, 0.0, x, y, z, w), static=True)
        assert w >= 0.0
        assert np.allclose(tree.poses("b", np.array([0]))[0][0, :3, :3], rotation, atol=1e-12)
    for axis in [*rng.normal(size=(50, 3)), [0, 0, 1], [0, 0, -1], [1, 0, 0]]:
        unit = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
        frame = pose(beam_rotation(unit), [0, 0, 0])
        assert np.allclose(frame[:3, 0], unit)
        assert np.allclose(inverse(frame) @ frame, np.eye(4), atol=1e-12)
        assert np.linalg.det(frame[:3, :3]) == pytest.approx(1.0)
