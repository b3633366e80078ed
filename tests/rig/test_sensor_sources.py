"""Sensors of several sources in one array: nodes, serial lines, files of the kernel, a bridge; one clock for all."""

from __future__ import annotations

import importlib.util
import json
import os
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.acquire.clock_told import CLOCK
from surfuse.commands.machine.doctor import doctor
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import MonotonicClock
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.node.firmware import Node
from surfuse.node.link import BusLink, BusParameters, open_bus
from surfuse.node.responder import NodeIdentity, Responder
from surfuse.records import Echo, SensorSpec, Status
from surfuse.runs.log_reader import read_log
from surfuse.settings import load

HERE = Path(__file__).parent


def module_of(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


pretended = module_of(HERE / "pretended_rig.py")
any_devices = module_of(HERE / "test_any_devices.py")
LIGHT = 'kind = "laser"\nbeam_full_angle_deg = 1.0\nrange_min_m = 0.05\nrange_max_m = 1.5\nsigma_m = 0.001\n'
AREA = (
    "[area]\norigin_m = [-0.06, -0.04, 0.0]\nu = [1.0, 0.0, 0.0]\nv = [0.0, 1.0, 0.0]\nwidth_m = 0.08\n"
    'height_m = 0.04\ntallest_m = 0.1\n[scan]\nstep_m = 0.02\nstandoff_m = 0.4\n[fusion]\nmethod = "median"\n'
)
PLACES = {"a": (0.03, 0.0, 0.0), "b": (-0.03, 0.0, 0.0), "c": (0.0, 0.03, 0.0), "d": (0.0, -0.03, 0.01)}


class Distance:
    """A ranger that looks at the plane of a pretended rig from its place on the tool."""

    def __init__(self, rig, place):
        self.rig, self.place = rig, np.append(place, 1.0)
        self.spec = SensorSpec("distance", "laser", 0.05, 1.5, 0.02, 0.001)

    def range_m(self):
        start, axis = (self.rig.pose @ self.place)[:3], self.rig.pose[:3, 2]
        plane_m = pretended.HEIGHT_M + pretended.SLOPE * start[0]
        return float((plane_m - start[2]) / (axis[2] - pretended.SLOPE * axis[0]))

    def __enter__(self):
        return self

    def __exit__(self, *_): ...

    def fire(self):
        return Echo(self.range_m(), Status.OK, time.monotonic(), 0.5, 0.0001, 1)


def node(rig, places, address, channel, session=1):
    """A node with a ranger at each place, on the bus inside of this process."""
    bus, clock = BusParameters("virtual", channel), MonotonicClock()
    responder = Responder(
        [Distance(rig, place) for place in places], clock, NodeIdentity(address, address, session), Catalogue()
    )
    return Node(responder, BusLink(lambda: open_bus(bus), clock, Tally()))


def table(name, driver, more=""):
    return f'[[sensor]]\nname = "{name}"\ndriver = "{driver}"\n{more}\nposition_m = {list(PLACES[name])}\n{LIGHT}'


def written(folder, *tables):
    (folder / "rig.toml").write_text("\n".join(tables), "utf-8")
    return folder / "rig.toml"


def bus(channel, more=""):
    return f'[bus]\ninterface = "virtual"\nchannel = "{channel}"\n{more}'


def arm(address):
    return f'[arm]\ndriver = "bridge"\naddress = "{address}"'


def hits(run):
    found = read_log(run).readings()
    assert (found.status == int(Status.OK)).all()
    return found, found.position_m + found.range_m[:, None] * found.axis


def assert_on_the_plane(run, atol):
    found, hit = hits(run)
    off_m = hit[:, 2] - pretended.HEIGHT_M - pretended.SLOPE * hit[:, 0]
    for number in range(len(found.specs)):
        np.testing.assert_allclose(off_m[found.sensor == number], 0.0, atol=atol[number])


@pytest.fixture
def rig():
    return pretended.PretendedRig(("a",), (PLACES["a"],))


class IioFolder:
    """Files as the kernel has them; written by a thread, as its driver measures."""

    def __init__(self, rig, place, folder):
        self.distance, self.folder, self._end = Distance(rig, place), folder, threading.Event()

    def __enter__(self):
        self.folder.mkdir()
        (self.folder / "in_distance_scale").write_text("0.001")
        os.mkfifo(self.folder / "in_distance_raw")
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        return self

    def _serve(self):
        while not self._end.is_set():
            with (self.folder / "in_distance_raw").open("w") as answer:
                answer.write(f"{round(1000.0 * self.distance.range_m())}\n")
            time.sleep(0.002)  # the reader sees the end of the file first

    def __exit__(self, *_):
        self._end.set()
        (self.folder / "in_distance_raw").read_text()
        self._thread.join()


@pytest.fixture
def pins(rig):
    """An HC-SR04 on mock pins that looks at the plane: trigger and echo."""
    gpiozero = pytest.importorskip("gpiozero")
    from gpiozero.pins.mock import MockFactory, MockPin
    from gpiozero.pins.pi import PiPin

    distance = Distance(rig, PLACES["c"])

    class Trigger(MockPin):
        def _set_state(self, value):
            falls = self.state and not value
            super()._set_state(value)
            if falls:
                # The driver's speed of sound at 0 degrees Celsius.
                for ticks, state in ((1.0, 1), (1.0 + 2.0 * distance.range_m() / 331.3, 0)):
                    self.echo._state = bool(state)
                    PiPin._call_when_changed(self.echo, ticks, state)

    earlier, factory = gpiozero.Device.pin_factory, MockFactory()
    gpiozero.Device.pin_factory = factory
    factory.pin("GPIO23", pin_class=Trigger).echo = factory.pin("GPIO24")
    yield 'trigger_pin = "GPIO23"\necho_pin = "GPIO24"\nair_temperature_c = 0.0'
    factory.reset()
    gpiozero.Device.pin_factory = earlier


def test_an_hcsr04_on_pins_beside_a_node(rig, pins, tmp_path):
    with pretended.Served(rig) as served, node(rig, [PLACES["b"]], 1, "pins"):
        path = written(tmp_path, arm(served.address), table("c", "hcsr04", pins), table("b", "node"), bus("pins"), AREA)
        assert acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True).complete
    assert_on_the_plane(tmp_path / "run", [1e-6, 1e-4])


@pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
def test_a_node_a_serial_line_the_kernel_and_a_bridge_side_by_side(rig, tmp_path):
    pytest.importorskip("serial")
    with ExitStack() as stack:
        served = stack.enter_context(pretended.Served(rig))
        light = stack.enter_context(any_devices.TfminiOnALine(rig, PLACES["c"]))
        stack.enter_context(node(rig, [PLACES["b"]], 1, "mixed"))
        stack.enter_context(IioFolder(rig, PLACES["d"], tmp_path / "iio"))
        path = written(
            tmp_path,
            arm(served.address),
            table("c", "tfmini", f'port = "{light.port}"\nmodel = "tfmini-plus"\ntimeout_s = 60.0'),
            table("b", "node"),
            table("d", "iio", f'folder = "{tmp_path / "iio"}"\nmodel = "vl53l1x"'),
            table("a", "bridge"),
            bus("mixed"),
            AREA,
        )
        found = doctor(path, []).summary
        assert found["problems"] == [], found["checks"]
        outcome = acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)
    assert outcome.complete
    assert outcome.summary["bus"]["readings"] == outcome.summary["stops"]
    # The laser tells whole centimetres, the node tenths of a millimetre at worst, the kernel whole millimetres.
    assert_on_the_plane(tmp_path / "run", [6e-3, 1e-4, 6e-4, 1e-9])
    assert [spec.name for spec in read_log(tmp_path / "run").readings().specs] == ["c", "b", "d", "a"]


