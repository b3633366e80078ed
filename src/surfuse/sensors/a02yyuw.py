"""A02YYUW (also DYP-A02 and JSN-SR04T in its serial mode): `FF H L SUM`, millimetres, 9600 bit/s.

Source: DFRobot SEN0311 wiki (frame, example FF 07 A1 A7 = 1953 mm, lower limit 30 mm, upper 4500 mm). 0xFFFD (nothing)
and 0xFFFE (disturbed by another one) as in the data sheet of the DYP-A02; any other number beyond the limit is nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import ConfigError
from surfuse.interfaces import GIVEN_BY_RIG, STANDING_ALONE, SensorSurroundings
from surfuse.records import SensorSpec, Status
from surfuse.serial_line.frames import LineReading, SummedFrames, without_range
from surfuse.serial_line.ranger import SerialRanger

_BAUD_BPS = 9_600
_TOO_CLOSE_MM = 30
_NOTHING_MM = 4_500
_DISTURBED = 0xFFFE
SUMMARY = "ultrasonic ranger A02YYUW or DYP-A02, on a serial port"
NEEDS = ("serial",)
SPEC = SensorSpec(
    name="a02yyuw",
    kind="ultrasonic",
    range_min_m=_TOO_CLOSE_MM * 1e-3,
    range_max_m=_NOTHING_MM * 1e-3,
    beam_full_angle_rad=float(np.radians(60.0)),
    sigma_m=0.005,
    firing_time_s=0.1,
    frequency_hz=40_000.0,
)


@dataclass(frozen=True)
class Parameters:
    """Where the sensor is.

    port : serial port.
    timeout_s : wait for two frames, which come every 0.1 to 0.3 s.
    """

    port: str
    timeout_s: float = 1.0
    surroundings: SensorSurroundings = field(default=STANDING_ALONE, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not self.port:
            raise ConfigError("port = ''", cure="give a serial port; `surfuse devices` lists them")
        if not 0.0 < self.timeout_s <= 60.0:
            raise ConfigError(f"timeout_s = {self.timeout_s}", cure="give more than 0 and at most 60 s")


def _reading(frame: bytes) -> LineReading:
    number = int.from_bytes(frame[1:3], "big")
    if number == _DISTURBED:
        return without_range(Status.FAULT)
    if number <= _TOO_CLOSE_MM:
        return without_range(Status.TOO_CLOSE)
    if number >= _NOTHING_MM:
        return without_range(Status.NO_ECHO)
    return LineReading(number / 1000.0, Status.OK)


class Parser(SummedFrames):
    """Frames to readings."""

    def __init__(self) -> None:
        super().__init__(b"\xff", 4, _reading)


def create(parameters: Parameters) -> SerialRanger:
    """An A02YYUW on a serial port."""
    around = parameters.surroundings
    line = parameters.port, _BAUD_BPS, parameters.timeout_s
    return SerialRanger(around.known(SPEC), Parser(), *line, around.clock.now_s)
