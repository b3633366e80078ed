"""The client against the server over TCP and over a child process: a rig behind the bridge is the rig itself."""

import contextlib
import os
import signal
import socket
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from tilted_plane import SIX_JOINTS, Served, TiltedPlane, above

from surfuse.bridge.child import ChildTransport
from surfuse.bridge.client import BridgeClient
from surfuse.bridge.consistency import Tolerances
from surfuse.bridge.messages import Ability, MoveTo
from surfuse.bridge.patience import Patience
from surfuse.bridge.server import BridgeServer
from surfuse.bridge.transport import TcpTransport
from surfuse.errors import ConfigError, DataError, DeviceError, SafetyStopError, UnreachableError
from surfuse.records import Status

RIG = Path(__file__).parent / "tilted_plane.py"
QUICK = Patience(0.4, 0.4, 0.4, 0.4, 0.6, start_timeout_s=10.0, give_up_s=1.0)


def child(*words):
    lines = []
    return ChildTransport([sys.executable, str(RIG), *words], lines.append), lines


@contextlib.contextmanager
def over_tcp():
    with Served(TiltedPlane()) as served, BridgeClient(TcpTransport(served.address)) as client:
        yield client


@contextlib.contextmanager
def over_pipes():
    with BridgeClient(child()[0]) as client:
        yield client


@pytest.fixture(params=[over_tcp, over_pipes])
def client(request):
    with request.param() as opened:
        yield opened


def test_the_rig_is_introduced(client):
    assert client.hello == TiltedPlane().hello()


def test_a_pose_sent_is_the_pose_reached_to_the_last_bit(client):
    to = above(1 / 3, -0.1, 0.7)
    assert client.move(MoveTo(world_from_tool=to)).world_from_tool.tobytes() == to.tobytes()
    assert client.state().world_from_tool.tobytes() == to.tobytes()


def test_readings_come_in_the_order_of_the_sensors(client):
    client.move(MoveTo(world_from_tool=above(1 / 3)))
    first, second = client.sweep().readings
    assert (first.sensor, second.sensor) == ("us0", "us1")
    assert first.range_m == 0.5 - 0.1 * (1 / 3)
    assert (first.amplitude, first.sigma_m, first.status) == (0.7, 3e-4, Status.OK)
    assert first.echoes == ((first.range_m, 0.7), (0.9, 0.1))
    assert np.array_equal(first.envelope.values, np.linspace(0.0, 1.0, 50, dtype=np.float32))
    (only,) = client.sweep(("us1",)).readings
    assert only.range_m == second.range_m


def test_reach_picture_and_stop(client):
    poses = np.array([above(0.0), above(1.5), *[above(0.01 * i) for i in range(450)]])
    assert client.reach(poses).tolist() == [abs(pose[0, 3]) <= 1.0 for pose in poses]
    assert client.reach(poses[:0]).tolist() == []
    assert client.image().grey.tolist() == np.arange(12).reshape(3, 4).tolist()
    assert client.stop().world_from_tool.tobytes() == above(0.0).tobytes()


def test_a_pose_out_of_reach_leaves_the_rig_usable(client):
    with pytest.raises(UnreachableError, match="refuses 'move': x is beyond 1 m; stay within"):
        client.move(MoveTo(world_from_tool=above(2.0)))
    assert client.move(MoveTo(world_from_tool=above(0.5))).world_from_tool[0, 3] == 0.5


def test_an_observation_holds_the_poses_around_the_sweep(client):
    client.move(MoveTo(world_from_tool=above(0.25)))
    seen = client.observe()
    assert seen.before.world_from_tool[0, 3] == seen.after.world_from_tool[0, 3] == 0.25
    assert seen.before.t_s <= seen.sweep.readings[0].t_s <= seen.after.t_s


def test_the_clock_offset_is_as_good_as_it_says(client):
    offset = client.measure_clock().offset
    assert abs(offset.host_minus_bridge_s) <= offset.uncertainty_s  # both count time.monotonic here


