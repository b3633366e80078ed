"""What the states of a bridge say of its clock, in a time of the test: offset, drift, a simulation, a lie."""

import math
import re

import numpy as np
import pytest

from surfuse.bridge.clock import DRIFT_LIMIT, JUMP_LIMIT_S, ClockWatch
from surfuse.bridge.messages import Question
from surfuse.errors import SafetyStopError

OFFSET_S = 1000.0


def told(watch, bridge_s, seconds, every_s=0.1, began_s=0.0, seed=5):
    """States of a bridge whose clock shows `bridge_s(host)`, a sweep before each; the end of the host's time."""
    rng = np.random.default_rng(seed)
    now_s = began_s
    while now_s < began_s + seconds:
        there_s, back_s = rng.uniform(1e-4, 2e-3, 2)
        watch.asked(Question.SWEEP)
        watch.asked(Question.STATE)
        watch.take(now_s, now_s + there_s + back_s, bridge_s(now_s + there_s))
        now_s += every_s
    return now_s


def test_nothing_is_known_before_the_first_state():
    assert math.isinf(ClockWatch("here").findings(0.0).offset.uncertainty_s)


@pytest.mark.parametrize("drift", [0.0, 5e-5, -1.5e-4])
def test_offset_and_drift_are_as_good_as_they_say_also_after_hours(drift):
    watch, now_s = ClockWatch("here"), 0.0
    for seconds in (10.0, 600.0, 7200.0):
        now_s = told(watch, lambda host_s: (1.0 + drift) * host_s - OFFSET_S, seconds, every_s=2.0, began_s=now_s)
        found = watch.findings(now_s)
        truth_s = now_s - ((1.0 + drift) * now_s - OFFSET_S)
        assert abs(found.offset.host_minus_bridge_s - truth_s) <= found.offset.uncertainty_s < 4e-3
        assert abs(found.drift - drift) <= found.drift_uncertainty
        assert found.keeps_pace
    assert found.drift_uncertainty < 1e-6
    assert re.search(r"agree to [\d.]+ ms; drift [-+].* ppm, at most 0\.\d+ off", found.in_words())


def test_what_is_not_measured_gets_worse_by_the_drift_that_is_possible():
    watch = ClockWatch("here")
    now_s = told(watch, lambda host_s: host_s, 1.0)
    later = watch.findings(now_s + 100.0).offset.uncertainty_s
    assert later - watch.findings(now_s).offset.uncertainty_s == pytest.approx(100.0 * DRIFT_LIMIT)


@pytest.mark.parametrize(("jump_s", "word"), [(3.0, "forward"), (-3.0, "back")])
def test_a_clock_that_kept_pace_and_jumps_lies(jump_s, word):
    watch = ClockWatch("here")
    now_s = told(watch, lambda host_s: host_s, 6.0)
    with pytest.raises(SafetyStopError, match=rf"gone {word} by [23]\.\d+ s against it, at most 0.5 s"):
        told(watch, lambda host_s: host_s + jump_s, 0.1, began_s=now_s)


def test_a_clock_that_kept_pace_and_stops_lies():
    watch = ClockWatch("here")
    now_s = told(watch, lambda host_s: host_s, 6.0)
    with pytest.raises(SafetyStopError, match="gone back by"):
        told(watch, lambda host_s: now_s, 2.0 * JUMP_LIMIT_S, began_s=now_s)


@pytest.mark.parametrize("pace", [0.0, 0.3, 20.0])
def test_the_time_of_a_simulation_is_no_lie(pace):
    watch = ClockWatch("here")
    now_s = told(watch, lambda host_s: pace * host_s, 60.0)
    found = watch.findings(now_s)
    assert not found.keeps_pace
    assert "do not keep pace" in found.in_words()


def test_what_never_happened_before_may_take_simulated_time():
    watch = ClockWatch("here")
    now_s = told(watch, lambda host_s: host_s, 6.0)
    watch.asked(Question.MOVE)
    told(watch, lambda host_s: host_s + 4.0, 1.0, began_s=now_s)
    assert not watch.findings(now_s).keeps_pace


def test_states_that_are_told_a_little_late_make_the_clocks_less_sure_and_stop_nothing():
    watch = ClockWatch("here")
    now_s = told(watch, lambda host_s: host_s, 6.0)
    now_s = told(watch, lambda host_s: host_s - 0.2, 0.1, began_s=now_s)
    assert watch.findings(now_s).offset.uncertainty_s > 0.09


def test_a_new_connection_counts_anew():
    watch = ClockWatch("here")
    now_s = told(watch, lambda host_s: host_s, 6.0)
    watch.new_connection()
    assert math.isinf(watch.findings(now_s).offset.uncertainty_s)
    now_s = told(watch, lambda host_s: host_s - 500.0, 1.0, began_s=now_s)
    assert watch.findings(now_s).offset.host_minus_bridge_s == pytest.approx(500.0, abs=1e-3)
