"""The node's program on the in-process bus: signs of life, start and stop, and drivers that misbehave."""

import math
import threading
import time

import pytest

from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import MonotonicClock
from surfuse.node.averaging import average_echoes
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import BusCounters, BusEvent, Tally
from surfuse.node.firmware import Node, run
from surfuse.node.link import BusLink, BusParameters, open_bus
from surfuse.node.messages import (
    Acknowledge,
    CanFrame,
    FaultCode,
    FaultReport,
    Heartbeat,
    NodeState,
    Query,
    Reading,
    Result,
    Trigger,
)
from surfuse.node.responder import NodeAbilities, NodeIdentity, Responder
from surfuse.node.simultaneous_fire import ThreadedVolley
from surfuse.node.watch import LineVerdict, NodeWatch
from surfuse.records import Echo, SensorSpec, Status

CATALOGUE = Catalogue()
CLOCK = MonotonicClock()


class Ranger:
    spec = SensorSpec("stand-in", "ultrasonic", 0.3, 4.0, 0.3, 0.001)

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace): ...

    def fire(self):
        return Echo(math.inf, Status.NO_ECHO, CLOCK.now_s(), count=0)


def link(channel):
    return BusLink(lambda: open_bus(BusParameters(channel=channel)), CLOCK, Tally())


def responder(**more):
    return Responder([Ranger(), Ranger()], CLOCK, NodeIdentity(uid=77, session=5), CATALOGUE, NodeAbilities(**more))


def heard(end, number, limit_s=300.0):
    messages, give_up_s = [], time.monotonic() + limit_s
    while len(messages) < number and time.monotonic() < give_up_s:
        arrival = end.receive(0.1)
        if arrival is not None:
            messages.append(CATALOGUE.decode(arrival.frame))
    return messages


def test_a_node_shows_signs_of_life_by_itself_and_when_asked():
    with link("signs_of_life") as end, Node(responder(), link("signs_of_life"), heartbeat_s=0.05):
        first, second = heard(end, 2)
        assert first == second == Heartbeat(1, NodeState.STARTING, 5, 0, 0, 1, 1, 77)
    with link("asked") as end, Node(responder(), link("asked"), heartbeat_s=100.0):
        heard(end, 1)
        end.send(CATALOGUE.encode(Query(1, 0, 0)))
        (answer,) = heard(end, 1)
        assert isinstance(answer, Heartbeat)


def test_a_trigger_is_acknowledged_answered_and_done():
    with link("answered") as end, Node(responder(), link("answered"), heartbeat_s=100.0):
        heard(end, 1)
        end.send(CATALOGUE.encode(Trigger(1, 9, 0, 0b11, 4)))
        messages = heard(end, 6)
    results = [message.result for message in messages if isinstance(message, Acknowledge)]
    assert results == [Result.ACCEPTED, Result.DONE]
    assert [message.sensor for message in messages if isinstance(message, Reading)] == [0, 1]


def test_an_older_trigger_is_stale_and_a_new_host_is_not():
    node = responder()
    frames = list(node.answer(CATALOGUE.encode(Trigger(1, 9, 0, 1, 4))))
    assert len(frames) == 4
    (stale,) = node.answer(CATALOGUE.encode(Trigger(1, 8, 0, 1, 4)))
    assert CATALOGUE.decode(stale).result is Result.STALE
    assert len(list(node.answer(CATALOGUE.encode(Trigger(1, 8, 0, 1, 5))))) == 4


def test_a_repeated_trigger_does_not_fire_again():
    fired = []

    class Counting(Ranger):
        def fire(self):
            fired.append(1)
            return Echo(0.5, Status.OK, CLOCK.now_s(), 0.5, 0.001, 4)

    node = Responder([Counting()], CLOCK, NodeIdentity(), CATALOGUE)
    first = [CATALOGUE.decode(frame) for frame in node.answer(CATALOGUE.encode(Trigger(1, 3, 0, 1, 0)))]
    again = [CATALOGUE.decode(frame) for frame in node.answer(CATALOGUE.encode(Trigger(1, 3, 1, 1, 0)))]
    assert len(fired) == 1
    assert again[1] == first[1]._replace(attempt=1)
    assert again[2] == first[2]._replace(attempt=1, accepted=0)


def messages_of(node, *trigger):
    return [CATALOGUE.decode(frame) for frame in node.answer(CATALOGUE.encode(Trigger(*trigger)))]


