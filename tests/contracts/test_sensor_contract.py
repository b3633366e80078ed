"""What every ranger does, whatever drives it: each against its stand-in, in front of a plate."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from plug_in_bench import SensorBench, TickingClock, nothing_opened, opened_bench

from surfuse import registry
from surfuse.errors import DeviceError
from surfuse.records import Echo, SensorSpec, Status

KINDS = {"ultrasonic", "laser", "infrared", "tof", "touch"}
SIGNS = {Status.NO_ECHO: math.inf, Status.TOO_CLOSE: -math.inf}


@pytest.fixture(params=registry.found("sensors").built_in)
def name(request) -> str:
    return request.param


@pytest.fixture
def bench(name, tmp_path) -> Iterator[SensorBench]:
    with opened_bench("sensors", name, tmp_path) as made:
        yield made


@pytest.fixture
def create(name):
    return registry.load("sensors", name).create


def assert_rep_117(echo: Echo) -> None:
    assert isinstance(echo, Echo)
    assert isinstance(echo.status, Status)
    if echo.status is Status.OK:
        assert math.isfinite(echo.range_m)
        assert echo.range_m > 0.0
        assert echo.count >= 1
    elif echo.status is Status.FAULT:
        assert math.isnan(echo.range_m)
    else:
        assert echo.range_m == SIGNS[echo.status]
    assert math.isfinite(echo.t_s)


def test_making_one_opens_nothing(bench, create):
    with nothing_opened():
        sensor = create(bench.parameters)
        assert isinstance(sensor.spec, SensorSpec)


def test_it_says_what_it_is_before_it_is_opened(bench, create):
    spec = create(bench.parameters).spec
    assert spec.kind in KINDS
    assert 0.0 <= spec.range_min_m < bench.range_m < spec.range_max_m
    assert spec.sigma_m > 0.0
    assert spec.firing_time_s > 0.0


def test_the_rig_may_know_it_better(bench, create):
    spec = replace(create(bench.parameters).spec, name="us7", sigma_m=0.0123)
    around = replace(bench.parameters.surroundings, spec=spec)
    assert create(replace(bench.parameters, surroundings=around)).spec == spec


def test_it_reads_the_plate(bench, create):
    with create(bench.parameters) as sensor:
        echoes = [sensor.fire() for _ in range(3)]
        spec = sensor.spec
    for echo in echoes:
        assert_rep_117(echo)
    heard = [echo.range_m for echo in echoes if echo.status is Status.OK]
    assert heard
    assert heard == pytest.approx([bench.range_m] * len(heard), abs=max(6 * spec.sigma_m, 1e-6))


def test_its_times_are_those_of_the_rig_and_go_forward(bench, create):
    clock = TickingClock()
    around = replace(bench.parameters.surroundings, clock=clock)
    with create(replace(bench.parameters, surroundings=around)) as sensor:
        times = [sensor.fire().t_s for _ in range(3)]
    assert times == sorted(times)
    assert len(set(times)) == 3
    assert bench.own_time or 100.0 < times[0] < times[-1] <= clock.now_s()


def test_closing_twice_is_fine_and_it_opens_again(bench, create):
    sensor = create(bench.parameters)
    with sensor:
        assert_rep_117(sensor.fire())
    sensor.__exit__(None, None, None)
    with sensor:
        assert_rep_117(sensor.fire())


def test_an_exception_inside_comes_out(bench, create):
    with pytest.raises(ZeroDivisionError), create(bench.parameters):
        raise ZeroDivisionError


def test_one_that_is_not_open_is_a_device_error(name, bench, create):
    if bench.always_open or name == "iio":
        return
    with pytest.raises(DeviceError, match="not open"):
        create(bench.parameters).fire()


def test_one_that_vanishes_is_a_device_error(bench, create):
    with create(bench.parameters) as sensor:
        sensor.fire()
        if bench.vanish is not None:
            bench.vanish()
            with pytest.raises(DeviceError) as caught:
                [sensor.fire() for _ in range(3)]
            assert caught.value.cure


def test_one_that_is_not_there_is_a_device_error(bench, create):
    if bench.vanish is None or bench.always_open:
        return
    bench.vanish()
    with pytest.raises(DeviceError), create(bench.parameters) as sensor:
        sensor.fire()
