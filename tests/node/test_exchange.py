"""The frames of one sweep: when an answer can be true, and what of it counts as lost."""

import math

import pytest

from surfuse.node.counters import Tally
from surfuse.node.exchange import Exchange
from surfuse.node.messages import Acknowledge, EchoDetail, Reading, Result, Subject
from surfuse.records import SensorSpec, Status

SONAR = SensorSpec("us", "ultrasonic", 0.3, 4.0, 0.3, 0.001)
LIGHT = SensorSpec("tof", "optical", 0.05, 4.0, 0.3, 0.001)
SENT_S = 10.0


def exchange(spec=SONAR, sensors=1, **more):
    tally = Tally()
    found = Exchange(1, 7, 0, dict.fromkeys(range(sensors), spec), tally, **more)
    found.trigger(SENT_S)
    return found, tally


def reading(range_m, sensor=0, attempt=0, status=Status.OK):
    return Reading(1, sensor, 7, 1, status, 5, range_m, 0.001, attempt)


def detail(sensor=0, time_us=0, attempt=0):
    return EchoDetail(1, sensor, 7, 1, time_us, attempt, 0, 0.5)


def acknowledged(result, sensors=1, attempt=0):
    return Acknowledge(1, 7, 1, Subject.TRIGGER, result, attempt, sensors)


@pytest.mark.parametrize("emitted_s", [0.0, 0.2])
@pytest.mark.parametrize(("share", "status"), [(0.5, Status.FAULT), (0.9, Status.FAULT), (1.05, Status.OK)])
def test_sound_needs_its_time_there_and_back_after_its_emission(share, status, emitted_s):
    flight_s = 2.0 * 3.5 / 400.0
    one, tally = exchange(wave_speed_max_m_s=400.0)
    arrival_s = SENT_S + emitted_s + share * flight_s
    one.accept(reading(3.5), arrival_s)
    one.accept(detail(time_us=round(1e6 * emitted_s)), arrival_s)
    echo = one.echo(0)
    assert echo.status is status
    assert tally.snapshot().too_fast == (status is Status.FAULT)
    if status is Status.OK:
        assert (echo.range_m, echo.t_s) == (3.5, pytest.approx(SENT_S + emitted_s))
    else:
        assert math.isnan(echo.range_m)


@pytest.mark.parametrize(
    ("spec", "answer"),
    [(LIGHT, reading(3.5)), (SONAR, reading(math.inf, status=Status.NO_ECHO))],
    ids=["light", "no echo"],
)
def test_what_has_no_flight_of_sound_needs_no_time(spec, answer):
    one, tally = exchange(spec)
    one.accept(answer, SENT_S)
    one.accept(detail(), SENT_S)
    assert one.echo(0).status is answer.status
    assert tally.snapshot().too_fast == 0


def test_lost_is_what_a_begun_answer_lacks():
    one, tally = exchange(sensors=3)
    one.accept(acknowledged(Result.ACCEPTED, 0b111), SENT_S)
    one.accept(reading(0.5), SENT_S + 0.1)
    one.accept(detail(), SENT_S + 0.1)
    one.close()
    # Of a whole answer: accepted, two frames a sensor, done.
    assert tally.snapshot().lost == (1 + 2 * 3 + 1) - 3
    assert tally.snapshot().unanswered == 0


def test_of_a_trigger_that_the_node_found_stale_or_never_heard_nothing_is_lost():
    stale, told = exchange(sensors=3)
    stale.accept(acknowledged(Result.STALE, 0b111), SENT_S)
    stale.close()
    assert (told.snapshot().lost, told.snapshot().unanswered) == (0, 0)
    silent, told = exchange(sensors=3)
    silent.close()
    assert (told.snapshot().lost, told.snapshot().unanswered) == (0, 1)


def test_the_frames_of_a_refused_sensor_are_not_lost():
    one, tally = exchange(sensors=2)
    for message in (acknowledged(Result.REFUSED, 0b10), acknowledged(Result.ACCEPTED, 0b01), reading(0.5), detail()):
        one.accept(message, SENT_S + 0.1)
    one.accept(acknowledged(Result.DONE, 0b01), SENT_S + 0.1)
    assert one.missing == 0
    assert [one.echo(sensor).status for sensor in (0, 1)] == [Status.OK, Status.FAULT]
    one.close()
    assert tally.snapshot().lost == 0


def test_the_next_trigger_asks_for_what_is_missing_only():
    one, _ = exchange(sensors=3)
    one.accept(reading(0.5, sensor=1), SENT_S + 0.1)
    one.accept(detail(sensor=1), SENT_S + 0.1)
    one.accept(reading(0.5, sensor=2), SENT_S + 0.1)
    again = one.trigger(SENT_S + 0.2)
    assert (again.sensors, again.attempt, again.sequence) == (0b101, 1, 7)


def test_two_values_for_one_reading_contradict_each_other_and_the_same_one_again_does_not():
    one, tally = exchange()
    one.accept(reading(0.5), SENT_S + 0.1)
    one.accept(reading(0.5), SENT_S + 0.1)
    assert not one.contradicted
    assert tally.snapshot().duplicated == 1
    one.accept(reading(0.6), SENT_S + 0.1)
    assert one.contradicted