def test_all_sensors_are_in_the_air_at_once_when_the_trigger_says_so():
    flying, most = set(), []
    everyone = threading.Barrier(2, timeout=300.0)

    class Meeting(Ranger):
        def fire(self):
            flying.add(self)
            everyone.wait()  # returns only when the other one is in the air too
            most.append(len(flying))
            everyone.wait()
            flying.discard(self)
            return Echo(0.5, Status.OK, CLOCK.now_s(), 0.5, 0.001, 4)

    sensors = [Meeting(), Meeting()]
    air = threading.Lock()
    node = Responder(
        sensors, CLOCK, NodeIdentity(), CATALOGUE, NodeAbilities(air=air, fire_together=ThreadedVolley(sensors))
    )
    told = messages_of(node, 1, 3, 0, 0b11, 0, 1)
    assert [message.result for message in told if isinstance(message, Acknowledge)] == [Result.ACCEPTED, Result.DONE]
    assert [message.status for message in told if isinstance(message, Reading)] == [Status.OK, Status.OK]
    assert most == [2, 2]
    # Asked again, the kept answers come; the same volley is never fired twice.
    again = messages_of(node, 1, 3, 1, 0b11, 0, 1)
    assert len(most) == 2
    assert sum(isinstance(message, Reading) for message in again) == 2


def test_a_sensor_that_fails_in_a_volley_is_a_fault_and_the_others_answer():
    class Broken(Ranger):
        def fire(self):
            raise OSError("unplugged")

    sensors = [Broken(), Ranger()]
    node = Responder(sensors, CLOCK, NodeIdentity(), CATALOGUE, NodeAbilities(fire_together=ThreadedVolley(sensors)))
    told = messages_of(node, 1, 3, 0, 0b11, 0, 1)
    assert [message.code for message in told if isinstance(message, FaultReport)] == [FaultCode.SENSOR_FAILED]
    assert [message.status for message in told if isinstance(message, Reading)] == [Status.FAULT, Status.NO_ECHO]


def test_several_volleys_are_averaged_for_each_sensor():
    sensors, volleys = [Ranger(), Ranger()], []

    def fire_together(numbers):
        volleys.append(list(numbers))
        return [Echo(0.5 + 0.1 * number + 0.01 * len(volleys), Status.OK, CLOCK.now_s()) for number in numbers]

    node = Responder(
        sensors,
        CLOCK,
        NodeIdentity(),
        CATALOGUE,
        NodeAbilities(pings=3, average=average_echoes, fire_together=fire_together),
    )
    told = messages_of(node, 1, 3, 0, 0b11, 0, 1)
    assert volleys == [[0, 1]] * 3
    ranges = [message.range_m for message in told if isinstance(message, Reading)]
    assert ranges == pytest.approx([0.52, 0.62])


def test_a_node_that_can_only_fire_in_turn_refuses_to_fire_together():
    told = messages_of(responder(), 1, 3, 0, 0b11, 0, 1)
    first = next(message for message in told if isinstance(message, Acknowledge))
    assert (first.result, first.sensors) == (Result.REFUSED, 0b11)
    assert not any(isinstance(message, Reading) for message in told)


def test_run_serves_until_it_is_told_to_stop():
    stop = threading.Event()
    with link("run") as end:
        thread = threading.Thread(target=lambda: run(responder(), link("run"), stop, heartbeat_s=0.05))
        thread.start()
        assert len(heard(end, 2)) == 2
        stop.set()
        thread.join(timeout=300.0)
        assert not thread.is_alive()


def test_an_adapter_that_is_not_there_ends_the_program_at_once():
    def absent():
        raise DeviceError("no adapter")

    with pytest.raises(DeviceError):
        run(responder(), BusLink(absent, CLOCK, Tally()), threading.Event())


def test_bad_frames_show_in_the_heartbeat():
    node = responder()
    for _ in range(300):
        list(node.answer(CanFrame(2 << 7 | 1 << 4, b"short")))
    assert CATALOGUE.decode(node.heartbeat()).rx_errors == 255


@pytest.mark.parametrize("change", [{"node": 0}, {"node": 8}, {"uid": -1}, {"session": 256}])
def test_an_identity_has_limits(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        NodeIdentity(**change)


def test_a_node_has_one_to_eight_sensors():
    for number in (0, 9):
        with pytest.raises(ConfigError, match=f"{number} sensors"):
            Responder([Ranger()] * number, CLOCK, NodeIdentity(), CATALOGUE)
    with pytest.raises(ConfigError, match="pings"):
        responder(pings=4)


def test_the_watch_tells_a_restart_from_a_rival():
    watch = NodeWatch()
    verdicts = [watch.see(session) for session in (4, 4, 9, 9, 4)]
    assert verdicts == [LineVerdict.SAME, LineVerdict.SAME, LineVerdict.RESTARTED, LineVerdict.SAME, LineVerdict.RIVAL]
    other = NodeWatch()
    assert other.hear(Heartbeat(1, NodeState.READY, 4, 0, 0, 1, 0, 1)) is LineVerdict.SAME
    assert other.hear(Heartbeat(1, NodeState.READY, 4, 0, 0, 1, 0, 2)) is LineVerdict.RIVAL


def test_every_event_is_a_counter_in_the_same_order():
    assert [event.value for event in BusEvent] == list(BusCounters.__dataclass_fields__)
    tally = Tally()
    tally.add(BusEvent.LOST, 3)
    assert tally.snapshot().lost == 3
