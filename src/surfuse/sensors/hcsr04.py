"""HC-SR04 on two pins through gpiozero: a pulse of 10 us asks, the length of the echo pulse answers.

Source: HC-SR04 data sheet: 8 cycles of 40 kHz, 2 to 400 cm, no echo makes a pulse of about 38 ms, at least 60 ms
between triggers. The usual `us / 58 = cm` is the speed of sound at 23 degrees Celsius; here the air sets it.
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np

from surfuse.errors import ConfigError, DeviceError
from surfuse.extras import needed_by
from surfuse.interfaces import GIVEN_BY_RIG, STANDING_ALONE, SensorSurroundings
from surfuse.records import Echo, SensorSpec, Status

if TYPE_CHECKING:
    from gpiozero import DigitalInputDevice, DigitalOutputDevice  # type: ignore[import-untyped,unused-ignore]

SUMMARY = "ultrasonic ranger HC-SR04, on two pins"
NEEDS = ("gpiozero",)
_PULSE_S = 10e-6
_NO_ECHO_S = 0.038
_CYCLE_S = 0.060
_WAIT_S = 0.2
SPEC = SensorSpec(
    name="hc-sr04",
    kind="ultrasonic",
    range_min_m=0.02,
    range_max_m=4.0,
    beam_full_angle_rad=float(np.radians(15.0)),
    sigma_m=0.003,
    firing_time_s=_CYCLE_S,
    frequency_hz=40_000.0,
)


@dataclass(frozen=True)
class Parameters:
    """Its pins and the air.

    trigger_pin, echo_pin : names as gpiozero has them, `GPIO23` or `23`. The echo of a 5 V module needs a divider.
    air_temperature_c : sets the speed of sound, -40 to 60.
    """

    trigger_pin: str
    echo_pin: str
    air_temperature_c: float = 20.0
    surroundings: SensorSurroundings = field(default=STANDING_ALONE, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not -40.0 <= self.air_temperature_c <= 60.0:
            raise ConfigError(f"air_temperature_c = {self.air_temperature_c}", cure="give -40 to 60")
        if self.trigger_pin == self.echo_pin:
            raise ConfigError(f"trigger_pin = echo_pin = {self.echo_pin}", cure="give two different pins")


class HcSr04:
    """One HC-SR04."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters, self._clock = parameters, parameters.surroundings.clock
        self._spec = parameters.surroundings.known(SPEC)
        # Dry air, ideal gas: 331.3 m/s at 0 degrees Celsius.
        self._speed_m_s = 331.3 * math.sqrt(1.0 + parameters.air_temperature_c / 273.15)
        self._trigger: DigitalOutputDevice | None = None
        self._echo: DigitalInputDevice | None = None
        self._edges: list[tuple[float, bool]] = []
        self._changed = threading.Condition()
        self._last_s = -math.inf

    def __enter__(self) -> Self:
        pins = self._parameters
        with needed_by("a sensor on pins"):
            from gpiozero import DigitalInputDevice, DigitalOutputDevice, GPIOZeroError
        try:
            self._trigger = DigitalOutputDevice(pins.trigger_pin)
            self._echo = DigitalInputDevice(pins.echo_pin)
        except (GPIOZeroError, OSError, ValueError) as error:
            self.__exit__(None, None, None)
            cure = "check the pin names; on a board other than a Raspberry Pi gpiozero needs a pin factory"
            raise DeviceError(f"the pins cannot be used: {error}", cure=cure, where="hcsr04") from error
        self._echo.pin.edges = "both"
        self._echo.pin.bounce = None
        self._echo.pin.when_changed = self._take
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for device in (self._trigger, self._echo):
            if device is not None:
                device.close()
        self._trigger = self._echo = None

    @property
    def spec(self) -> SensorSpec:
        """What is known of the sensor."""
        return self._spec

    def fire(self) -> Echo:
        """One ping; a sensor that does not answer, or still answers the last one, is a fault.

        Raises
        ------
        DeviceError : the pins are not open.
        """
        if self._trigger is None or self._echo is None:
            raise DeviceError("the pins are not open", cure="use the sensor in a `with` block", where="hcsr04")
        time.sleep(max(0.0, self._last_s + _CYCLE_S - time.monotonic()))
        with self._changed:
            self._edges.clear()
        busy = bool(self._echo.pin.state)
        start_s, self._last_s = self._clock.now_s(), time.monotonic()
        if busy:
            return Echo(math.nan, Status.FAULT, start_s, count=0)
        self._trigger.on()
        time.sleep(_PULSE_S)
        self._trigger.off()
        with self._changed:
            whole = self._changed.wait_for(lambda: len(self._edges) >= 2, _WAIT_S)
            edges = list(self._edges)
        self._last_s = time.monotonic()
        if not whole or [state for _, state in edges] != [True, False]:
            return Echo(math.nan, Status.FAULT, start_s, count=0)
        return self._reading(self._seconds(edges[0][0], edges[1][0]), start_s)

    def _take(self, ticks: float, state: int) -> None:
        with self._changed:
            self._edges.append((ticks, bool(state)))
            self._changed.notify_all()

    def _seconds(self, rise: float, fall: float) -> float:
        if self._echo is None:
            return math.nan
        return float(self._echo.pin_factory.ticks_diff(fall, rise))

    def _reading(self, pulse_s: float, start_s: float) -> Echo:
        range_m = 0.5 * pulse_s * self._speed_m_s
        if not pulse_s > 0.0:
            return Echo(math.nan, Status.FAULT, start_s, count=0)
        if pulse_s >= _NO_ECHO_S or range_m > self._spec.range_max_m:
            return Echo(math.inf, Status.NO_ECHO, start_s, count=0)
        if range_m < self._spec.range_min_m:
            return Echo(-math.inf, Status.TOO_CLOSE, start_s, count=0)
        return Echo(range_m, Status.OK, start_s)


def create(parameters: Parameters) -> HcSr04:
    """An HC-SR04 on two pins of this machine."""
    return HcSr04(parameters)
