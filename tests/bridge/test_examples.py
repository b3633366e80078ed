"""The bridges of `examples/bridges`: each against a stand-in with its library's or its machine's own interface."""

import contextlib
import json
import os
import runpy
import socket
import subprocess
import sys
import time
import types
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from surfuse.bridge.child import ChildTransport
from surfuse.bridge.client import BridgeClient
from surfuse.bridge.consistency import Tolerances
from surfuse.bridge.messages import MoveTo
from surfuse.bridge.patience import Patience
from surfuse.bridge.transport import TcpTransport
from surfuse.errors import DeviceError, SafetyStopError, UnreachableError
from surfuse.geometry.poses import pose

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples" / "bridges"
DOWN = np.diag([1.0, -1.0, -1.0])
TILTED = Rotation.from_euler("xyz", [2.8, 0.3, -1.9]).as_matrix()
TURNS = [DOWN, np.eye(3), TILTED, *Rotation.random(6, rng=4).as_matrix()]
TIGHT = Tolerances()
LOOSE = Tolerances(angle_tolerance_rad=0.05)


class Stage:
    """Runs a bridge with the stand-ins in place of the makers' packages, and reads what they were told."""

    def __init__(self, folder, monkeypatch):
        self._journal, self._monkeypatch = folder / "journal", monkeypatch
        self._journal.touch()
        monkeypatch.setenv("STAND_IN_JOURNAL", str(self._journal))
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, (HERE / "stand_ins", HERE.parent / "stand_ins"))))

    def fault(self, name):
        self._monkeypatch.setenv("STAND_IN_FAULTS", name)

    def client(self, program, *words, tolerances=TIGHT):
        command = [sys.executable, str(EXAMPLES / program), *words]
        return BridgeClient(ChildTransport(command), Patience(start_timeout_s=30.0), tolerances)

    def told(self, call):
        notes = [json.loads(line) for line in self._journal.read_text("utf-8").splitlines()]
        return [note[1:] for note in notes if note[0] == call]


@pytest.fixture
def stage(tmp_path, monkeypatch):
    return Stage(tmp_path, monkeypatch)


def go(client, world_from_tool, share=1.0):
    return client.move(MoveTo(world_from_tool=world_from_tool, speed_share=share))


def stopped_on_the_way(client, target, share, wait_s=0.3):
    """Send a long move without waiting for its answer, and stop it; where the arm stood then."""
    client._line._transport.send(_move_line(target, share), time.monotonic() + 1.0)
    time.sleep(wait_s)
    return client.stop()


def _move_line(target, share):
    ask = {"id": 0, "do": "move", "world_from_tool": target.ravel().tolist(), "speed_share": share}
    return json.dumps(ask).encode() + b"\n"


@contextlib.contextmanager
def minimal_on(way):
    program = [sys.executable, str(EXAMPLES / "minimal.py")]
    if way == "pipes":
        with BridgeClient(ChildTransport(program)) as client:
            yield client
        return
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with subprocess.Popen([*program, str(port)]) as process:
        with BridgeClient(TcpTransport(f"tcp://127.0.0.1:{port}"), Patience(give_up_s=20.0)) as client:
            yield client
        process.wait(10.0)


@pytest.mark.parametrize("way", ["pipes", "tcp"])
def test_the_minimal_bridge_measures_its_plane(way):
    with minimal_on(way) as client:
        assert client.hello.sensors == ("us0",)
        for x_m in (-0.3, 0.0, 0.25):
            reached = go(client, pose(DOWN, (x_m, 0.1, 0.45)))
            (reading,) = client.observe().sweep.readings
            point = reached.world_from_tool[:3, 3] + reading.range_m * reached.world_from_tool[:3, 2]
            assert_allclose(point[2], 0.1 * point[0], atol=1e-12)
        with pytest.raises(UnreachableError, match="2 m wide"):
            go(client, pose(DOWN, (1.5, 0.0, 0.5)))


def test_the_minimal_bridge_is_about_forty_lines():
    assert len((EXAMPLES / "minimal.py").read_text("utf-8").splitlines()) <= 45


@pytest.mark.parametrize("turn", TURNS)
def test_rotations_of_the_examples_are_those_of_scipy(turn):
    rotations = types.SimpleNamespace(**runpy.run_path(str(EXAMPLES / "rotations.py")))
    numbers = pose(turn, (0.1, 0.2, 0.3)).ravel().tolist()
    mine, theirs = np.array(rotations.quaternion(numbers)), Rotation.from_matrix(turn).as_quat()
    assert_allclose(mine * np.sign(mine @ theirs), theirs, atol=1e-12)
    assert_allclose(Rotation.from_rotvec(rotations.rotation_vector(numbers)).as_matrix(), turn, atol=1e-12)
    back = rotations.pose_of_vector([0.1, 0.2, 0.3], Rotation.from_matrix(turn).as_rotvec())
    assert_allclose(np.reshape(back, (4, 4)), pose(turn, (0.1, 0.2, 0.3)), atol=1e-12)