@pytest.mark.parametrize("status", [Status.NO_ECHO, Status.TOO_CLOSE, Status.FAULT])
def test_no_echo_is_data(status):
    rig = TiltedPlane()
    rig.status = status
    with Served(rig) as served, BridgeClient(TcpTransport(served.address)) as client:
        reading = client.sweep().readings[0]
    assert reading.status is status
    assert str(reading.range_m) == {1: "inf", 2: "-inf", 3: "nan"}[int(status)]


def test_joints_are_sent_and_watched():
    with Served(TiltedPlane(SIX_JOINTS)) as served, BridgeClient(TcpTransport(served.address)) as client:
        joints = np.linspace(-1.0, 1.0, 6)
        assert client.move(MoveTo(joints_rad=joints, speed_share=0.5)).joints_rad.tobytes() == joints.tobytes()
        with pytest.raises(ConfigError, match="target of 5 joints, the arm has 6 joints"):
            client.move(MoveTo(joints_rad=joints[:5]))


def test_targets_that_do_not_fit_the_arm_are_not_sent():
    rig = TiltedPlane()
    with Served(rig) as served, BridgeClient(TcpTransport(served.address)) as client:
        with pytest.raises(ConfigError, match="no joints"):
            client.move(MoveTo(joints_rad=np.zeros(6)))
        with pytest.raises(ConfigError, match="has no sensor 'us7'; did you mean"):
            client.sweep(("us7",))
        with pytest.raises(ConfigError, match="twice"):
            client.sweep(("us0", "us0"))
    assert (rig.moves, rig.sweeps) == (0, 0)
    with (
        Served(TiltedPlane(arm=None)) as served,
        BridgeClient(TcpTransport(served.address)) as client,
        pytest.raises(ConfigError, match="moves nothing"),
    ):
        client.move(MoveTo(world_from_tool=above(0.0)))


def test_an_arm_that_somebody_else_moves_may_move():
    rig = TiltedPlane(arm=None)
    with Served(rig) as served, BridgeClient(TcpTransport(served.address)) as client:
        for x_m in (0.0, 0.1, 0.3):
            rig.pose = above(x_m)
            seen = client.observe()
            assert seen.before.world_from_tool[0, 3] == seen.after.world_from_tool[0, 3] == x_m


@pytest.mark.parametrize("off_m", [0.0049, 0.0051, 0.02])
def test_an_arm_that_is_not_where_it_was_sent_stops_the_run(off_m):
    rig = TiltedPlane()
    rig.ends_off_m = off_m
    with Served(rig) as served, contextlib.ExitStack() as expected:
        if off_m > 0.005:
            words = rf"{1e3 * off_m:.3f} mm from where it was sent, at most 5 mm"
            expected.enter_context(pytest.raises(SafetyStopError, match=words))
        with BridgeClient(TcpTransport(served.address)) as client:
            client.move(MoveTo(world_from_tool=above(0.1)))
    assert rig.stops == (off_m > 0.005)  # told to stop on the way out


def test_an_arm_that_moves_between_two_sweeps_stops_the_run():
    rig = TiltedPlane()
    with Served(rig) as served, BridgeClient(TcpTransport(served.address)) as client:
        client.move(MoveTo(world_from_tool=above(0.1)))
        client.observe()
        rig.pose = above(0.112)
        with pytest.raises(SafetyStopError, match=r"moved by 12.000 mm without a move, at most 5 mm"):
            client.observe()


def test_a_turned_tool_stops_the_run():
    rig = TiltedPlane()
    with Served(rig) as served, BridgeClient(TcpTransport(served.address)) as client:
        client.state()
        c, s = np.cos(0.04), np.sin(0.04)
        rig.pose = above(0.0) @ np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        with pytest.raises(SafetyStopError, match=r"moved by 2\.292 deg"):
            client.state()


