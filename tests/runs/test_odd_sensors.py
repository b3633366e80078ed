"""Dead and stuck sensors are named; sensors that work, and scans too short to tell, are not."""

from __future__ import annotations

import numpy as np
import pytest

from surfuse.records import SensorSpec, Status, Sweep, readings_from_sweeps
from surfuse.runs.odd_sensors import LEAST_READINGS, HeardOfSensors, odd_sensors

NOTHING = {Status.NO_ECHO: np.inf, Status.TOO_CLOSE: -np.inf, Status.FAULT: np.nan}
STEP_M = 0.02


def specs(*names):
    return tuple(
        SensorSpec(
            name=name,
            kind="laser",
            beam_full_angle_rad=0.02,
            range_min_m=0.05,
            range_max_m=2.0,
            sigma_m=0.001,
        )
        for name in names
    )


def sweeps_of(*columns, step_m=STEP_M):
    """Sweeps of one column for each sensor: ranges in m, a status where there is no echo, None where it is missing."""
    for stop, answers in enumerate(zip(*columns, strict=True)):
        there = [number for number, answer in enumerate(answers) if answer is not None]
        told = [answers[number] for number in there]
        grip = np.eye(4)
        grip[0, 3] = step_m * stop
        yield Sweep(
            t_s=np.full(len(there), float(stop)),
            sensor=np.array(there, dtype=np.int64),
            position_m=np.tile(grip[:3, 3], (len(there), 1)),
            axis=np.tile([0.0, 0.0, 1.0], (len(there), 1)),
            range_m=np.array([NOTHING.get(one, one) for one in told], dtype=np.float64),
            status=np.array([int(one) if isinstance(one, Status) else 0 for one in told], dtype=np.int64),
            stop=stop,
            row=0,
            world_from_grip=grip,
            joints_rad=np.zeros(0),
        )


def told(*columns, step_m=STEP_M):
    found = specs(*(f"us{number}" for number in range(len(columns))))
    sweeps = list(sweeps_of(*columns, step_m=step_m))
    heard = HeardOfSensors(found)
    for sweep in sweeps:
        heard.take(sweep)
    assert odd_sensors(readings_from_sweeps(found, sweeps)) == heard.sentences()
    return heard.sentences()


def varying(count=15):
    return list(0.4 + 0.001 * np.arange(count))


@pytest.mark.parametrize(
    ("status", "words"),
    [(Status.NO_ECHO, "no echo 15"), (Status.FAULT, "fault or no answer 15"), (Status.TOO_CLOSE, "too close 15")],
)
def test_a_sensor_without_any_echo_is_named_with_what_it_said(status, words):
    (text,) = told([status] * 15, varying())
    assert "'us0' gave no echo in 15 of 15 readings" in text
    assert words in text


def test_a_sensor_that_never_answers_is_named():
    (text,) = told(varying(), [None] * 15)
    assert "'us1' gave no reading at all, 15 were due" in text


def test_a_lone_sensor_that_never_answers_is_named():
    (text,) = told([None] * 15)
    assert "'us0' gave no reading at all, 15 were due" in text


def test_answers_that_are_missing_count_with_those_without_echo():
    (text,) = told([Status.NO_ECHO] * 5 + [None] * 10, varying())
    assert "no echo 5, missing 10" in text


def test_one_echo_is_a_sign_of_life():
    assert told([Status.FAULT] * 14 + [0.4], varying()) == ()


def test_a_sensor_that_repeats_itself_among_others_that_vary_is_stuck():
    (text,) = told(varying(), [0.4123] * 15)
    assert "'us1' answered 412.3 mm in 15 of 15 echoes" in text
    assert "it is stuck" in text


def test_a_difference_of_a_micrometre_is_no_stuck_sensor():
    assert told(varying(), [0.4123] * 14 + [0.412301]) == ()


def test_a_plate_that_faces_all_sensors_makes_none_of_them_stuck():
    assert told([0.4] * 15, [0.4] * 15) == ()


def test_a_lone_sensor_that_repeats_itself_may_be_right():
    (text,) = told([0.4123] * 15)
    assert "right for a flat part" in text
    assert "it is stuck" not in text


def test_a_sensor_that_stays_where_it_is_may_repeat_itself():
    assert told([0.4] * 15, varying(), step_m=0.0) == ()


def test_a_short_scan_tells_nothing():
    short = LEAST_READINGS - 1
    assert told([Status.NO_ECHO] * short, [None] * short, [0.4] * short, varying(short)) == ()
    enough = LEAST_READINGS
    assert len(told([Status.NO_ECHO] * enough, [None] * enough, [0.4] * enough, varying(enough))) == 3


def test_many_alike_are_told_in_few_words():
    sentences = told(varying(), *[[Status.NO_ECHO] * 15] * 20)
    assert len(sentences) == 7
    assert all(f"us{number}" in " ".join(sentences) for number in range(1, 21))
