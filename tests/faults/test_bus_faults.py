"""A hostile bus and hostile nodes: every fault is counted, none becomes a number, none hangs the host."""

import math

import numpy as np
import pytest

from surfuse.errors import DeviceError
from surfuse.node.array import CanArray, Parameters
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.node.disturbed_bus import BadBus, BadLink, DirectLink
from surfuse.node.link import Arrival
from surfuse.node.messages import (
    Acknowledge,
    CanFrame,
    EchoDetail,
    Function,
    Heartbeat,
    KitMessage,
    NodeState,
    Query,
    Reading,
    Result,
    Trigger,
    identifier,
)
from surfuse.node.responder import NodeAbilities, NodeIdentity, Responder
from surfuse.node.timeouts import NodeTimeouts
from surfuse.records import Echo, Fixture, SensorSpec, Status

CATALOGUE = Catalogue()
SPEC = SensorSpec("stand-in", "ultrasonic", 0.3, 4.0, 0.3, 0.001)
FIXTURE = Fixture(np.stack([np.eye(4)] * 4), (SPEC,) * 4)
QUICK = NodeTimeouts(answer_timeout_s=0.02, silence_limit_s=20.0)


class SteppedClock:
    t_s = 0.0

    def now_s(self):
        return self.t_s

    def advance(self, duration_s):
        self.t_s += duration_s


class Ranger:
    """Never gives the same range twice, and knows the last one that it gave."""

    spec = SPEC
    fired = 0

    def __init__(self, clock):
        self.clock, self.last = clock, None

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace): ...

    def fire(self):
        Ranger.fired += 1
        start_s = self.clock.now_s()
        self.clock.advance(0.05)
        self.last = Echo((30_000 + Ranger.fired % 300_000) / 1e5, Status.OK, start_s, 0.5, 0.0003, 8)
        return self.last


class Rig:
    """Host, node and the link between them, in one thread."""

    def __init__(self, wrap=lambda link: link, timeouts=QUICK, sensors=None, **more):
        self.clock, self.tally = SteppedClock(), Tally()
        self.sensors = sensors or [Ranger(self.clock) for _ in range(4)]
        for sensor in self.sensors:
            sensor.clock = self.clock
        self.node = Responder(self.sensors, self.clock, NodeIdentity(), CATALOGUE, NodeAbilities(**more))
        self.direct = DirectLink(self.node, self.clock)
        self.link = wrap(self.direct)
        parameters = Parameters(timeouts=timeouts)
        self.array = CanArray(FIXTURE, parameters, self.link, self.clock, self.tally, self.direct.monotonic_s)


class Meddler:
    """A link that lets `meddle` turn each frame into none, one or several."""

    def __init__(self, inner, meddle):
        self.inner, self.meddle, self.ready = inner, meddle, []

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace): ...

    def send(self, frame):
        return self.inner.send(frame)

    def receive(self, timeout_s):
        while not self.ready:
            arrival = self.inner.receive(timeout_s)
            if arrival is None:
                return None
            self.ready.extend(Arrival(frame, arrival.t_s) for frame in self.meddle(arrival.frame))
        return self.ready.pop(0)


def is_(frame, function):
    return frame.identifier >> 7 == function


@pytest.mark.parametrize(
    "bad",
    [BadBus(0.2, 0, 0), BadBus(0, 0.2, 0), BadBus(0, 0, 0.2, 40), BadBus(0.2, 0.2, 0.2)],
    ids=["loss", "duplication", "reordering", "all"],
)
def test_a_bad_bus_costs_time_but_never_a_wrong_number(bad):
    rig = Rig(lambda link: BadLink(link, bad, np.random.default_rng(3)))
    with rig.array as array:
        for _ in range(400):
            for echo, sensor in zip(array.sweep(), rig.sensors, strict=True):
                if echo.status is Status.OK:
                    assert echo.range_m == sensor.last.range_m
                    assert echo.t_s == pytest.approx(sensor.last.t_s, abs=1e-6)
                else:
                    assert math.isnan(echo.range_m)
    counters = array.counters
    assert counters.readings == 1600
    assert counters.failed <= 8
    assert counters.conflicts == counters.too_fast == counters.restarts == 0


