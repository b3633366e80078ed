"""The array behind CAN on the real in-process bus, with threads: equal to the sensors themselves."""

import math
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import MonotonicClock
from surfuse.node.array import CanArray, Parameters, create
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.node.disturbed_bus import BadBus, BadLink
from surfuse.node.firmware import Node
from surfuse.node.link import BusLink, BusParameters, open_bus
from surfuse.node.messages import KitMessage, NodeState
from surfuse.node.responder import NodeAbilities, NodeIdentity, Responder
from surfuse.node.timeouts import NodeTimeouts
from surfuse.records import Echo, Fixture, SensorSpec, Status
from surfuse.rig import sequential_array as sequential
from surfuse.sensors import polaroid, simulated

# Nothing but a hang waits so long.
PATIENT = NodeTimeouts(answer_timeout_s=300.0, silence_limit_s=300.0, adapter_limit_s=300.0, connect_timeout_s=300.0)
SPEC = SensorSpec("stand-in", "ultrasonic", 0.3, 4.0, 0.3, 0.001)
FIXTURE = Fixture(np.stack([np.eye(4)] * 4), (SPEC,) * 4)


class SteppedClock:
    def __init__(self):
        self.t_s = 100.0

    def now_s(self):
        return self.t_s

    def advance(self, duration_s):
        self.t_s += duration_s


class NoisyRanger:
    """A simulated ranger whose readings depend on how often it was fired, and whose firing takes simulated time."""

    spec = SPEC

    def __init__(self, clock, generator, delay_s=0.0):
        self.clock, self.generator, self.delay_s = clock, generator, delay_s

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace): ...

    def fire(self):
        start_s = self.clock.now_s()
        time.sleep(self.delay_s)
        self.clock.advance(SPEC.firing_time_s)
        draw = self.generator.normal(0.43, 0.001)
        if draw > 0.432:
            return Echo(math.inf, Status.NO_ECHO, start_s, count=0)
        return Echo(draw, Status.OK, start_s, abs(self.generator.normal(0.5, 0.1)), 0.0004, 8)


class Setup:
    def __init__(self, name, delay_s=0.0, wrap=lambda link: link, timeouts=None, settle_s=None):
        self.clock = SteppedClock()
        generator = np.random.default_rng(42)
        self.sensors = [NoisyRanger(self.clock, generator, delay_s) for _ in range(4)]
        bus = BusParameters(channel=name)
        responder = Responder(self.sensors, self.clock, NodeIdentity(), Catalogue())
        self.node_tally, self.tally = Tally(), Tally()
        self.node = Node(responder, BusLink(lambda: open_bus(bus), self.clock, self.node_tally))
        self.parameters = Parameters(bus=bus, timeouts=timeouts or PATIENT)
        link = wrap(BusLink(lambda: open_bus(bus), self.clock, self.tally))
        self.array = CanArray(FIXTURE, self.parameters, link, self.clock, self.tally)


def sweeps(setup, number):
    with setup.node, setup.array as array:
        return [echo for _ in range(number) for echo in array.sweep()]


def same(one, two):
    return all(
        (a.range_m, a.status, a.t_s, a.count) == (b.range_m, b.status, b.t_s, b.count)
        and (a.amplitude == b.amplitude or math.isnan(a.amplitude))
        for a, b in zip(one, two, strict=True)
    )


def test_the_bus_adds_nothing_but_its_quantisation():
    clock = SteppedClock()
    generator = np.random.default_rng(42)
    direct = [NoisyRanger(clock, generator) for _ in range(4)]
    expected = [sensor.fire() for _ in range(50) for sensor in direct]
    answers = sweeps(Setup("adds_nothing"), 50)
    for got, want in zip(answers, expected, strict=True):
        assert got.status is want.status
        assert got.t_s == pytest.approx(want.t_s, abs=1e-6)
        assert got.count == want.count
        if want.status is Status.OK:
            assert got.range_m == round(want.range_m * 1e5) / 1e5
            assert got.amplitude == pytest.approx(want.amplitude, abs=2.6e-5)
            assert got.spread_m == pytest.approx(0.0004, abs=1e-12)
        else:
            assert got.range_m == math.inf
            assert math.isnan(got.amplitude)


class Air:
    """A world in which every ping hears a plate, with noise and now and then nothing."""

    def __init__(self, seed):
        self.generator = np.random.default_rng(seed)

    def ping(self, world_from_sensor, spec, pings, t_s):
        ranges = self.generator.normal(0.43, 0.0005, pings)
        ranges[self.generator.random(pings) < 0.2] = np.inf
        return ranges, self.generator.uniform(0.1, 1.2, pings)

    def image(self, camera, world_from_camera): ...
    def repeatability(self, joints): ...
    def begin(self, stage, index): ...


