"""A CAN adapter that is pulled out in the middle of an acquisition, and put in again before the run is resumed."""

import json
import os
import select
import threading
import tty
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from surfuse.interfaces import MonotonicClock
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.node.firmware import Node
from surfuse.node.link import BusLink, BusParameters, open_bus
from surfuse.node.responder import NodeIdentity, Responder
from surfuse.rig.simulated.tethered_sensors import TetheredSensors
from surfuse.twin.tether import NodeEnd

SCAN = ("flat", "--method", "weighted_average", "--set", "scan.step_m=0.06", "--arm-driver", "kinematic", "--seed", "7")
SCAN += ("--set", "scene.azimuth_deg=-130")  # seen early in the turn of the search
AWAY = 12  # frames to the node, and then the plug is out


class Adapters:
    """Two serial CAN adapters on pseudo-terminals, wired to each other; the host's is behind a link in `folder`."""

    def __init__(self, folder: Path) -> None:
        self.host, self.node = folder / "host-adapter", folder / "node-adapter"
        self.frames, self.limit = 0, None
        self._stop, self._ends = threading.Event(), {}

    def __enter__(self):
        self.plug(self.host)
        self.plug(self.node)
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *error):
        self._stop.set()
        self._thread.join()
        for place in (self.host, self.node):
            self.pull(place)

    def plug(self, place):
        master, slave = os.openpty()
        tty.setraw(master)
        tty.setraw(slave)
        place.symlink_to(os.ttyname(slave))
        self._ends[place] = (master, slave)

    def pull(self, place):
        place.unlink(missing_ok=True)
        for end in self._ends.pop(place, ()):
            os.close(end)

    def _carry(self):
        while not self._stop.is_set():
            ends = {pair[0]: place for place, pair in self._ends.items()}
            for end in select.select(list(ends), [], [], 0.02)[0]:
                self._pass_on(end, self.node if ends[end] == self.host else self.host, ends[end] == self.host)

    def _pass_on(self, end, other, from_host):
        with suppress(OSError):
            data = os.read(end, 4096)
            if other in self._ends:
                os.write(self._ends[other][0], data)
            self.frames += data.count(b"\r") if from_host else 0
        if self.limit is not None and self.frames >= self.limit:
            self.limit = None
            self.pull(self.host)


def bus_options(channel, port):
    values = ("bus.interface=slcan", f"bus.channel={channel}", f"bus.tether_port={port}")
    return [word for value in values for word in ("--set", value)]


def test_the_run_ends_with_a_clear_message_and_goes_on_when_the_adapter_is_back(tmp_path, command):
    pytest.importorskip("serial")
    simulated = TetheredSensors()
    with ExitStack() as open_, Adapters(tmp_path) as adapters:
        line = open_.enter_context(NodeEnd(0, simulated.configure, simulated.move))
        responder = Responder(simulated.sensors, simulated.clock, NodeIdentity(), Catalogue())
        bus = BusParameters("slcan", str(adapters.node), options=(("sleep_after_open", 0.0),))
        open_.enter_context(Node(responder, BusLink(lambda: open_bus(bus), MonotonicClock(), Tally())))
        adapters.limit = adapters.frames + AWAY
        run = tmp_path / "run"
        options = bus_options(adapters.host, line.port)
        failed = command("acquire", *SCAN, *options, "--out", run)
        assert failed.status == 4
        assert "the CAN adapter takes no frames" in failed.err
        assert "surfuse resume" in failed.err
        adapters.plug(adapters.host)
        resumed = command("resume", run, "--json")
        assert resumed.status == 0
    told = json.loads(resumed.out)
    plain = json.loads(
        command("acquire", *SCAN, "--set", "bus.interface=none", "--out", tmp_path / "plain", "--json").out
    )
    assert (told["stops"], told["rmse_mm"]) == (plain["stops"], plain["rmse_mm"])
    assert told["gaps"] == plain["gaps"]