def test_slow_drift_is_measured_from_where_the_arm_was_sent():
    rig = TiltedPlane()
    with (
        Served(rig) as served,
        BridgeClient(TcpTransport(served.address), tolerances=Tolerances(position_tolerance_m=0.001)) as client,
    ):
        for x_m in (0.0, 0.0004, 0.0008):
            rig.pose = above(x_m)
            client.state()
        rig.pose = above(0.0012)
        with pytest.raises(SafetyStopError, match=r"1\.200 mm"):
            client.state()


@pytest.mark.parametrize("ask", ["state", "sweep", "image"])
def test_a_clock_that_goes_back_stops_the_run(ask):
    rig = TiltedPlane()
    with Served(rig) as served, BridgeClient(TcpTransport(served.address)) as client:
        getattr(client, ask)()
        rig.clock_back_s = 5.0
        with pytest.raises(SafetyStopError, match=r"clock of the bridge went back by [45]\.\d+ s .*at most 0.001 s"):
            getattr(client, ask)()


def test_failures_behind_the_bridge_keep_their_kind():
    rig = TiltedPlane()
    with Served(rig) as served, BridgeClient(TcpTransport(served.address)) as client:
        for trouble, kind, status in (
            (SafetyStopError("a person in the cell"), SafetyStopError, 5),
            (DeviceError("encoder 3 is silent"), DeviceError, 4),
            (ConfigError("no tool is set"), DeviceError, 4),
            (ZeroDivisionError("division by zero"), DeviceError, 4),
        ):
            rig.trouble = trouble
            with pytest.raises(kind, match=str(trouble)) as caught:
                client.sweep()
            assert caught.value.exit_status == status
        rig.trouble = None
        assert len(client.sweep().readings) == 2


def test_a_move_too_slow_is_stopped_and_not_repeated():
    rig = TiltedPlane()
    rig.move_takes_s = 30.0
    with Served(rig) as served, BridgeClient(TcpTransport(served.address), QUICK) as client:
        with pytest.raises(DeviceError, match="no answer to") as caught:
            client.move(MoveTo(world_from_tool=above(0.1)))
        assert caught.value.exit_status == 4
    assert rig.moves == 1
    assert rig.stops >= 1


@pytest.mark.skipif(os.name != "posix", reason="a signal for one thread")
@pytest.mark.usefixtures("ctrl_c_interrupts")
def test_ctrl_c_in_a_move_stops_the_arm_at_once():
    rig = TiltedPlane()
    rig.move_takes_s = 30.0

    def ctrl_c():
        wait_for_a_move(rig)
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    with Served(rig) as served:
        hand = threading.Thread(target=ctrl_c)
        hand.start()
        with pytest.raises(KeyboardInterrupt), BridgeClient(TcpTransport(served.address)) as client:
            client.move(MoveTo(world_from_tool=above(0.1)))
        hand.join()
    assert rig.stops == 1
    assert rig.stopping.is_set()


def wait_for_a_move(rig):
    deadline_s = time.monotonic() + 10.0
    while not rig.moves and time.monotonic() < deadline_s:
        time.sleep(0.01)


MOVE = b'{"id": 1, "do": "move", "world_from_tool": [1,0,0,0, 0,-1,0,0, 0,0,-1,0.5, 0,0,0,1]}\n'


def test_a_client_that_vanishes_in_a_move_leaves_a_stopped_arm():
    rig = TiltedPlane()
    rig.move_takes_s = 30.0
    with Served(rig) as served:
        host, port = served.address.removeprefix("tcp://").split(":")
        with socket.create_connection((host, int(port))) as line:
            line.sendall(MOVE)
            wait_for_a_move(rig)
        assert rig.stopping.wait(10.0)
    assert rig.stops == 1


def test_a_second_client_is_told_so():
    with Served(TiltedPlane()) as served, BridgeClient(TcpTransport(served.address)) as first:
        with pytest.raises(DeviceError, match="another client is connected"):
            BridgeClient(TcpTransport(served.address), QUICK).__enter__()
        assert len(first.sweep().readings) == 2


