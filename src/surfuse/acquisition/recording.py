"""Readings of an arm that somebody else moves: asked for as fast as they come, placed where the arm was meanwhile."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from surfuse.acquisition.station import GripPlaces, sweep_of
from surfuse.acquisition.stop_arm import StopArm
from surfuse.acquisition.tool_track import ToolTrack, TrackedPlaces
from surfuse.interfaces import RangeArray
from surfuse.records import Echo, Fixture, FloatArray, Status, Sweep

OFF_LIMIT_M = 0.01
"""A sweep is left out when the point that a sensor looked at may be further off than this: it is the step of a map."""


@dataclass(frozen=True)
class RecordingHooks:
    """What happens with sweeps, and when the recording ends.

    `on_sweep` keeps a sweep, `on_left_out` is told of one whose place is not known well enough: by how many metres it
    may be off (nan: the arm's states do not reach to the time of its readings).
    """

    on_sweep: Callable[[Sweep], None]
    on_left_out: Callable[[float], None]
    should_stop: Callable[[], bool]


def record(arm: StopArm, array: RangeArray, lag_s: Sequence[float], hooks: RecordingHooks) -> None:
    """State, sweep, state, sweep, ... until told to stop; nothing is moved.

    A sweep is kept as soon as the arm has told a state after all of its readings. `lag_s` (S,) is how much later than
    its stamp each sensor's reading was taken. A standing arm, or one at constant speed, adds nothing to the standard
    deviation of a reading; one that accelerates adds how far the place may be off, see `ToolTrack`.

    Raises
    ------
    DeviceError : arm or array do not answer; what was kept before is complete.
    """
    track = ToolTrack()
    waiting: deque[tuple[Echo, ...]] = deque()
    stop = 0
    track.add(arm.standing())
    track.add(arm.standing())
    while not hooks.should_stop():
        echoes = array.sweep()
        waiting.append(tuple(replace(echo, t_s=echo.t_s + lag) for echo, lag in zip(echoes, lag_s, strict=True)))
        track.add(arm.standing())
        while waiting and max(echo.t_s for echo in waiting[0]) <= track.until_s:
            sweep = _placed(stop, waiting.popleft(), array.fixture, track, hooks)
            if sweep is not None:
                hooks.on_sweep(sweep)
                stop += 1
    for _ in waiting:
        hooks.on_left_out(math.nan)


def _placed(
    stop: int, echoes: tuple[Echo, ...], fixture: Fixture, track: ToolTrack, hooks: RecordingHooks
) -> Sweep | None:
    """The sweep where the arm was at each of its readings; None when that is not known well enough."""
    times = [echo.t_s for echo in echoes]
    if min(times) < track.since_s:
        hooks.on_left_out(math.nan)
        return None
    ahead = [echo.range_m if echo.status is Status.OK else 0.0 for echo in echoes]
    middle_s = 0.5 * (min(times) + max(times))
    places = track.at([*times, middle_s], [*ahead, float(np.median(ahead))])
    most_m = float(places.off_m.max())
    if most_m > OFF_LIMIT_M:
        hooks.on_left_out(most_m)
        return None
    heard = _less_sure(echoes, fixture, places.off_m)
    return sweep_of(stop, 0, heard, fixture, _grip(places))


def _grip(places: TrackedPlaces) -> GripPlaces:
    return GripPlaces(places.world_from_grip[:-1], places.world_from_grip[-1], places.joints_rad[-1])


def _less_sure(echoes: tuple[Echo, ...], fixture: Fixture, off_m: FloatArray) -> tuple[Echo, ...]:
    """The echoes with standard deviations that hold how far their places may be off."""
    found = []
    for echo, spec, off in zip(echoes, fixture.specs, off_m.tolist(), strict=False):
        if off > 0.0 and echo.status is Status.OK:
            known = spec.sigma_m if math.isnan(echo.sigma_m) else echo.sigma_m
            echo = replace(echo, sigma_m=math.hypot(known, off))
        found.append(echo)
    return tuple(found)