def test_every_lost_frame_is_counted():
    rig = Rig(lambda link: BadLink(link, BadBus(0.2, 0, 0), np.random.default_rng(5)))
    with rig.array as array:
        link = rig.link
        heartbeats = link.injected.lost_in
        per_answer = []
        send = link.send

        def watched(frame):
            before = link.injected.lost_out
            per_answer.append((frame, send(frame) and link.injected.lost_out == before))
            return True

        link.send = watched
        for _ in range(500):
            array.sweep()
    counters = array.counters
    arrived = sum(through for _, through in per_answer)
    answered = len(per_answer) - counters.unanswered
    whole_answers_lost = arrived - answered
    masks = [(CATALOGUE.decode(frame), through) for frame, through in per_answer]
    assert all(isinstance(message, Trigger) for message, _ in masks)
    # What no host can see is an answer of which nothing came: it looks like a trigger that was lost.
    lost_unseen = link.injected.lost_in - heartbeats - counters.lost
    assert 0 <= lost_unseen <= 10 * whole_answers_lost
    assert whole_answers_lost <= 10
    assert counters.lost > 1000


def test_one_doubled_frame_is_counted_once():
    seen = []

    def double(frame):
        seen.append(frame)
        return [frame, frame] if is_(frame, Function.READING) and len(seen) < 4 else [frame]

    rig = Rig(lambda link: Meddler(link, double))
    with rig.array as array:
        array.sweep()
    assert array.counters.duplicated == 1
    assert array.counters.failed == 0


def test_swapped_frames_are_counted():
    held = []

    def swap(frame):
        if is_(frame, Function.READING) and not held:
            held.append(frame)
            return []
        if len(held) == 1:
            held.append(None)
            return [frame, held[0]]
        return [frame]

    rig = Rig(lambda link: Meddler(link, swap))
    with rig.array as array:
        echoes = array.sweep()
    assert array.counters.reordered == 1
    assert [echo.status for echo in echoes] == [Status.OK] * 4


def test_the_answer_of_an_earlier_sweep_is_late_and_unused():
    kept = []

    def hold_first(frame):
        if is_(frame, Function.READING) and frame.identifier & 15 == 2 and not kept:
            kept.append(frame)
            return []
        if is_(frame, Function.ACKNOWLEDGE) and len(kept) == 1 and frame.data[0] != kept[0].data[0]:
            kept.append(None)
            return [kept[0], frame]
        return [frame]

    rig = Rig(lambda link: Meddler(link, hold_first))
    with rig.array as array:
        array.sweep()
        second = array.sweep()
    assert [echo.range_m for echo in second] == [sensor.last.range_m for sensor in rig.sensors]
    # The frame that was held back, and the second half of the repeated answer, whose first half made the sweep whole.
    assert array.counters.late == 2
    assert array.counters.retriggers == 1


def test_an_answer_to_a_sweep_that_never_was_is_unsolicited():
    def forge(frame):
        bits = int.from_bytes(frame.data, "little")
        other = (bits & ~0xFF) | ((bits + 100) & 0xFF)
        return [CanFrame(frame.identifier, other.to_bytes(8, "little"))] if is_(frame, Function.READING) else [frame]

    rig = Rig(lambda link: Meddler(link, forge))
    with rig.array as array:
        echoes = array.sweep()
    assert all(echo.status is Status.FAULT and math.isnan(echo.range_m) for echo in echoes)
    assert array.counters.unsolicited > 4


@pytest.mark.parametrize(
    ("damage", "counter"),
    [
        (lambda data: data + b"\0", "wrong_length"),
        (lambda data: data[:7], "wrong_length"),
        (lambda data: data[:3] + b"\xff\xff\xff" + data[6:], "contradictory"),
        (lambda data: data[:2] + bytes([data[2] | 7]) + data[3:], "unknown_word"),
    ],
    ids=["nine bytes", "seven bytes", "sentinel", "unknown status"],
)
def test_damaged_frames_are_refused_and_asked_again(damage, counter):
    hits = []

    def meddle(frame):
        if is_(frame, Function.READING) and len(hits) < 3:
            hits.append(frame)
            return [CanFrame(frame.identifier, damage(frame.data))]
        return [frame]

    rig = Rig(lambda link: Meddler(link, meddle))
    with rig.array as array:
        echoes = array.sweep()
    assert [echo.range_m for echo in echoes] == [sensor.last.range_m for sensor in rig.sensors]
    assert getattr(array.counters, counter) == 3
    assert array.counters.retriggers >= 1