def test_a_universal_robots_arm_is_told_metres_and_rotation_vectors(stage):
    with stage.client("ur_arm.py", "192.168.1.10") as client:
        for i, turn in enumerate(TURNS):
            target = pose(turn, (0.35, 0.02 * i, 0.3))
            assert_allclose(go(client, target).world_from_tool, target, atol=1e-9)
            tcp, speed, _ = stage.told("moveL")[-1]
            assert_allclose(tcp[:3], target[:3, 3])
            assert_allclose(Rotation.from_rotvec(tcp[3:]).as_matrix(), turn, atol=1e-9)
            assert speed == 0.25
        poses = np.array([pose(DOWN, where) for where in ((0.4, 0, 0.3), (0.4, 0, -0.1), (2, 0, 0.3))])
        assert client.reach(poses).tolist() == [True, False, False]
        with pytest.raises(UnreachableError):
            go(client, poses[2])
        assert client.state().t_s > 0.0
    assert stage.told("connect") == [["192.168.1.10"]]
    assert stage.told("stopScript") == [[]]


def test_a_universal_robots_arm_stops_on_its_way_and_for_safety(stage):
    with stage.client("ur_arm.py", "192.168.1.10") as client:
        where = stopped_on_the_way(client, pose(DOWN, (0.4, 0.5, 0.4)), 0.01).world_from_tool
        assert 0.0 < where[1, 3] < 0.45
    stage.fault("protective stop")
    with stage.client("ur_arm.py", "192.168.1.10") as client, pytest.raises(SafetyStopError, match="has stopped"):
        go(client, pose(DOWN, (0.4, 0.1, 0.4)))


def test_an_xarm_is_told_millimetres_and_roll_pitch_yaw(stage):
    with stage.client("ufactory_xarm.py", "192.168.1.203") as client:
        assert client.tally.garbled_answers == 0  # the package prints its version
        for i, turn in enumerate([*TURNS, Rotation.from_euler("xyz", [0.4, np.pi / 2, 0.7]).as_matrix()]):
            target = pose(turn, (0.35, 0.02 * i, 0.3))
            assert_allclose(go(client, target, 0.5).world_from_tool, target, atol=1e-9)
            told, speed = stage.told("set_position")[-1]
            assert_allclose(told[:3], 1e3 * target[:3, 3])
            assert_allclose(Rotation.from_euler("xyz", told[3:]).as_matrix(), turn, atol=1e-9)
            assert speed == 50.0
        assert client.reach(np.array([pose(DOWN, (0.4, 0, 0.3)), pose(DOWN, (0.9, 0, 0))])).tolist() == [True, False]
        with pytest.raises(UnreachableError, match="no joints"):
            go(client, pose(DOWN, (0.9, 0, 0)))
        where = stopped_on_the_way(client, pose(DOWN, (0.35, -0.3, 0.3)), 0.02).world_from_tool
        assert -0.25 < where[1, 3] < 0.18
        assert_allclose(go(client, pose(DOWN, (0.4, 0, 0.3))).world_from_tool[:3, 3], (0.4, 0, 0.3))
    assert stage.told("disconnect") == [[]]


def test_a_collision_of_an_xarm_is_a_safety_stop(stage):
    stage.fault("collision")
    with stage.client("ufactory_xarm.py", "a") as client, pytest.raises(SafetyStopError, match="code 1, error 31"):
        go(client, pose(DOWN, (0.4, 0, 0.3)))


def test_an_so101_is_told_degrees_in_small_steps(stage):
    with stage.client("so101_lerobot.py", "/dev/ttyACM0", "lab", tolerances=LOOSE) as client:
        target = np.radians([20.0, -10.0, 5.0, 30.0, -2.0])
        reached = client.move(MoveTo(joints_rad=target))
        assert_allclose(reached.joints_rad, target, atol=np.radians(0.8))
        assert_allclose(np.degrees(reached.joints_rad[1]), -10.7)  # as it is, not as it was told
        actions = [list(action.values()) for (action,) in stage.told("send_action")]
        assert list(stage.told("send_action")[-1][0]) == [
            *("shoulder_pan.pos", "shoulder_lift.pos", "elbow_flex.pos", "wrist_flex.pos", "wrist_roll.pos")
        ]
        assert_allclose(actions[-1], np.degrees(target), atol=1e-9)
        assert np.max(np.abs(np.diff(actions, axis=0))) <= 40.0 * 0.02 + 1e-9
    assert stage.told("connect") == [["/dev/ttyACM0", "lab"]]
    assert stage.told("disconnect") == [[]]


