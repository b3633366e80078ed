"""The program of a node: as a process of its own with simulated sensors, and what its file may say."""

import json
import math
import signal
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack

import numpy as np
import pytest

from surfuse.commands.machine.node_program import node, read_node_file
from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import MonotonicClock
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.node.firmware import Node
from surfuse.node.link import BusLink, BusParameters, open_bus
from surfuse.node.messages import CanFrame
from surfuse.node.responder import NodeAbilities, NodeIdentity, Responder
from surfuse.records import Status
from surfuse.rig.description import square_fixture
from surfuse.rig.mounts import looking_outwards, world_from_shoulder
from surfuse.rig.node_array import elsewhere
from surfuse.rig.simulated.assembly import SimulatedClock, array_sensors, build_world, simulated_rig
from surfuse.rig.simulated.tethered_sensors import TetheredSensors
from surfuse.settings import load
from surfuse.twin.tether import HostEnd, NodeEnd, Place


def free_port(kind):
    """A port that nobody uses now: two runs of the tests on one machine must not meet."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]


PORT, TETHER = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
COMMAND = [sys.executable, "-c", "from surfuse.cli import main; main()", "node"]
COMMAND += ["--port", str(PORT), "--tether-port", str(TETHER), "--json"]


def multicast_works():
    pytest.importorskip("msgpack")
    bus, clock = (
        BusParameters("udp_multicast", "239.74.163.2", options=(("port", free_port(socket.SOCK_DGRAM)),)),
        MonotonicClock(),
    )
    try:
        ends = [BusLink(lambda: open_bus(bus), clock, Tally()) for _ in range(2)]
        with ends[0], ends[1]:
            ends[0].send(CanFrame(0x7EF, b"probe"))
            return ends[1].receive(10.0) is not None
    except DeviceError:
        return False


def facing_the_part(cell, forward_m=0.69, height_m=1.10):
    """Joints that bring the grip 0.43 m in front of the part of the usual cell, looking outwards."""
    grip = world_from_shoulder(math.radians(35.0)) @ looking_outwards(forward_m, height_m)
    joints, reached = cell.motion.arm.kinematics.inverse(grip[None])
    return joints[0][reached[0]][0]


def readings(*overrides):
    cell = simulated_rig(
        load(
            None,
            [
                "scene.name=tilted",
                "scene.material=matte",
                "array.pings=3",
                "seed=5",
                "arm.driver=kinematic",
                *overrides,
            ],
        )
    )
    with cell.opened():
        found = []
        for stop in (2, 4):
            cell.begin("stop", stop)
            cell.motion.arm.move_to(facing_the_part(cell, height_m=1.10 + 0.005 * stop))
            found += cell.array.sweep()
    assert all(echo.status is Status.OK for echo in found)
    return [(e.range_m, e.spread_m, e.amplitude, e.status, e.count, round(e.t_s, 6)) for e in found]


def test_a_node_in_another_process_gives_the_same_numbers_and_ends_cleanly():
    if not multicast_works():
        pytest.skip("this machine does not pass multicast on loopback")
    process = subprocess.Popen(COMMAND, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    udp = ("bus.interface=udp_multicast", f"bus.port={PORT}", f"bus.tether_port={TETHER}", "bus.connect_timeout_s=300")
    try:
        assert "4 simulated sensors" in process.stderr.readline()
        over_udp = readings(*udp)
        again = readings(*udp)
        together = readings("array.trigger=simultaneous", *udp)
    finally:
        process.send_signal(signal.SIGINT)
        printed, errors = process.communicate(timeout=300)
    assert (process.returncode, errors) == (0, "")
    assert json.loads(printed)["sensors"] == ["us0", "us1", "us2", "us3"]
    plain = readings()
    np.testing.assert_array_equal(np.array(over_udp), np.array(plain))
    np.testing.assert_array_equal(np.array(again), np.array(plain))
    plain_together = readings("array.trigger=simultaneous")
    np.testing.assert_array_equal(np.array(together), np.array(plain_together))
    assert together != over_udp


def place():
    return Place("stop", 1, 2.5, np.eye(4))


def test_the_tether_carries_places_exactly_and_passes_on_refusals():
    told, lock = [], threading.Lock()

    def configure(tree):
        if tree != {"seed": 3}:
            raise ConfigError("wrong tree")

    def move(found):
        with lock:
            told.append(found)

    with NodeEnd(0, configure, move) as end:
        with HostEnd(end.port, {"seed": 3}, place) as host:
            host.tell()
        with pytest.raises(DeviceError, match="wrong tree"), HostEnd(end.port, {"seed": 4}, place):
            pass
    assert (told[0].stage, told[0].index, told[0].t_s) == ("stop", 1, 2.5)
    np.testing.assert_array_equal(told[0].world_from_grip, np.eye(4))


def test_a_node_that_comes_back_is_configured_again_and_told_the_same_place():
    heard = []

    def end(port, name):
        return NodeEnd(port, lambda tree: heard.append((name, tree)), lambda found: heard.append((name, found.index)))

    with end(0, "first") as first:
        port = first.port
        host = HostEnd(port, {"seed": 3}, place, return_s=300.0)
        with ExitStack() as opening:
            opening.enter_context(host)
            host.tell()
            first.__exit__(None, None, None)
            opening.enter_context(end(port, "second"))
            host.tell()
            host.tell()
    assert heard == [("first", {"seed": 3}), ("first", 1), ("second", {"seed": 3}), ("second", 1), ("second", 1)]


def test_a_node_that_stays_away_is_an_error_with_a_cure():
    with NodeEnd(0, lambda tree: None, lambda found: None) as end, HostEnd(end.port, {}, place, return_s=0.3) as host:
        host.tell()
        end.__exit__(None, None, None)
        with pytest.raises(DeviceError, match=r"not back after 0\.3 s; start `surfuse node` again"):
            host.tell()


class NodeHere:
    """A simulated node in this process, as `surfuse node` is one in another."""

    def __init__(self, bus, port, session):
        self.simulated = TetheredSensors()
        self.line = NodeEnd(port, self.simulated.configure, self.simulated.move)
        responder = Responder(
            self.simulated.sensors, self.simulated.clock, NodeIdentity(session=session), Catalogue(),
            NodeAbilities(fire_together=self.simulated.fire_together))  # fmt: skip
        self.node = Node(responder, BusLink(lambda: open_bus(bus), MonotonicClock(), Tally()))

    def __enter__(self):
        self.line.__enter__()
        self.node.__enter__()
        return self

    def __exit__(self, *error):
        self.node.__exit__(*error)
        self.line.__exit__(*error)


@pytest.mark.parametrize("when", ["between two sweeps", "in the middle of a sweep"])
def test_a_simulated_node_that_is_started_again_changes_no_number(when):
    settings = load(None, ["scene.name=tilted", "scene.material=matte", "array.pings=3", "seed=5"])
    world, _ = build_world(settings)
    fixture, grip = square_fixture(settings), world_from_shoulder(math.radians(35.0)) @ looking_outwards(0.69, 1.11)
    clock, stop = SimulatedClock(), [0]
    bus = BusParameters("virtual", f"started-again-{len(when)}")
    nodes = ExitStack()

    def told():
        return Place("stop", stop[0], clock.now_s(), grip)

    class Line(HostEnd):
        def tell(self):
            super().tell()
            if when == "in the middle of a sweep" and stop[0] == 1:
                start_again()

    def start_again():
        stop[0] = 2
        nodes.close()
        nodes.enter_context(NodeHere(bus, port, session=2))

    plain = []
    for index in (0, 2):
        world.begin("stop", index)
        sensors = array_sensors(settings, fixture, world, lambda: grip, SimulatedClock())
        plain.append([sensor.fire().range_m for sensor in sensors])
    with nodes:
        port = nodes.enter_context(NodeHere(bus, 0, session=1)).line.port
        line = Line(port, settings.model_dump(), told)
        with elsewhere(fixture, bus, 1, 300.0, line, clock, together=False) as array:
            first = array.sweep()
            stop[0] = 1
            if when == "between two sweeps":
                start_again()
            second = array.sweep()
        assert array.counters.restarts == 1
    assert [[echo.range_m for echo in sweep] for sweep in (first, second)] == plain


def test_nobody_at_the_other_end_of_the_tether_is_an_error_with_a_cure():
    with NodeEnd(0, lambda tree: None, lambda found: None) as end:
        port = end.port
    with pytest.raises(DeviceError, match="surfuse node"), HostEnd(port, {}, place):
        pass


def test_a_simulated_sensor_without_a_host_says_so():
    sensors = TetheredSensors()
    with pytest.raises(DeviceError, match="no host"):
        sensors.sensors[0].fire()
    sensors.configure({"bus": {"interface": "none"}})
    with pytest.raises(DeviceError, match="where the arm is"):
        sensors.sensors[0].fire()
    sensors.move(Place("stop", 0, 0.0, np.diag([1.0, -1.0, -1.0, 1.0])))
    assert sensors.sensors[0].fire().status in tuple(Status)


def written(tmp_path, text):
    path = tmp_path / "node.toml"
    path.write_text(text)
    return path


def test_a_node_file_names_bus_and_sensors_and_options_win(tmp_path):
    path = written(
        tmp_path,
        'pings = 7\n[bus]\ninterface = "socketcan"\nchannel = "can3"\n'
        '[[sensor]]\ndriver = "tfmini"\nport = "/dev/ttyUSB0"\nmodel = "tfmini-s"\n',
    )
    found = read_node_file(path, {"channel": "can4", "node": None})
    assert (found.bus.interface, found.bus.channel, found.pings) == ("socketcan", "can4", 7)
    assert found.sensors == (("tfmini", {"port": "/dev/ttyUSB0", "model": "tfmini-s"}),)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "no sensor"),
        ("pings = 40\n", "pings = 40"),
        ('[[sensor]]\nplugin = "tfmimi"\n', "did you mean 'tfmini'"),
        ('[[sensor]]\nplugin = "tfmini"\nmodel = "tfmini-s"\n', "lacks port"),
        ('[[sensor]]\nplugin = "tfmini"\nport = "x"\nmodle = "y"\n', "did you mean 'model'"),
        ("[[sensor]]\nport = 3\n", "no driver"),
        ('[[sensor]]\ndriver = "tfmini"\nplugin = "tfmini"\n', "both driver and plugin"),
        ("[sensors]\n", "did you mean 'sensor'"),
        ('[bus]\ninterface = "virtual"\n[[sensor]]\nplugin = "a02yyuw"\nport = "x"\n', "does not leave this process"),
        ('[bus]\nnodes = 3\n[[sensor]]\nplugin = "a02yyuw"\nport = "x"\n', "did you mean 'node'"),
    ],
)
def test_a_wrong_node_file_is_refused_with_a_cure(tmp_path, text, told):
    with pytest.raises(ConfigError) as caught:
        read_node_file(written(tmp_path, text), {})
    assert told in str(caught.value)


def test_a_sensor_that_is_not_there_ends_the_program(tmp_path):
    path = written(tmp_path, '[[sensor]]\nplugin = "a02yyuw"\nport = "/dev/surfuse-none"\n')
    with pytest.raises(DeviceError, match="surfuse-none"):
        node(path, {}, threading.Event(), lambda text: None)
