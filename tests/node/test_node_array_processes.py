"""Host and node as two processes over UDP multicast."""

import math
import socket
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from surfuse.errors import DeviceError
from surfuse.interfaces import MonotonicClock
from surfuse.node.array import Parameters, create
from surfuse.node.counters import Tally
from surfuse.node.link import BusLink, BusParameters, open_bus
from surfuse.node.messages import CanFrame
from surfuse.node.timeouts import NodeTimeouts
from surfuse.records import Fixture, SensorSpec, Status

with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
    # One that nobody uses now: two runs of the tests on one machine must not meet.
    probe.bind(("", 0))
    PORT = probe.getsockname()[1]
BUS = BusParameters("udp_multicast", "239.74.163.77", options=(("port", PORT), ("hop_limit", 0)))
SPEC = SensorSpec("stand-in", "ultrasonic", 0.3, 4.0, 0.3, 0.001)
FIXTURE = Fixture(np.stack([np.eye(4)] * 4), (SPEC,) * 4)

NODE = """
import sys, threading
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.interfaces import MonotonicClock
from surfuse.node.firmware import run
from surfuse.node.link import BusLink, BusParameters, open_bus
from surfuse.node.responder import NodeIdentity, Responder
from surfuse.records import Echo, SensorSpec, Status

class Ranger:
    spec = SensorSpec("stand-in", "ultrasonic", 0.3, 4.0, 0.3, 0.001)
    def __init__(self, clock, number):
        self.clock, self.number, self.fired = clock, number, 0
    def __enter__(self): return self
    def __exit__(self, *error): ...
    def fire(self):
        start_s = self.clock.now_s()
        self.clock.advance(0.005)
        self.fired += 1
        return Echo(0.4 + self.number * 0.01 + self.fired * 0.0001, Status.OK, start_s, 0.5, 0.0002, 8)

clock, stop = MonotonicClock(), threading.Event()
bus = BusParameters("udp_multicast", "239.74.163.77", options=(("port", int(sys.argv[1])), ("hop_limit", 0)))
threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), daemon=True).start()
responder = Responder([Ranger(clock, n) for n in range(4)], clock, NodeIdentity(session=7), Catalogue())
run(responder, BusLink(lambda: open_bus(bus), clock, Tally()), stop)
"""


def multicast_works():
    clock = MonotonicClock()
    try:
        ends = [BusLink(lambda: open_bus(BUS), clock, Tally()) for _ in range(2)]
        with ends[0], ends[1]:
            ends[0].send(CanFrame(0x7EF, b"probe"))
            return ends[1].receive(10.0) is not None
    except DeviceError:
        return False


def test_host_and_node_are_two_processes():
    pytest.importorskip("msgpack")
    if not multicast_works():
        pytest.skip("this machine does not pass multicast on loopback")
    node = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(NODE), str(PORT)],
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    timeouts = NodeTimeouts(connect_timeout_s=300.0, answer_timeout_s=0.5, silence_limit_s=300.0)
    try:
        with create(FIXTURE, Parameters(bus=BUS, timeouts=timeouts)) as array:
            before_s = MonotonicClock().now_s()
            all_echoes = [array.sweep() for _ in range(10)]
            after_s = MonotonicClock().now_s()
    finally:
        _, errors = node.communicate(timeout=300)
    assert node.returncode == 0, errors
    for sweep, echoes in enumerate(all_echoes, start=1):
        for number, echo in enumerate(echoes):
            assert echo.status is Status.OK
            assert math.isclose(echo.range_m, 0.4 + number * 0.01 + sweep * 0.0001, abs_tol=1e-9)
            assert before_s <= echo.t_s <= after_s
    assert array.counters.failed == array.counters.conflicts == 0
