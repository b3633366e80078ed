"""Benewake TFmini, TFmini-S and TFmini Plus: `59 59 DL DH SL SH x y SUM`, cm; three ways to say that it saw nothing.

Sources: the product manuals. TFmini: strength below 20 makes the distance 0xFFFF, beyond 12 m it is 1200. TFmini-S:
strength up to 100 makes it -1, saturation -2, ambient light -4 (signed). TFmini Plus: strength below 100 or 65535
makes it 0. So the model is not optional: a 0 or a 65535 would be a range elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import ConfigError, nearest
from surfuse.interfaces import GIVEN_BY_RIG, STANDING_ALONE, SensorSurroundings
from surfuse.records import SensorSpec, Status
from surfuse.serial_line.frames import LineReading, SummedFrames, without_range
from surfuse.serial_line.ranger import SerialRanger

_BAUD_BPS = 115_200
_NOTHING_CM = 1_200
_SATURATED = 0xFFFF
_NEGATIVE = 0x8000
SUMMARY = "laser ranger TFmini, TFmini-S or TFmini Plus, on a serial port"
NEEDS = ("serial",)


@dataclass(frozen=True)
class Model:
    """What a model calls a bad reading: `weakest` strength that counts, and the shortest distance in cm."""

    spec: SensorSpec
    weakest: int
    too_close_cm: int


def _model(name: str, weakest: int, too_close_cm: int, beam_deg: float, sigma_m: float) -> Model:
    spec = SensorSpec(
        name=name,
        kind="tof",
        range_min_m=too_close_cm * 1e-2,
        range_max_m=_NOTHING_CM * 1e-2,
        beam_full_angle_rad=float(np.radians(beam_deg)),
        sigma_m=sigma_m,
        incidence_limit_rad=float(np.radians(60.0)),
        firing_time_s=0.01,
    )
    return Model(spec, weakest, too_close_cm)


MODELS = {
    "tfmini": _model("tfmini", 20, 30, 2.3, 0.02),
    "tfmini-s": _model("tfmini-s", 101, 10, 2.0, 0.02),
    "tfmini-plus": _model("tfmini-plus", 100, 10, 3.6, 0.02),
}
SPEC = MODELS["tfmini-s"].spec


@dataclass(frozen=True)
class Parameters:
    """Where the sensor is, and which one.

    port : serial port.
    model : `tfmini`, `tfmini-s` or `tfmini-plus`.
    timeout_s : wait for two frames, which come a hundred times a second.
    """

    port: str
    model: str
    timeout_s: float = 0.2
    surroundings: SensorSurroundings = field(default=STANDING_ALONE, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not self.port:
            raise ConfigError("port = ''", cure="give a serial port; `surfuse devices` lists them")
        if self.model not in MODELS:
            raise ConfigError(f"tfmini model = '{self.model}'", cure=nearest(self.model, MODELS))
        if not 0.0 < self.timeout_s <= 60.0:
            raise ConfigError(f"timeout_s = {self.timeout_s}", cure="give more than 0 and at most 60 s")


class Parser(SummedFrames):
    """Frames of one model to readings."""

    def __init__(self, model: Model) -> None:
        super().__init__(b"\x59\x59", 9, self._reading)
        self._model = model

    def _reading(self, frame: bytes) -> LineReading:
        distance_cm, strength = int.from_bytes(frame[2:4], "little"), int.from_bytes(frame[4:6], "little")
        bad_distance = distance_cm == 0 or distance_cm >= _NEGATIVE
        if bad_distance or strength < self._model.weakest or strength == _SATURATED:
            return without_range(Status.FAULT)
        if distance_cm >= _NOTHING_CM:
            return without_range(Status.NO_ECHO)
        if distance_cm < self._model.too_close_cm:
            return without_range(Status.TOO_CLOSE)
        return LineReading(distance_cm / 100.0, Status.OK)


def create(parameters: Parameters) -> SerialRanger:
    """A TFmini of any model on a serial port."""
    model, around = MODELS[parameters.model], parameters.surroundings
    line = parameters.port, _BAUD_BPS, parameters.timeout_s
    return SerialRanger(around.known(model.spec), Parser(model), *line, around.clock.now_s)
