"""The Polaroid-type ultrasonic transducer of the paper, and a driver for its 6500 ranging module.

`SPEC` is the transducer behind its tube (wrist array), `BARE_SPEC` the one without (shoulder). A module has two lines:
INIT starts the burst, ECHO rises at the detection. Whatever times them, a counter card or a microcontroller, is given
to the driver as a function.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from surfuse.errors import ConfigError
from surfuse.interfaces import GIVEN_BY_RIG, AlwaysOpen, SensorSurroundings, surrounded
from surfuse.node.averaging import AveragingParameters, average_pings
from surfuse.records import Echo, SensorSpec, Status

SUMMARY = "ultrasonic ranger of the paper: Polaroid transducer on a 6500 ranging module"
SPEC = SensorSpec(
    name="polaroid",
    kind="ultrasonic",
    range_min_m=0.33,
    range_max_m=4.0,
    beam_full_angle_rad=float(np.radians(13.0)),
    sigma_m=0.3e-3,
    incidence_limit_rad=float(np.radians(25.0)),
    firing_time_s=0.125,
    frequency_hz=63e3,
    aperture_m=0.040,
    dead_length_m=0.20,
)
BARE_SPEC = replace(
    SPEC,
    name="polaroid_bare",
    beam_full_angle_rad=float(np.radians(22.0)),
    aperture_m=0.017,
    dead_length_m=0.0,
)

PulseTimer = Callable[[], float | None]
"""Starts one burst and returns the time in s from INIT to ECHO, None when ECHO stays low."""


@dataclass(frozen=True, kw_only=True)
class Surroundings(SensorSurroundings):
    """What drives and times the lines of the module."""

    timer: PulseTimer


@dataclass(frozen=True)
class Parameters:
    """How times become ranges.

    Parameters
    ----------
    pings : bursts averaged for one reading.
    sound_speed_m_s : speed of sound; 343.2 m/s belongs to 20 degrees Celsius.
    delay_s : fixed delay of transducer and detector, from a facing plate at a known distance.
    blanking_s : the detector is deaf for so long; an answer at its very end means that the level was already reached.
    """

    pings: int = 5
    sound_speed_m_s: float = 343.2
    delay_s: float = 0.0
    blanking_s: float = 1.9e-3
    surroundings: Surroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not 1 <= self.pings <= 1000:
            raise ConfigError(f"pings = {self.pings}", cure="give 1 to 1000")
        if not 200.0 <= self.sound_speed_m_s <= 500.0:
            raise ConfigError(f"sound_speed_m_s = {self.sound_speed_m_s}", cure="give 200 to 500 m/s")
        if not (0.0 <= self.blanking_s <= 0.1 and abs(self.delay_s) <= 0.01):
            raise ConfigError(
                f"blanking_s = {self.blanking_s}, delay_s = {self.delay_s}",
                cure="give a blanking of 0 to 0.1 s and a delay within 0.01 s",
            )


class PolaroidSensor(AlwaysOpen):
    """A ranger on a 6500 module."""

    def __init__(self, parameters: Parameters, surroundings: Surroundings) -> None:
        self._parameters, self._spec = parameters, surroundings.known(SPEC)
        self._timer, self._clock = surroundings.timer, surroundings.clock

    @property
    def spec(self) -> SensorSpec:
        """What is known of this ranger."""
        return self._spec

    def fire(self) -> Echo:
        """Several bursts, averaged; no echo is an answer."""
        started_s = self._clock.now_s()
        ranges = np.array([self._range_m(self._timer()) for _ in range(self._parameters.pings)])
        unknown = np.full(len(ranges), np.nan)
        return within_limits(average_pings(ranges, unknown, started_s, averaging_of(self._spec)), self._spec)

    def _range_m(self, time_s: float | None) -> float:
        """Range after REP-117 of one time of flight."""
        if time_s is None:
            return float("inf")
        if not np.isfinite(time_s) or time_s < 0.0:
            return float("nan")
        if time_s <= self._parameters.blanking_s:
            return float("-inf")
        return 0.5 * self._parameters.sound_speed_m_s * (time_s - self._parameters.delay_s)


def create(parameters: Parameters) -> PolaroidSensor:
    """A ranger on a 6500 module."""
    return PolaroidSensor(parameters, surrounded(parameters.surroundings, "polaroid"))


def averaging_of(spec: SensorSpec, sample_rate_hz: float = 1e6) -> AveragingParameters:
    """How the pings of a ranger are averaged: its noise, its clock, and cycle slips when it counts waves."""
    if not spec.frequency_hz:
        return AveragingParameters(sigma_m=spec.sigma_m)
    half_speed_m_s = 0.5 * 343.2
    return AveragingParameters(
        sigma_m=spec.sigma_m,
        half_wavelength_m=half_speed_m_s / spec.frequency_hz,
        resolution_m=half_speed_m_s / sample_rate_hz,
    )


def within_limits(echo: Echo, spec: SensorSpec) -> Echo:
    """The echo with its status after REP-117: outside the limits of its spec a range is no measurement."""
    if echo.status is not Status.OK or spec.range_min_m <= echo.range_m <= spec.range_max_m:
        return echo
    if echo.range_m > spec.range_max_m:
        return Echo(float("inf"), Status.NO_ECHO, echo.t_s, count=echo.count)
    return Echo(float("-inf"), Status.TOO_CLOSE, echo.t_s, count=echo.count)