def test_a_node_that_is_gone_is_given_up_in_bounded_time():
    dead = []
    rig = Rig(lambda link: Meddler(link, lambda frame: [] if dead else [frame]))
    with rig.array as array:
        array.sweep()
        dead.append(True)
        began_s = rig.direct.monotonic_s()
        echoes = array.sweep()
        assert rig.direct.monotonic_s() - began_s <= QUICK.silence_limit_s + 1.0
        assert all(echo.status is Status.FAULT and math.isnan(echo.range_m) for echo in echoes)
        array.sweep()
        with pytest.raises(DeviceError, match="sensor node 1"):
            array.sweep()
    assert array.counters.failed == 12
    assert array.counters.unanswered >= 3


def test_a_node_that_never_was_is_an_error_at_the_start():
    rig = Rig(lambda link: Meddler(link, lambda frame: []))
    with pytest.raises(DeviceError, match="no heartbeat within"), rig.array:
        pass


def test_one_dead_sensor_is_a_fault_and_the_others_answer():
    class Dead(Ranger):
        def fire(self):
            raise OSError("no such wire")

    clock = SteppedClock()
    rig = Rig(sensors=[Ranger(clock), Dead(clock), Ranger(clock), Ranger(clock)])
    with rig.array as array:
        for _ in range(5):
            echoes = array.sweep()
    assert [echo.status for echo in echoes] == [Status.OK, Status.FAULT, Status.OK, Status.OK]
    assert array.counters.node_faults == 5
    assert array.counters.failed == 0


@pytest.mark.parametrize(
    "echo",
    [
        Echo(200.0, Status.OK, 0.0, 0.5, 0.001, 8),
        Echo(math.nan, Status.OK, 0.0, 0.5, 0.001, 8),
        Echo(0.5, Status.OK, math.nan, 0.5, 0.001, 8),
        Echo(0.5, Status.OK, 0.0, 0.5, 0.4, 8),
        Echo(0.5, Status.OK, 0.0, -1.0, 0.001, 8),
    ],
)
def test_what_a_driver_makes_up_and_the_bus_cannot_carry_is_a_fault(echo):
    class Wild(Ranger):
        def fire(self):
            return Echo(echo.range_m, echo.status, echo.t_s + self.clock.now_s(), echo.amplitude, echo.spread_m, 8)

    rig = Rig(sensors=[Wild(None)] + [Ranger(None) for _ in range(3)])
    with rig.array as array:
        echoes = array.sweep()
    assert [answer.status for answer in echoes] == [Status.FAULT, Status.OK, Status.OK, Status.OK]
    assert array.counters.node_faults == 1


@pytest.mark.parametrize(
    ("status", "range_m"), [(Status.NO_ECHO, math.inf), (Status.TOO_CLOSE, -math.inf), (Status.FAULT, math.nan)]
)
def test_no_number_arrives_as_what_it_is(status, range_m):
    class Blind(Ranger):
        def fire(self):
            return Echo(range_m, status, self.clock.now_s(), count=0)

    rig = Rig(sensors=[Blind(None) for _ in range(4)])
    with rig.array as array:
        for _ in range(5):
            echoes = array.sweep()
    for echo in echoes:
        assert echo.status is status
        assert math.isnan(echo.range_m) if math.isnan(range_m) else echo.range_m == range_m


def test_a_node_that_restarts_in_the_middle_of_a_sweep_fires_again():
    rig = Rig()
    restarted = []

    class Restarting(DirectLink):
        def receive(self, timeout_s):
            arrival = super().receive(timeout_s)
            if arrival is not None and is_(arrival.frame, Function.ECHO) and not restarted:
                restarted.append(True)
                self._arrivals.clear()
                self._responder = Responder(rig.sensors, rig.clock, NodeIdentity(session=2), CATALOGUE)
            return arrival

    direct = Restarting(rig.node, rig.clock)
    array = CanArray(FIXTURE, Parameters(timeouts=QUICK), direct, rig.clock, rig.tally, direct.monotonic_s)
    with array:
        echoes = array.sweep()
    assert [echo.range_m for echo in echoes] == [sensor.last.range_m for sensor in rig.sensors]
    assert (array.counters.restarts, array.counters.fired_again, array.counters.failed) == (1, 1, 0)


