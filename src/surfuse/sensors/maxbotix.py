r"""MaxBotix rangers on a serial line: `R1234\r` in mm, cm or inches, which only the model tells.

The lines carry no check sum. A reading counts only as `R`, exactly the digits of the model, and `\r`; after damage the
parser begins anew at the next `R`; the driver asks for two lines that agree. Sources: HRXL-MaxSonar-WR, XL-MaxSonar
and USB-ProxSonar data sheets.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import ConfigError, nearest
from surfuse.interfaces import GIVEN_BY_RIG, STANDING_ALONE, SensorSurroundings
from surfuse.records import SensorSpec, Status
from surfuse.serial_line.frames import LineReading, without_range
from surfuse.serial_line.ranger import SerialRanger

_LINE_MAX_BYTES = 64
SUMMARY = "ultrasonic rangers of MaxBotix (HRXL, XL, LV, USB), on a serial port"
NEEDS = ("serial",)


@dataclass(frozen=True)
class Model:
    """How a family speaks: line speed, line pattern, unit in m, and the numbers that mean too close and nothing."""

    spec: SensorSpec
    baud_bps: int
    pattern: re.Pattern[bytes]
    unit_m: float
    too_close: int
    nothing: int


def _model(
    name: str, baud_bps: int, pattern: bytes, unit_m: float, limits: tuple[int, int], sigma_m: float, beam_deg: float
) -> Model:
    too_close, nothing = limits
    spec = SensorSpec(
        name=f"maxbotix {name}",
        kind="ultrasonic",
        range_min_m=too_close * unit_m,
        range_max_m=nothing * unit_m,
        beam_full_angle_rad=float(np.radians(beam_deg)),
        sigma_m=sigma_m,
        firing_time_s=0.15,
        frequency_hz=42_000.0,
    )
    return Model(spec, baud_bps, re.compile(pattern), unit_m, too_close, nothing)


MODELS = {
    "hrxl-5m": _model("hrxl-5m", 9_600, rb"R(\d{4})", 1e-3, (300, 5000), 0.002, 20.0),
    "hrxl-10m": _model("hrxl-10m", 9_600, rb"R(\d{4})", 1e-3, (500, 9999), 0.003, 20.0),
    "xl": _model("xl", 9_600, rb"R(\d{3})", 1e-2, (20, 765), 0.005, 30.0),
    "lv": _model("lv", 9_600, rb"R(\d{3})", 0.0254, (6, 254), 0.01, 40.0),
    "usb": _model("usb", 57_600, rb"R(\d{3}) P[01]", 0.0254, (6, 254), 0.01, 40.0),
}
SPEC = MODELS["hrxl-5m"].spec


@dataclass(frozen=True)
class Parameters:
    """Where the sensor is, and which one.

    port : serial port.
    model : `hrxl-5m` (MB7360...), `hrxl-10m` (MB7363...), `xl` (MB12xx, cm), `lv` (MB10xx, inches), `usb` (MB14xx).
    timeout_s : wait for three lines.
    agreement_m : without a check sum a damaged digit is another digit, so two lines in a row must agree so closely;
        inf takes any line, which is faster by a third.
    """

    port: str
    model: str
    timeout_s: float = 1.0
    agreement_m: float = 0.03
    surroundings: SensorSurroundings = field(default=STANDING_ALONE, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not self.port:
            raise ConfigError("port = ''", cure="give a serial port; `surfuse devices` lists them")
        if self.model not in MODELS:
            raise ConfigError(f"maxbotix model = '{self.model}'", cure=nearest(self.model, MODELS))
        if not 0.0 < self.timeout_s <= 60.0:
            raise ConfigError(f"timeout_s = {self.timeout_s}", cure="give more than 0 and at most 60 s")
        if not self.agreement_m >= 0.0:
            raise ConfigError(f"agreement_m = {self.agreement_m}", cure="give 0 or more, or inf to take any line")


class Parser:
    """Lines of one model to readings."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._line = bytearray()
        self.rejected = 0

    def feed(self, data: bytes) -> list[LineReading]:
        """Readings of the lines that these bytes complete."""
        readings = []
        self._line += data
        while (end := self._line.find(b"\r")) >= 0:
            line = bytes(self._line[:end])
            del self._line[: end + 1]
            match = self._model.pattern.fullmatch(line, max(line.rfind(b"R"), 0))
            if match is None:
                self.rejected += 1
            else:
                readings.append(self._reading(int(match[1])))
        if len(self._line) > _LINE_MAX_BYTES:
            self.rejected += 1
            del self._line[:-_LINE_MAX_BYTES]
        return readings

    def reset(self) -> None:
        """Forget the beginning of a line."""
        self._line.clear()

    def _reading(self, number: int) -> LineReading:
        if number <= self._model.too_close:
            return without_range(Status.TOO_CLOSE)
        if number >= self._model.nothing:
            return without_range(Status.NO_ECHO)
        return LineReading(round(number * self._model.unit_m, 6), Status.OK)


def create(parameters: Parameters) -> SerialRanger:
    """A MaxBotix ranger on a serial port."""
    model, around = MODELS[parameters.model], parameters.surroundings
    agreement_m = None if math.isinf(parameters.agreement_m) else parameters.agreement_m
    line = parameters.port, model.baud_bps, parameters.timeout_s
    return SerialRanger(around.known(model.spec), Parser(model), *line, around.clock.now_s, agreement_m)
