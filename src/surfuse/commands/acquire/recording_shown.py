"""What a recording has seen so far: for the terminal in numbers, for those who look on as a scan without a plan."""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from surfuse.commands.acquire.warm_up import compiled_before
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.show.observer import PlannedScan, ScanObserver
from surfuse.errors import SurfuseError
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import (
    FloatArray,
    FusionScene,
    Outline,
    Readings,
    ScanPlan,
    SensorSpec,
    Status,
    Sweep,
    readings_from_sweeps,
)
from surfuse.runs.odd_sensors import HeardOfSensors
from surfuse.runs.recorded_log import estimated_frame, usual_step_m
from surfuse.settings import Settings

FIRST_SWEEPS = 30
"""So many are looked at before a part frame is estimated for those who look on."""

_SIGMAS_KEPT = 500
_TOLD_EVERY_S = 0.5


@dataclass
class Covered:
    """Cells of a map that have been seen, on the plane across the first beams (or the given part frame)."""

    specs: tuple[SensorSpec, ...]
    step_m: float
    part_from_world: FloatArray | None = None
    _cells: set[tuple[int, int]] = field(default_factory=set)
    _sigmas_m: deque[float] = field(default_factory=lambda: deque(maxlen=_SIGMAS_KEPT))

    def take(self, sweep: Sweep) -> None:
        """One sweep more."""
        if self.part_from_world is None:
            self.part_from_world = inverse(sweep.world_from_grip)
        heard = sweep.status == int(Status.OK)
        feet = sweep.position_m[heard] + sweep.range_m[heard, None] * sweep.axis[heard]
        cells = np.floor(transform_points(self.part_from_world, feet)[:, :2] / self.step_m).astype(np.int64)
        self._cells.update((int(u), int(v)) for u, v in cells)
        usual = np.array([spec.sigma_m for spec in self.specs])[sweep.sensor[heard]]
        told = sweep.sigma_m[heard]
        self._sigmas_m.extend(np.where(np.isnan(told), usual, told).tolist())

    @property
    def cells(self) -> int:
        """How many."""
        return len(self._cells)

    @property
    def area_m2(self) -> float:
        """Their area."""
        return len(self._cells) * self.step_m**2

    @property
    def median_sigma_m(self) -> float:
        """Of the newest readings; nan without one."""
        return float(np.median(self._sigmas_m)) if self._sigmas_m else math.nan


@dataclass
class Tally:
    """What a recording has so far: sweeps kept and left out, the most that one left out may have been off (m)."""

    began_s: float
    covered: Covered
    heard: HeardOfSensors
    sweeps: int = 0
    left_out: int = 0
    most_off_m: float = 0.0
    _words: str = ""
    _worded_s: float = -math.inf

    def rate_hz(self) -> float:
        """Sweeps a second since it began."""
        return self.sweeps / max(time.monotonic() - self.began_s, 1e-3)

    def in_words(self) -> str:
        """Rate, covered cells and sigma; made anew twice a second at most."""
        now_s = time.monotonic()
        if now_s - self._worded_s >= _TOLD_EVERY_S:
            self._worded_s = now_s
            covered = self.covered
            self._words = (
                f"record, {self.rate_hz():.0f} sweeps/s, {covered.cells} cells ({1e4 * covered.area_m2:.0f} cm2), "
                f"sigma {1e3 * covered.median_sigma_m:.2g} mm"
            )
        return self._words


class ShownRecording:
    """Tells an observer of a recording, as soon as there is a part frame to show it in: that of the area, else one
    that is estimated from the first sweeps.
    """

    def __init__(self, observer: ScanObserver, settings: Settings, scene: FusionScene, method: str) -> None:
        self._observer, self._settings, self._scene, self._method = observer, settings, scene, method
        self._first: list[Sweep] = []
        self._announced = False
        self._wanted = 1 if scene.outline is not None else FIRST_SWEEPS

    def take(self, sweep: Sweep) -> None:
        """A sweep that is on disk."""
        if self._announced:
            self._observer.swept(sweep)
            return
        self._first.append(sweep)
        if len(self._first) < self._wanted:
            return
        try:
            scan = self._as_planned()
        except SurfuseError:
            self._wanted *= 2  # the beams of these show no frame
            return
        self._announced = True
        self._observer.planned(scan)
        self._first.clear()

    def _as_planned(self) -> PlannedScan:
        readings = readings_from_sweeps(self._scene.specs, self._first)
        scene, step_m = self._scene, self._settings.scan.step_m or usual_step_m(readings)
        if scene.outline is None:
            scene = replace(scene, world_from_part=estimated_frame(readings))
        grips = transform_points(inverse(scene.world_from_part), readings.world_from_grip[:, :3, 3])
        outline = scene.outline or _around(_seen_uv_m(readings, scene.world_from_part), step_m, scene.world_from_part)
        plan = ScanPlan(
            world_from_grip=np.zeros((0, 4, 4)),
            uv_m=np.zeros((0, 2)),
            row=np.zeros(0, dtype=np.int64),
            joints_rad=np.zeros((0, 0)),
            outline=outline,
            step_m=step_m,
            standoff_m=max(float(np.median(grips[:, 2])), step_m),
        )
        fresh = partial(create_method, self._settings.fusion, self._method)
        compiled = partial(compiled_before, self._method)
        return PlannedScan(scene, plan, tuple(self._first), fresh, compiled, by_hand=True)


def _seen_uv_m(readings: Readings, world_from_part: FloatArray) -> FloatArray:
    """Where the readings hit (N, 2), in the part frame."""
    heard = readings.status == int(Status.OK)
    feet = readings.position_m[heard] + readings.range_m[heard, None] * readings.axis[heard]
    return transform_points(inverse(world_from_part), feet)[:, :2]


def _around(uv_m: FloatArray, step_m: float, world_from_part: FloatArray) -> Outline:
    """A rectangle around places (N, 2), a step wider."""
    places = uv_m if len(uv_m) else np.zeros((1, 2))
    (u0, v0), (u1, v1) = places.min(axis=0) - step_m, places.max(axis=0) + step_m
    return Outline(np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]]), world_from_part)