def test_kit_settings_are_sent_again_after_a_restart():
    told = []
    rig = Rig(configure=lambda sensor, settings: told.append((sensor, settings)))
    settings = KitMessage(frequency_hz=50_000, pings=4)
    with rig.array as array:
        array.configure(settings)
        assert told == [(sensor, settings) for sensor in range(4)]
        array.configure(settings, sensor=2)
        told.clear()
        rig.direct._responder = Responder(
            rig.sensors,
            rig.clock,
            NodeIdentity(session=9),
            CATALOGUE,
            NodeAbilities(configure=lambda sensor, settings: told.append((sensor, settings))),
        )
        echoes = array.sweep()
        assert all(echo.status is Status.OK for echo in echoes)
        assert told == [(sensor, settings) for sensor in (0, 1, 2, 3, 2)]


def test_refused_settings_are_an_error():
    rig = Rig()
    with rig.array as array, pytest.raises(DeviceError, match="refuses"):
        array.configure(KitMessage())


class TwoNodes(DirectLink):
    """A second node with the same id hears every trigger, too."""

    def __init__(self, first, second, clock):
        super().__init__(first, clock)
        self.second, self.both, self.behind = second, False, False

    def send(self, frame):
        if self.both or not isinstance(CATALOGUE.decode(frame), Query):
            theirs = [Arrival(answer, self._clock.now_s()) for answer in self.second.answer(frame)]
            super().send(frame)
            if self.behind:
                self._arrivals.extend(theirs)
                return True
            ours = [self._arrivals.pop() for _ in theirs][::-1]
            for pair in zip(ours, theirs, strict=True):
                self._arrivals.extend(pair)
            return True
        return super().send(frame)


def two_nodes(uid, session):
    rig = Rig()
    others = [Ranger(rig.clock) for _ in range(4)]
    second = Responder(others, rig.clock, NodeIdentity(uid=uid, session=session), CATALOGUE)
    link = TwoNodes(rig.node, second, rig.clock)
    array = CanArray(FIXTURE, Parameters(timeouts=QUICK), link, rig.clock, rig.tally, link.monotonic_s)
    return link, array


def test_two_boards_with_one_id_are_found_at_the_roll_call():
    link, array = two_nodes(uid=2, session=2)
    link.both = True
    with pytest.raises(DeviceError, match=r"two nodes answer .*1, 2"), array:
        pass


@pytest.mark.parametrize("session", [1, 2], ids=["same session", "other session"])
def test_two_nodes_with_one_id_give_no_number(session):
    _, array = two_nodes(uid=2, session=session)
    with array:
        for _ in range(2):
            with pytest.raises(DeviceError, match="two nodes answer"):
                array.sweep()
    assert array.counters.conflicts > 0


def test_a_slower_second_node_is_found_one_sweep_later():
    link, array = two_nodes(uid=2, session=2)
    link.behind = True
    with array:
        array.sweep()
        with pytest.raises(DeviceError, match="two nodes answer"):
            array.sweep()


def test_an_answer_that_is_too_fast_to_be_true_is_refused():
    class Hasty(Ranger):
        def fire(self):
            return Echo(3.5, Status.OK, self.clock.now_s(), 0.5, 0.0003, 8)

    rig = Rig(sensors=[Hasty(None) for _ in range(4)])
    with rig.array as array:
        echoes = array.sweep()
    # 3.5 m is 20 ms of flight; the clock has not moved.
    assert all(echo.status is Status.FAULT for echo in echoes)
    assert array.counters.too_fast == 12


def test_light_is_never_too_fast():
    spec = SensorSpec("tof", "optical", 0.05, 4.0, 0.3, 0.001)

    class Light(Ranger):
        def fire(self):
            return Echo(3.5, Status.OK, self.clock.now_s(), 0.5, 0.0003, 8)

    rig = Rig(sensors=[Light(None) for _ in range(4)])
    fixture = Fixture(np.stack([np.eye(4)] * 4), (spec,) * 4)
    array = CanArray(fixture, Parameters(), rig.direct, rig.clock, rig.tally, rig.direct.monotonic_s)
    with array:
        assert [echo.range_m for echo in array.sweep()] == [3.5] * 4


