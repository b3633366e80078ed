"""HC-SR04 on gpiozero's mock pins: the pulse is the range."""

import math

import pytest

pytest.importorskip("gpiozero")

from gpiozero import Device
from gpiozero.pins.mock import MockFactory, MockPin, MockTriggerPin
from gpiozero.pins.pi import PiPin

from surfuse.errors import ConfigError, DeviceError
from surfuse.records import Status
from surfuse.sensors import hcsr04
from surfuse.sensors.hcsr04 import SPEC, Parameters, create

PINS = Parameters("GPIO23", "GPIO24")


@pytest.fixture
def factory():
    earlier = Device.pin_factory
    Device.pin_factory = MockFactory()
    yield Device.pin_factory
    Device.pin_factory.reset()
    Device.pin_factory = earlier


class InstantTrigger(MockPin):
    """Answers a trigger at once with edges at exact times; no thread, no sleeping."""

    edges = ()

    def _set_state(self, value):
        falls = self.state and not value
        super()._set_state(value)
        if falls:
            for ticks, state in self.edges:
                self.echo._state = bool(state)
                # A mock pin would stamp with the time of the machine.
                PiPin._call_when_changed(self.echo, ticks, state)


def wired(factory, edges):
    trigger = factory.pin("GPIO23", pin_class=InstantTrigger)
    trigger.echo, trigger.edges = factory.pin("GPIO24"), edges
    return trigger


def pulse(seconds, rise_s=1.0):
    return ((rise_s, 1), (rise_s + seconds, 0))


@pytest.mark.parametrize(
    ("seconds", "status"),
    [
        (2.5e-3, Status.OK),
        (1.2e-4, Status.OK),
        (1e-4, Status.TOO_CLOSE),
        (23.2e-3, Status.OK),
        (24e-3, Status.NO_ECHO),
        (38e-3, Status.NO_ECHO),
        (60e-3, Status.NO_ECHO),
    ],
)
def test_the_pulse_is_the_range(factory, seconds, status):
    wired(factory, pulse(seconds))
    with create(PINS) as sensor:
        echo = sensor.fire()
        assert sensor.spec is SPEC
    assert echo.status is status
    if status is Status.OK:
        assert echo.range_m == pytest.approx(0.5 * seconds * 343.2, rel=1e-3)
    else:
        assert echo.range_m == (math.inf if status is Status.NO_ECHO else -math.inf)


def test_the_rule_of_thumb_is_that_of_a_warm_room(factory):
    wired(factory, pulse(58e-6 * 100))
    with create(Parameters("GPIO23", "GPIO24", air_temperature_c=23.0)) as sensor:
        assert sensor.fire().range_m == pytest.approx(1.0, rel=2e-3)


def test_cold_air_is_slower(factory):
    wired(factory, pulse(5e-3))
    with create(Parameters("GPIO23", "GPIO24", air_temperature_c=0.0)) as sensor:
        assert sensor.fire().range_m == pytest.approx(0.5 * 5e-3 * 331.3)


@pytest.mark.parametrize(
    "edges",
    [(), ((1.0, 1),), ((1.0, 0), (1.1, 1)), ((1.0, 1), (1.001, 0), (1.002, 1)), pulse(0.0), pulse(-1e-3)],
    ids=["silent", "never ends", "upside down", "bounces", "no length", "backwards"],
)
def test_what_is_no_pulse_is_a_fault(factory, edges):
    wired(factory, edges)
    with create(PINS) as sensor:
        echo = sensor.fire()
    assert echo.status is Status.FAULT
    assert math.isnan(echo.range_m)


def test_a_sensor_that_still_answers_the_last_ping_is_a_fault(factory):
    wired(factory, ((1.0, 1),))
    with create(PINS) as sensor:
        sensor.fire()
        assert factory.pin("GPIO24").state
        assert sensor.fire().status is Status.FAULT


def test_the_sensor_of_gpiozero_itself(factory, monkeypatch):
    monkeypatch.setattr(hcsr04, "_WAIT_S", 300.0)  # its pulse is made by another thread, which a busy machine delays
    echo_pin = factory.pin("GPIO24")
    trigger = factory.pin("GPIO23", pin_class=MockTriggerPin, echo_pin=echo_pin, echo_time=0.004)
    with create(PINS) as sensor:
        echo = sensor.fire()
    trigger._echo_thread.join()
    # Its pulse is made by sleeping, so it is 4 ms or longer.
    assert echo.status is not Status.FAULT
    assert echo.range_m >= 0.5 * 0.004 * 343.0


def test_pins_that_do_not_exist_are_an_error(factory):
    with pytest.raises(DeviceError, match="pins cannot be used"), create(Parameters("GPIO23", "GPIO99")):
        pass


def test_a_sensor_outside_its_block_is_an_error():
    with pytest.raises(DeviceError, match="not open"):
        create(PINS).fire()


def test_parameters_have_limits():
    with pytest.raises(ConfigError, match="air_temperature_c"):
        Parameters("GPIO23", "GPIO24", air_temperature_c=200.0)
    with pytest.raises(ConfigError, match="two different pins"):
        Parameters("GPIO23", "GPIO23")