def test_stamps_of_all_sources_are_on_the_clock_of_the_rig(rig, tmp_path):
    """The bridge's clock begins with its rig, this machine's with the machine."""
    with pretended.Served(rig) as served, node(rig, [PLACES["b"]], 1, "stamps"):
        path = written(tmp_path, arm(served.address), table("b", "node"), table("a", "bridge"), bus("stamps"), AREA)
        acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)
        now_s = time.monotonic() - rig.began_s
    events = [event for event in read_log(tmp_path / "run").events if event.source == CLOCK]
    assert "so well the stamps of b are brought to the bridge's" in events[-1].text
    told_ms = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))["clock"]["uncertainty_ms"]
    assert 0.0 <= told_ms < 1e3 * 60.0
    found = read_log(tmp_path / "run").readings()
    times_s = found.t_s.reshape(-1, 2)
    assert (found.t_s > 0.0).all()
    slack_s = (
        1e-3 * told_ms + 0.002
    )  # half of the fastest answer to a state, and the node's clock of whole microseconds
    assert (found.t_s <= now_s + slack_s).all()
    # The bridge is asked first, the node afterwards: an offset that is wrong would turn the order, or part them.
    assert (times_s[:, 0] >= times_s[:, 1] - slack_s).all()
    assert (times_s[1:, 1] >= times_s[:-1, 0] - slack_s).all()


def test_several_sensors_of_two_nodes_by_their_numbers(rig, tmp_path):
    with (
        pretended.Served(rig) as served,
        node(rig, [PLACES["b"], PLACES["a"]], 1, "two nodes"),
        node(rig, [PLACES["d"], PLACES["c"]], 2, "two nodes"),
    ):
        path = written(
            tmp_path,
            arm(served.address),
            table("a", "node", "number = 1"),
            table("d", "node", "node = 2"),
            table("b", "node", "number = 0"),
            table("c", "node", "node = 2"),
            bus("two nodes"),
            AREA,
        )
        outcome = acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)
    assert_on_the_plane(tmp_path / "run", [1e-4] * 4)
    stops = outcome.summary["stops"]
    # One trigger a node and stop, however many sensors it has.
    assert (outcome.summary["bus"]["triggers"], outcome.summary["bus"]["readings"]) == (2 * stops, 4 * stops)


class EndsNode(SilentWatcher):
    """Ends a node after so many sweeps."""

    def __init__(self, running, after):
        self.running, self.left = running, after

    def advance(self, steps=1):
        self.left -= steps
        if self.left == 0:
            self.running.close()


def test_a_node_that_goes_away_ends_the_scan_and_resume_finishes_it(rig, tmp_path, monkeypatch):
    monkeypatch.setattr("surfuse.rig.real.node_sensors._SILENCE_S", 0.3)
    with pretended.Served(rig) as served:
        path = written(tmp_path, arm(served.address), table("b", "node"), bus("goes", "connect_timeout_s = 60.0"), AREA)
        running = ExitStack()
        running.enter_context(node(rig, [PLACES["b"]], 1, "goes"))
        with pytest.raises(DeviceError, match="surfuse resume"):
            acquire(load(path), tmp_path / "run", EndsNode(running, 4), yes=True)
        assert len(read_log(tmp_path / "run").sweeps) == 4
        with node(rig, [PLACES["b"]], 1, "goes", session=2):
            assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert_on_the_plane(tmp_path / "run", [1e-4])


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ((table("a", "node"),), "bus.interface = 'virtual' reaches none"),
        ((table("a", "node"), '[bus]\ninterface = "none"'), "bus.interface = 'none' reaches none"),
        ((table("a", "node", "nummber = 1"), bus("x")), "unknown key 'nummber'; did you mean 'number'"),
        ((table("a", "node", "number = 12"), bus("x")), "number = 12; give a whole number, 0 to"),
        ((table("a", "node", "node = true"), bus("x")), "node = True"),
        ((table("a", "node", "number = 1"), table("b", "node"), bus("x")), "both number 1 of node 1"),
        ((table("a", "nod"), bus("x")), "did you mean 'node'"),
    ],
)
def test_addresses_that_cannot_be_meant_are_refused(rig, tmp_path, tables, told):
    with pretended.Served(rig) as served:
        path = written(tmp_path, arm(served.address), *tables, AREA)
        with pytest.raises(ConfigError, match=told):
            acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)
    assert rig.moves == 0