def test_a_sensor_that_the_node_does_not_have_is_a_fault_at_once():
    rig = Rig(sensors=[Ranger(None) for _ in range(3)])
    with rig.array as array:
        echoes = array.sweep()
    assert [echo.status for echo in echoes] == [Status.OK, Status.OK, Status.OK, Status.FAULT]
    assert (array.counters.retriggers, array.counters.failed) == (0, 1)


def test_a_babbling_node_does_not_hang_the_host():
    rig = Rig()

    class Babbler(DirectLink):
        """Always has one more copy of the first reading, and nothing else."""

        def receive(self, timeout_s):
            self._waited_s += 1e-4
            arrival = super().receive(timeout_s)
            if arrival is not None and is_(arrival.frame, Function.READING):
                self._arrivals.clear()
                self._arrivals.append(arrival)
            return arrival

    link = Babbler(rig.node, rig.clock)
    array = CanArray(FIXTURE, Parameters(timeouts=QUICK), link, rig.clock, rig.tally, link.monotonic_s)
    with array:
        began_s = link.monotonic_s()
        echoes = array.sweep()
        assert link.monotonic_s() - began_s <= QUICK.silence_limit_s + 1.0
    assert all(echo.status is Status.FAULT for echo in echoes)
    assert array.counters.duplicated > 100


def test_random_frames_between_the_answers_change_nothing():
    generator = np.random.default_rng(11)

    def noise(frame):
        node_part = int(generator.choice([1, 2])) << 4 | int(generator.integers(16))
        function = int(generator.choice([1, 2, 3, 6, 7, 8, 9, 15]))
        data = generator.integers(0, 256, int(generator.integers(0, 12)), dtype=np.uint8).tobytes()
        if function == Function.ACKNOWLEDGE:
            data = data[:7]
        return [CanFrame(function << 7 | node_part, data), frame]

    rig = Rig(lambda link: Meddler(link, noise))
    with rig.array as array:
        for _ in range(100):
            echoes = array.sweep()
            assert [echo.range_m for echo in echoes] == [sensor.last.range_m for sensor in rig.sensors]
    assert array.counters.foreign > 100
    assert array.counters.wrong_length > 100


def test_forged_acknowledgements_do_not_complete_a_sweep():
    def forge(frame):
        message = CATALOGUE.decode(frame)
        if isinstance(message, Acknowledge) and message.result is Result.ACCEPTED:
            return [frame, CATALOGUE.encode(message._replace(result=Result.DONE))]
        return [frame]

    rig = Rig(lambda link: Meddler(link, forge))
    with rig.array as array:
        echoes = array.sweep()
    assert [echo.range_m for echo in echoes] == [sensor.last.range_m for sensor in rig.sensors]


def test_frames_of_another_node_are_foreign():
    def other(frame):
        message = CATALOGUE.decode(frame)
        if isinstance(message, Reading | EchoDetail | Heartbeat):
            return [CATALOGUE.encode(message._replace(node=2)), frame]
        return [frame]

    rig = Rig(lambda link: Meddler(link, other))
    with rig.array as array:
        echoes = array.sweep()
    assert [echo.range_m for echo in echoes] == [sensor.last.range_m for sensor in rig.sensors]
    assert array.counters.foreign == 9
    assert array.heartbeat == Heartbeat(1, NodeState.STARTING, 1, 0, 0, 1, 1, 1)


def test_sequence_numbers_go_round_and_memory_stays():
    rig = Rig()
    with rig.array as array:
        for _ in range(600):
            assert all(echo.status is Status.OK for echo in array.sweep())
        assert len(array._client._past) <= 9
    assert array.counters.late == array.counters.duplicated == array.counters.lost == 0


def test_a_bad_frame_is_reported_by_the_node():
    rig = Rig()
    frames = list(rig.node.answer(CanFrame(identifier(Function.TRIGGER, 1), b"\0\0\0")))
    assert len(frames) == 1
    assert frames[0].identifier >> 7 == Function.FAULT
    assert list(rig.node.answer(CanFrame(identifier(Function.TRIGGER, 2), b"\0\0\0"))) == []