def test_the_simulated_array_gives_the_same_bits_with_and_without_the_bus():
    def array_of(clock):
        air = Air(8)
        return [
            simulated.create(
                simulated.Parameters(
                    surroundings=simulated.Surroundings(
                        clock=clock, spec=polaroid.SPEC, world=air, pose=lambda: np.eye(4)
                    )
                )
            )
            for _ in range(4)
        ]

    fixture = Fixture(np.stack([np.eye(4)] * 4), (polaroid.SPEC,) * 4)
    with sequential.create(fixture, array_of(SteppedClock())) as array:
        direct = [echo for _ in range(40) for echo in array.sweep()]
    clock, bus = SteppedClock(), BusParameters(channel="same_bits")
    responder = Responder(array_of(clock), clock, NodeIdentity(), Catalogue())
    node = Node(responder, BusLink(lambda: open_bus(bus), clock, Tally()))
    with node, create(fixture, Parameters(bus=bus, timeouts=PATIENT), clock) as array:
        behind = [echo for _ in range(40) for echo in array.sweep()]
    for one, two in zip(direct, behind, strict=True):
        same_bits = (one.range_m, one.status, one.count) == (two.range_m, two.status, two.count)
        assert same_bits
        assert one.t_s == pytest.approx(two.t_s, abs=1e-9)
        for ours, theirs in ((one.amplitude, two.amplitude), (one.spread_m, two.spread_m)):
            assert ours == theirs or (math.isnan(ours) and math.isnan(theirs))


def test_results_do_not_depend_on_the_timing_of_threads():
    quick = sweeps(Setup("timing_quick"), 12)
    slow = sweeps(Setup("timing_slow", delay_s=0.01), 12)
    impatient = Setup("timing_impatient", delay_s=0.02, timeouts=replace(PATIENT, answer_timeout_s=0.003))
    assert same(quick, slow)
    assert same(quick, sweeps(impatient, 12))
    assert impatient.array.counters.retriggers > 0
    assert impatient.array.counters.failed == 0


def test_results_do_not_depend_on_a_bad_bus():
    timeouts = replace(PATIENT, answer_timeout_s=0.01)
    bad = BadBus(0.1, 0.1, 0.1)
    lossy = Setup("bad_bus", wrap=lambda link: BadLink(link, bad, np.random.default_rng(2)), timeouts=timeouts)
    assert same(sweeps(Setup("good_bus"), 60), sweeps(lossy, 60))
    assert lossy.array.counters.retriggers > 0


class WatchedLink:
    """A link that notes which waits for a frame were in vain."""

    def __init__(self, inner):
        self.inner, self.received, self.in_vain = inner, 0, 0

    def __enter__(self):
        self.inner.__enter__()
        return self

    def __exit__(self, *error):
        self.inner.__exit__(*error)

    def send(self, frame):
        return self.inner.send(frame)

    def receive(self, timeout_s):
        arrival = self.inner.receive(timeout_s)
        self.received += arrival is not None
        self.in_vain += arrival is None
        return arrival


def test_a_sweep_waits_for_nothing_but_its_own_answers():
    setup = Setup("overhead", wrap=WatchedLink)
    with setup.node, setup.array as array:
        link = array._client._link
        link.received = link.in_vain = 0
        for _ in range(100):
            array.sweep()
        # Accepted, a reading and its detail for each sensor, done; a heartbeat a second may stand between them.
        assert 100 * 9 <= link.received <= 100 * 10 + 300
        assert link.in_vain == 0


def test_nothing_is_lost_on_a_good_bus():
    setup = Setup("good_counts")
    with setup.node, setup.array as array:
        for _ in range(20):
            array.sweep()
    counters = array.counters
    assert counters.readings == 80
    assert counters.triggers == 20
    trouble = counters.lost, counters.duplicated, counters.reordered, counters.retriggers, counters.late
    assert trouble == (0, 0, 0, 0, 0)
    assert counters.failed == counters.conflicts == counters.too_fast == counters.receive_errors == 0


def test_one_sensor_is_in_the_air_at_a_time():
    air = threading.Lock()
    flying, overlaps = [], []

    class Watched(NoisyRanger):
        def fire(self):
            start_s = clock.now_s()
            overlaps.extend(flying)
            flying.append(self)
            time.sleep(0.005)
            flying.remove(self)
            return Echo(0.43, Status.OK, start_s, 0.5, 0.0004, 8)

    clock = MonotonicClock()
    nodes, arrays = [], []
    for number in (1, 2):
        bus = BusParameters(channel="one_in_the_air")
        sensors = [Watched(SteppedClock(), np.random.default_rng(number)) for _ in range(4)]
        responder = Responder(sensors, clock, NodeIdentity(node=number), Catalogue(), NodeAbilities(air=air))
        nodes.append(Node(responder, BusLink(lambda bus=bus: open_bus(bus), clock, Tally())))
        arrays.append(create(FIXTURE, Parameters(bus=bus, node=number, timeouts=PATIENT)))
    with nodes[0], nodes[1], arrays[0] as first, arrays[1] as second:
        other = threading.Thread(target=lambda: [second.sweep() for _ in range(5)])
        other.start()
        echoes = [echo for _ in range(5) for echo in first.sweep()]
        other.join()
    assert not overlaps
    assert all(echo.status is not Status.FAULT for echo in echoes)
    assert first.counters.foreign > 0


