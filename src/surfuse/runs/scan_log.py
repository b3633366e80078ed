"""What any log comes down to before fusion: readings, the part frame, the outline, and what was noticed on the way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surfuse.errors import DataError
from surfuse.geometry.poses import FloatArray
from surfuse.records import FusionScene, IntArray, Outline, Readings, Status


@dataclass(frozen=True)
class ScanLog:
    """A scan as read from a log of any kind.

    `world_from_part` (4, 4) is the given part frame, or an estimate when `frame_estimated`. `warnings` are sentences
    for the user about everything that was repaired, assumed or left out. `targets_uv_m` (M, 2) is where the plan of
    the scan wanted its stops, in the part frame (None: no plan is known). `step_m` is that of the map (None: the
    distance between the stops).

    `outline` is that of the part in its frame (None: unknown); readings deeper than `depth_max_m` do not belong to it.
    """

    readings: Readings
    world_from_part: FloatArray
    frame_estimated: bool
    outline: Outline | None = None
    depth_max_m: float = float("inf")
    warnings: tuple[str, ...] = ()
    targets_uv_m: FloatArray | None = None
    step_m: float | None = None

    def scene(self) -> FusionScene:
        """What a fusion method gets before the first reading."""
        return FusionScene(
            specs=self.readings.specs,
            world_from_part=self.world_from_part,
            outline=self.outline,
            depth_max_m=self.depth_max_m,
        )


@dataclass(frozen=True)
class AssumedSensor:
    """What is assumed of a sensor when the log does not say it: a bare ultrasonic ranger.

    `beam_full_angle_rad` full beam angle in rad, `range_min_m` and `range_max_m` limits in m (the upper one grows
    to the largest range seen), `sigma_m` standard deviation in m.
    """

    beam_full_angle_rad: float = math.radians(22.0)
    range_min_m: float = 0.0
    range_max_m: float = 4.0
    sigma_m: float = 0.003


_FEW = 0.5


def faulty_sensors(status: IntArray, sensor: IntArray, names: Sequence[str]) -> tuple[str, ...]:
    """Names of the sensors all of whose readings, with these statuses and sensors (N,), are faults."""
    return tuple(
        name
        for number, name in enumerate(names)
        if np.any(sensor == number) and np.all(status[sensor == number] == int(Status.FAULT))
    )


def look_at(faulty: Sequence[str]) -> str:
    """The cure for sensors that report nothing but faults."""
    listed = ", ".join(f"'{name}'" for name in faulty)
    return f"{listed} reported 'fault' in every reading: check its supply, its wiring and its program"


def few_echoes(status: IntArray, faulty: Sequence[str] = ()) -> str | None:
    """A sentence about readings with these statuses (N,) when less than half of them are echoes; None otherwise.

    `faulty` are the sensors that report nothing but faults: they are the cause to look at first.
    """
    heard = int(np.count_nonzero(status == int(Status.OK)))
    if heard >= _FEW * len(status):
        return None
    usual = "what was heard may not be the part; check the distance, the sensors' nearest range and how the part stands"
    return (
        f"only {heard} of {len(status)} readings are echoes ({100.0 * heard / len(status):.0f} %, at least 50 % are "
        f"usual): {look_at(faulty) if faulty else usual}"
    )


def require_echoes(readings: Readings, where: str) -> None:
    """Refuse readings without a single echo: they are data, but no surface can be fused from them.

    Raises
    ------
    DataError : no reading is OK; the message counts what they are instead.
    """
    if np.any(readings.status == int(Status.OK)):
        return
    kinds = ((Status.NO_ECHO, "without echo"), (Status.TOO_CLOSE, "too close"), (Status.FAULT, "faulty"))
    counts = [f"{int(np.sum(readings.status == int(status)))} {words}" for status, words in kinds]
    names = [spec.name for spec in readings.specs]
    broken = faulty_sensors(readings.status, readings.sensor, names)
    raise DataError(
        f"none of the {len(readings.t_s)} readings is an echo ({', '.join(counts)}), so there is nothing to fuse",
        where=where,
        cure=look_at(broken) if broken else "check the sensors, their range limits and the distance to the part",
    )
