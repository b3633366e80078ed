"""Rangers behind the Linux industrial I/O files: VL53L0X, VL53L1X, VL53L5CX, SRF04, MB1232, PING and the like.

The kernel's driver does the talking; here is a folder such as `/sys/bus/iio/devices/iio:device0` with
`in_distance_raw` and `in_distance_scale` (metres). A read that fails is a faulty reading: several drivers say EIO both
for a broken wire and for nothing in range, and a guess would be a wrong answer. Status words of the ST sensors: 0
valid, 13 closer than the minimum (VL53L1X); 5 and 9 valid (VL53L5CX).
"""

from __future__ import annotations

import errno
import math
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from surfuse.errors import ConfigError, DeviceError, nearest
from surfuse.interfaces import GIVEN_BY_RIG, STANDING_ALONE, SensorSurroundings
from surfuse.records import Echo, SensorSpec, Status

SUMMARY = "rangers behind the Linux industrial I/O files (VL53L0X, VL53L1X, VL53L5CX, SRF04, MB1232, PING)"
_GONE = (errno.ENODEV, errno.ENXIO, errno.ENOENT)


@dataclass(frozen=True)
class Model:
    """What is known of a chip: its spec, and which status words (where the driver shows one) are good or too close."""

    spec: SensorSpec
    valid: frozenset[int] = frozenset({0})
    too_close: frozenset[int] = frozenset()


def _spec(
    name: str, kind: str, limits_m: tuple[float, float], beam_deg: float, sigma_m: float, firing_s: float
) -> SensorSpec:
    return SensorSpec(
        name=name,
        kind=kind,
        range_min_m=limits_m[0],
        range_max_m=limits_m[1],
        beam_full_angle_rad=float(np.radians(beam_deg)),
        sigma_m=sigma_m,
        incidence_limit_rad=float(np.radians(25.0 if kind == "ultrasonic" else 60.0)),
        firing_time_s=firing_s,
        frequency_hz=40_000.0 if kind == "ultrasonic" else None,
    )


MODELS = {
    "vl53l0x": Model(_spec("vl53l0x", "tof", (0.03, 2.0), 25.0, 0.01, 0.033)),
    "vl53l1x": Model(_spec("vl53l1x", "tof", (0.04, 4.0), 27.0, 0.005, 0.05), too_close=frozenset({13})),
    "vl53l5cx": Model(_spec("vl53l5cx", "tof", (0.02, 4.0), 5.6, 0.01, 0.067), valid=frozenset({5, 9})),
    "srf04": Model(_spec("srf04", "ultrasonic", (0.03, 3.0), 30.0, 0.005, 0.06)),
    "mb1232": Model(_spec("mb1232", "ultrasonic", (0.2, 7.65), 30.0, 0.005, 0.1)),
    "ping": Model(_spec("ping", "ultrasonic", (0.02, 3.3), 30.0, 0.005, 0.06)),
}
SPEC = MODELS["vl53l1x"].spec


@dataclass(frozen=True)
class Parameters:
    """Where the sensor is, and which one.

    folder : its folder under `/sys/bus/iio/devices`.
    model : a chip named above; it brings limits, beam and status words.
    channel : first part of the file names, `in_distance` or, for the zones of an array, `in_distance7`.
    status_file : file with the status word of the reading, where a driver has one; empty: none.
    """

    folder: Path
    model: str
    channel: str = "in_distance"
    status_file: str = ""
    surroundings: SensorSurroundings = field(default=STANDING_ALONE, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise ConfigError(f"iio model = '{self.model}'", cure=nearest(self.model, MODELS))
        for name, value in (("channel", self.channel), ("status_file", self.status_file)):
            if "/" in value or (name == "channel" and not value):
                raise ConfigError(f"{name} = '{value}'", cure="give the name of a file in the folder")


class IioRanger:
    """One channel of an IIO device."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters, self._clock = parameters, parameters.surroundings.clock
        self._model = MODELS[parameters.model]
        self._spec = parameters.surroundings.known(self._model.spec)
        self._scale_m = math.nan
        self._offset = 0.0

    def __enter__(self) -> Self:
        folder, channel = self._parameters.folder, self._parameters.channel
        if not (folder / f"{channel}_raw").exists():
            found = ", ".join(sorted(path.name for path in folder.glob("in_*_raw"))) or "no such channel"
            cure = f"this folder has {found}; see `surfuse devices`"
            raise DeviceError(f"there is no {channel}_raw", cure=cure, where=str(folder))
        try:
            self._scale_m = float(self._text(f"{channel}_scale"))
            offset = folder / f"{channel}_offset"
            self._offset = float(self._text(offset.name)) if offset.exists() else 0.0
        except (OSError, ValueError) as error:
            cure = "a distance channel has a scale in metres"
            raise DeviceError(f"{channel}_scale cannot be read: {error}", cure=cure, where=str(folder)) from error
        if not (math.isfinite(self._scale_m) and self._scale_m > 0.0 and math.isfinite(self._offset)):
            raise DeviceError(
                f"{channel}_scale = {self._scale_m}", cure="a distance channel has a scale > 0", where=str(folder)
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    @property
    def spec(self) -> SensorSpec:
        """What is known of the sensor."""
        return self._spec

    def fire(self) -> Echo:
        """One reading; the driver measures while the file is read.

        Raises
        ------
        DeviceError : the device has vanished.
        """
        start_s = self._clock.now_s()
        try:
            raw = int(self._text(f"{self._parameters.channel}_raw"))
            word = int(self._text(self._parameters.status_file)) if self._parameters.status_file else None
        except OSError as error:
            if error.errno in _GONE:
                where = str(self._parameters.folder)
                cure = "check the wiring and the kernel log"
                raise DeviceError("the device has vanished", cure=cure, where=where) from error
            return _without_range(Status.FAULT, start_s)
        except ValueError:
            return _without_range(Status.FAULT, start_s)
        return self._echo(raw, word, start_s)

    def _echo(self, raw: int, word: int | None, start_s: float) -> Echo:
        if word in self._model.too_close:
            return _without_range(Status.TOO_CLOSE, start_s)
        if (word is not None and word not in self._model.valid) or raw < 0:
            return _without_range(Status.FAULT, start_s)
        range_m = (raw + self._offset) * self._scale_m
        if range_m < self._spec.range_min_m:
            return _without_range(Status.TOO_CLOSE, start_s)
        if range_m > self._spec.range_max_m:
            return _without_range(Status.NO_ECHO, start_s)
        return Echo(range_m, Status.OK, start_s)

    def _text(self, name: str) -> str:
        return (self._parameters.folder / name).read_text(encoding="ascii", errors="replace").strip()


def _without_range(status: Status, start_s: float) -> Echo:
    range_m = {Status.NO_ECHO: math.inf, Status.TOO_CLOSE: -math.inf, Status.FAULT: math.nan}[status]
    return Echo(range_m, status, start_s, count=0)


def create(parameters: Parameters) -> IioRanger:
    """A ranger behind IIO files."""
    return IioRanger(parameters)