def test_the_next_client_is_welcome():
    with Served(TiltedPlane()) as served:
        for _ in range(5):
            with BridgeClient(TcpTransport(served.address)) as client:
                client.state()


def test_a_port_that_is_taken_is_named():
    with Served(TiltedPlane()) as served, pytest.raises(DeviceError, match="cannot be opened"):
        BridgeServer(TiltedPlane(), served.address).__enter__()


def test_nobody_there_is_noticed_in_time():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
    with pytest.raises(DeviceError, match="no bridge answers") as caught:
        BridgeClient(TcpTransport(address), QUICK).__enter__()
    assert caught.value.exit_status == 4


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("127.0.0.1:5005", "write tcp://"),
        ("tcp://127.0.0.1", "write tcp://"),
        ("tcp://127.0.0.1:99999", "write tcp://"),
        ("tcp://127.0.0.1:5005/x", "write tcp://"),
        ("udp://127.0.0.1:5005", "write tcp://"),
        ("tcp://192.168.1.7:5005", "set allow_remote = true"),
        ("tcp://0.0.0.0:5005", "set allow_remote = true"),
        ("tcp://robot:5005", "set allow_remote = true"),
    ],
)
def test_addresses_are_checked_before_anything_is_opened(address, words):
    with pytest.raises(ConfigError, match=words):
        TcpTransport(address)
    with pytest.raises(ConfigError, match=words):
        BridgeServer(TiltedPlane(), address)


def test_other_machines_are_allowed_when_told():
    assert TcpTransport("tcp://192.168.1.7:5005", allow_remote=True).name == "tcp://192.168.1.7:5005"
    assert TcpTransport("tcp://[::1]:5005").name == "tcp://[::1]:5005"


def test_a_child_that_dies_leaves_its_status_and_last_words():
    transport, lines = child("dies")
    with pytest.raises(DeviceError, match=r"exit status 7; it said: .*the motor is on fire \[31m"):
        BridgeClient(transport).__enter__()
    assert lines == ["bridge: tilted plane comes up", "bridge: the motor is on fire [31m"]


def test_what_a_child_prints_beside_its_answers_is_passed_over():
    transport, lines = child()
    with BridgeClient(transport) as client:
        client.state()
        assert client.tally.garbled_answers == 1  # "a library says hello"
    assert lines == ["bridge: tilted plane comes up"]


def test_a_program_that_does_not_exist_is_named():
    with pytest.raises(DeviceError, match="cannot be started"):
        BridgeClient(ChildTransport(["/no/such/robot"])).__enter__()
    with pytest.raises(ConfigError, match="command = "):
        ChildTransport([])


def test_a_child_that_ignores_its_end_is_ended():
    code = "import sys,time,signal\nsignal.signal(15, signal.SIG_IGN)\nprint('x'*100000, flush=True)\ntime.sleep(60)"
    transport = ChildTransport([sys.executable, "-c", code])
    with pytest.raises(DeviceError):
        BridgeClient(transport, Patience(0.2, start_timeout_s=0.3, give_up_s=0.5)).__enter__()
    assert transport._child.poll() is not None


def test_a_child_that_never_reads_does_not_hold_us():
    transport = ChildTransport([sys.executable, "-c", "import time; time.sleep(60)"])
    transport.open(1.0)
    with pytest.raises(DeviceError, match="takes no question in time"):
        transport.send(b"x" * 1_000_000, time.monotonic() + 0.3)
    transport.close()
    assert transport._child.poll() is not None


def test_a_number_of_ours_that_is_none_is_our_error_and_the_line_stays():
    with Served(TiltedPlane(SIX_JOINTS)) as served, BridgeClient(TcpTransport(served.address)) as client:
        assert client.can(Ability.REACH)
        with pytest.raises(DataError, match="finite"):
            client.move(MoveTo(joints_rad=np.full(6, np.nan)))
        assert client.tally.garbled_answers == 0
        client.state()