def test_a_node_that_is_started_late_is_waited_for():
    setup = Setup("started_late")
    timer = threading.Timer(0.3, setup.node.__enter__)
    timer.start()
    try:
        with setup.array as array:
            assert len(array.sweep()) == 4
            assert array.heartbeat is not None
            assert array.heartbeat.state is NodeState.STARTING
    finally:
        timer.join()
        setup.node.__exit__(None, None, None)


def test_no_node_is_an_error_with_a_cure():
    setup = Setup("no_node", timeouts=NodeTimeouts(connect_timeout_s=0.2))
    with pytest.raises(DeviceError, match="check power, wiring, bitrate and id"), setup.array:
        pass


def test_a_node_that_dies_ends_in_faults_and_then_an_error():
    setup = Setup("dies", timeouts=replace(PATIENT, answer_timeout_s=0.05, silence_limit_s=0.5))
    with setup.node:
        array = setup.array
        array.__enter__()
    try:
        assert all(echo.status is Status.FAULT for echo in array.sweep())
        array.sweep()
        with pytest.raises(DeviceError, match="sensor node 1"):
            array.sweep()
    finally:
        array.__exit__(None, None, None)


def test_sensor_numbers_of_the_node_can_be_chosen():
    setup = Setup("chosen_numbers")
    pair = Fixture(np.stack([np.eye(4)] * 2), (SPEC,) * 2)
    chosen = replace(setup.parameters, sensors=(3, 1))
    with setup.node, create(pair, chosen, setup.clock) as array:
        echoes = array.sweep()
    # The node fires in the order of its numbers: sensor 1 first.
    assert echoes[1].t_s < echoes[0].t_s


def test_settings_reach_the_kit_over_the_bus():
    told = []
    clock = SteppedClock()
    bus = BusParameters(channel="settings")
    sensors = [NoisyRanger(clock, np.random.default_rng(0)) for _ in range(4)]
    responder = Responder(
        sensors,
        clock,
        NodeIdentity(),
        Catalogue(),
        NodeAbilities(configure=lambda sensor, settings: told.append((sensor, settings))),
    )
    node = Node(responder, BusLink(lambda: open_bus(bus), clock, Tally()))
    settings = KitMessage(49_410, 16, 2380, 37.5, 500_000, pings=12)
    with node, create(FIXTURE, Parameters(bus=bus, timeouts=PATIENT), clock) as array:
        array.configure(settings, sensor=1)
    assert told == [(1, settings)]


def test_a_node_can_average_plain_sensors():
    def mean(echoes):
        ranges = [echo.range_m for echo in echoes if echo.status is Status.OK]
        return Echo(sum(ranges) / len(ranges), Status.OK, echoes[0].t_s, 1.0, 0.0, len(ranges))

    clock = SteppedClock()
    bus = BusParameters(channel="averages")
    sensors = [NoisyRanger(clock, np.random.default_rng(0)) for _ in range(4)]
    responder = Responder(sensors, clock, NodeIdentity(), Catalogue(), NodeAbilities(pings=6, average=mean))
    node = Node(responder, BusLink(lambda: open_bus(bus), clock, Tally()))
    with node, create(FIXTURE, Parameters(bus=bus, timeouts=PATIENT), clock) as array:
        first = array.sweep()
        array.configure(KitMessage(pings=20))
        second = array.sweep()
    assert all(4 <= echo.count <= 6 for echo in first)
    assert all(15 <= echo.count <= 20 for echo in second)


@pytest.mark.parametrize(
    "change",
    [{"node": 0}, {"node": 8}, {"sensors": (0, 0)}, {"sensors": (9,)}, {"wave_speed_max_m_s": math.nan}],
)
def test_parameters_have_limits(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        Parameters(**change)


@pytest.mark.parametrize(
    "change",
    [
        {"answer_timeout_s": 0.0},
        {"silence_limit_s": math.nan},
        {"connect_timeout_s": math.inf},
        {"reorder_grace_s": -1.0},
        {"rounds": 0},
    ],
)
def test_patience_has_limits(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        NodeTimeouts(**change)


def test_a_fixture_must_fit_the_numbers():
    with pytest.raises(ConfigError, match="sensor numbers"):
        create(FIXTURE, Parameters(sensors=(0, 1)))
