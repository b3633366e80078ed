"""The ranging kit of the paper on a serial line (RS-232): its six parameters are set, then it answers triggers.

The kit counts times of flight; the driver makes ranges of them and averages the pings as the node does. Protocol:
docs/reference/kit_serial.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Literal, Self

import numpy as np

from surfuse.errors import ConfigError
from surfuse.interfaces import GIVEN_BY_RIG, STANDING_ALONE, SensorSurroundings
from surfuse.node.averaging import average_pings
from surfuse.node.messages import KitMessage, TriggerSource
from surfuse.physics.air import speed_of_sound
from surfuse.records import Echo, SensorSpec, Status
from surfuse.sensors.polaroid import SPEC as TRANSDUCER
from surfuse.sensors.polaroid import averaging_of, within_limits
from surfuse.serial_line.kit_line import KitLine, Ping
from surfuse.serial_line.text_line import TextLine

SUMMARY = "the paper's ranging kit: ultrasonic, six parameters, on a serial port"
NEEDS = ("serial",)
SPEC = replace(TRANSDUCER, name="ranging_kit")


@dataclass(frozen=True)
class Parameters:
    """Where the kit is, what is set on it, and how its times become ranges.

    port, baud_bps : the serial line; 8 data bits, no parity, 1 stop bit.
    transmit_hz : transmit frequency, an even number.
    cycles : pulse width, in cycles of that frequency.
    blanking_s : after the start of the pulse nothing is heard, in whole microseconds: the nearest range.
    gain_db : gain of the amplifier, in steps of 0.5 dB.
    sample_rate_hz : of the clock that counts the times of flight.
    trigger : "external": it fires when asked; "internal": it fires by itself, and tells the next pings when asked.
    pings : emissions averaged for one reading, 1 to 31.
    air_temperature_c : of the air, which gives the speed of sound.
    sound_speed_m_s : speed of sound where it was measured; None: from the temperature.
    delay_s : fixed delay of transducer and detector, from a facing plate at a known distance.
    timeout_s : longest wait for a whole answer.
    """

    port: str
    baud_bps: int = 19_200
    transmit_hz: int = 63_000
    cycles: int = 16
    blanking_s: float = 1.9e-3
    gain_db: float = 40.0
    sample_rate_hz: int = 1_000_000
    trigger: Literal["external", "internal"] = "external"
    pings: int = 5
    air_temperature_c: float = 20.0
    sound_speed_m_s: float | None = None
    delay_s: float = 0.0
    timeout_s: float = 3.0
    surroundings: SensorSurroundings = field(default=STANDING_ALONE, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not self.port:
            raise ConfigError("port = ''", cure="give a serial port; `surfuse devices` lists them")
        if not 300 <= self.baud_bps <= 4_000_000:
            raise ConfigError(f"baud_bps = {self.baud_bps}", cure="give 300 to 4000000")
        if self.trigger not in ("external", "internal"):
            raise ConfigError(f"trigger = '{self.trigger}'", cure="valid: external, internal")
        for name, value, low, high in (
            ("blanking_s", self.blanking_s, 0.0, 0.065),
            ("air_temperature_c", self.air_temperature_c, -60.0, 100.0),
            ("sound_speed_m_s", self.speed_m_s, 200.0, 500.0),
            ("delay_s", self.delay_s, -0.01, 0.01),
            ("timeout_s", self.timeout_s, 0.01, 60.0),
        ):
            if not low <= value <= high:
                raise ConfigError(f"{name} = {value}", cure=f"give {low:g} to {high:g}")
        _ = self.settings

    @property
    def settings(self) -> KitMessage:
        """What is set on the kit."""
        return KitMessage(
            self.transmit_hz,
            self.cycles,
            round(1e6 * self.blanking_s),
            self.gain_db,
            self.sample_rate_hz,
            TriggerSource.INTERNAL if self.trigger == "internal" else TriggerSource.EXTERNAL,
            self.pings,
        )

    @property
    def speed_m_s(self) -> float:
        """Speed of sound."""
        return speed_of_sound(self.air_temperature_c) if self.sound_speed_m_s is None else self.sound_speed_m_s


class RangingKit:
    """One kit; see the module."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters, self._clock = parameters, parameters.surroundings.clock
        self._spec = parameters.surroundings.known(SPEC)
        line = TextLine(parameters.port, parameters.baud_bps, "the ranging kit")
        self._kit = KitLine(line, parameters.timeout_s)
        sent = replace(self._spec, frequency_hz=float(parameters.transmit_hz))
        self._averaging = averaging_of(sent, float(parameters.sample_rate_hz))

    def __enter__(self) -> Self:
        self._kit.open(self._parameters.settings)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._kit.close()

    @property
    def spec(self) -> SensorSpec:
        """What is known of the sensor."""
        return self._spec

    @property
    def rejected(self) -> int:
        """Lines that were damaged, or answered nothing that was asked."""
        return self._kit.rejected

    def fire(self) -> Echo:
        """One trigger, its pings averaged; a fault when they come damaged again and again.

        Raises
        ------
        DeviceError : the kit is silent or refuses, or the port has vanished.
        """
        started_s = self._clock.now_s()
        pings = self._kit.fire(self._parameters.pings, self._parameters.settings)
        if not pings:
            return Echo(float("nan"), Status.FAULT, started_s, count=0)
        ranges = np.array([self._range_m(ping) for ping in pings])
        amplitudes = np.array([ping.amplitude for ping in pings])
        return within_limits(average_pings(ranges, amplitudes, started_s, self._averaging), self._spec)

    def _range_m(self, ping: Ping) -> float:
        """Range after REP-117 of one time of flight."""
        return 0.5 * self._parameters.speed_m_s * (ping.time_s - self._parameters.delay_s)


def create(parameters: Parameters) -> RangingKit:
    """A ranging kit on a serial line."""
    return RangingKit(parameters)