def test_an_so101_that_does_not_arrive_says_so(stage):
    stage.fault("droop")
    with (
        stage.client("so101_lerobot.py", "p", "i", tolerances=LOOSE) as client,
        pytest.raises(DeviceError, match="the joints are at"),
    ):
        client.move(MoveTo(joints_rad=np.zeros(5)))


@contextlib.contextmanager
def moveit_bridge():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with subprocess.Popen([sys.executable, str(EXAMPLES / "ros2_moveit.py"), str(port)]) as process:
        with BridgeClient(TcpTransport(f"tcp://127.0.0.1:{port}"), Patience(give_up_s=30.0)) as client:
            yield client
        process.wait(10.0)


def test_a_moveit_robot_is_told_messages_with_quaternions(stage):
    with moveit_bridge() as client:
        for i, turn in enumerate(TURNS):
            target = pose(turn, (0.35, 0.02 * i, 0.3))
            assert_allclose(go(client, target, 0.2).world_from_tool, target, atol=1e-9)
            told, scale = stage.told("plan")[-1]
            assert_allclose(np.reshape(told, (4, 4)), target, atol=1e-9)
            assert scale == 0.2
        assert client.reach(np.array([pose(DOWN, (0.4, 0, 0.3)), pose(DOWN, (1, 0, 0))])).tolist() == [True, False]
        with pytest.raises(UnreachableError, match="no joints"):
            go(client, pose(DOWN, (1.0, 0.0, 0.3)))
        with pytest.raises(UnreachableError, match="no way"):
            go(client, pose(DOWN, (0.1, 0.6, 0.3)))
    assert stage.told("rclpy.shutdown") == [[]]


def test_a_moveit_robot_stops_on_its_way(stage):
    stage.fault("slow")
    with moveit_bridge() as client:
        assert_allclose(stopped_on_the_way(client, pose(DOWN, (0.4, 0.2, 0.4)), 0.2).world_from_tool[1, 3], 0.0)
    assert stage.told("stop_execution")  # a stop whose answer is late is asked for again


def test_a_controller_that_fails_under_moveit_is_a_device_error(stage):
    stage.fault("controller")
    with moveit_bridge() as client, pytest.raises(DeviceError, match="TIMED_OUT"):
        go(client, pose(DOWN, (0.4, 0.2, 0.4)))


pseudo_terminal = pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")


def boards():
    sys.path.insert(0, str(HERE.parent / "stand_ins"))
    from gcode_boards import Grbl, Marlin

    return {"marlin": Marlin, "grbl": Grbl}


@pseudo_terminal
@pytest.mark.parametrize("dialect", ["marlin", "grbl"])
def test_a_gantry_goes_where_it_is_sent(stage, dialect):
    with boards()[dialect]() as board, stage.client("gcode_gantry.py", board.port, dialect, "0.2") as client:
        for where in ((0.1, 0.05, 0.2), (0.1234, 0.05, 0.2), (0.0, 0.0, 0.0)):
            assert_allclose(go(client, pose(DOWN, where)).world_from_tool, pose(DOWN, where), atol=1e-5)
        command = "G1 X123.400 Y50.000 Z200.000 F3000"
        assert ("G53 " if dialect == "grbl" else "") + command in board.told
        with pytest.raises(UnreachableError, match="cannot turn"):
            go(client, pose(TILTED, (0.1, 0.1, 0.1)))
        where = stopped_on_the_way(client, pose(DOWN, (0.2, 0.0, 0.0)), 0.02).world_from_tool
        assert 0.0 < where[0, 3] < 0.19
        assert_allclose(go(client, pose(DOWN, (0.05, 0.0, 0.0))).world_from_tool[0, 3], 0.05, atol=1e-5)


@pseudo_terminal
@pytest.mark.parametrize(
    ("dialect", "kind", "words"),
    [("marlin", DeviceError, "Printer halted"), ("grbl", SafetyStopError, "ALARM:2")],
)
def test_what_a_board_refuses_is_an_error(stage, dialect, kind, words):
    with (
        boards()[dialect]() as board,
        stage.client("gcode_gantry.py", board.port, dialect, "0.2") as client,
        pytest.raises(kind, match=words),
    ):
        go(client, pose(DOWN, (0.5, 0.0, 0.0)))


@pseudo_terminal
def test_a_grbl_that_reports_work_positions_is_told_how_to_change(stage):
    with boards()["grbl"]() as board, stage.client("gcode_gantry.py", board.port, "grbl", "0.2") as client:
        board.report = "WPos"
        with pytest.raises(DeviceError, match=r"send \$10=1"):
            client.state()
