"""Readings of an arm that somebody else moves: asked for as fast as they come, placed where the arm was meanwhile."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from surfuse.acquisition.station import GripPlaces, sweep_of
from surfuse.acquisition.stop_arm import StopArm
from surfuse.acquisition.stuck_pose import StuckPose
from surfuse.acquisition.tool_track import ToolTrack, TrackedPlaces
from surfuse.interfaces import RangeArray
from surfuse.records import Echo, Fixture, FloatArray, Status, Sweep

OFF_LIMIT_M = 0.01
"""A sweep is left out when the point that a sensor looked at may be further off than this: it is the step of a map."""

_ANEW_S = 0.01  # stamps of one clock are rounded to less
_SLOWEST_M_S = 1e-12


@dataclass(frozen=True)
class RecordingHooks:
    """What happens with sweeps, and when the recording ends.

    `on_sweep` keeps a sweep, `on_left_out` is told of one whose place is not known well enough: by how many metres it
    may be off (nan: the arm's states do not reach to the time of its readings).
    """

    on_sweep: Callable[[Sweep], None]
    on_left_out: Callable[[float], None]
    should_stop: Callable[[], bool]


@dataclass(frozen=True)
class _Heard:
    """A sweep that waits for its places; `off_s` (S,): how far its stamps may be off the arm's clock."""

    echoes: tuple[Echo, ...]
    off_s: tuple[float, ...]

    def until_s(self) -> float:
        return max(echo.t_s for echo in self.echoes)


def record(
    arm: StopArm,
    array: RangeArray,
    lag_s: Sequence[float],
    hooks: RecordingHooks,
    stamps_off_s: Callable[[], tuple[float, ...]] | None = None,
) -> None:
    """State, sweep, state, sweep, ... until told to stop; nothing is moved.

    A sweep is kept as soon as the arm has told a state after all of its readings. `lag_s` (S,) is how much later than
    its stamp each sensor's reading was taken. A standing arm, or one at constant speed, adds nothing to the standard
    deviation of a reading; one that accelerates adds how far the place may be off, see `ToolTrack`. `stamps_off_s` says
    how far each sensor's stamps may now be off the arm's clock (None: they are of one clock): times the speed along the
    beam, this is added, too. An arm whose clock begins anew loses the sweeps that wait for a place.

    Raises
    ------
    SafetyStopError : the arm's time or pose is no longer that of now, see `StuckPose`.
    DeviceError : arm or array do not answer; what was kept before is complete.
    """
    track, stuck = ToolTrack(), StuckPose(array.fixture.specs)
    waiting: deque[_Heard] = deque()
    stop = 0
    track.add(arm.standing())
    track.add(arm.standing())
    while not hooks.should_stop():
        waiting.append(_heard(array, lag_s, stamps_off_s))
        state = arm.standing()
        if state.t_s < track.told_s - _ANEW_S:
            track = ToolTrack()
            _leave_out(waiting, hooks)
        track.add(state)
        if waiting:
            stuck.check(waiting[-1].echoes, state.t_s, track.unchanged_s)
        while waiting and waiting[0].until_s() <= track.until_s:
            sweep = _placed(stop, waiting.popleft(), array.fixture, track, hooks)
            if sweep is not None:
                hooks.on_sweep(sweep)
                stop += 1
    _leave_out(waiting, hooks)


def _heard(array: RangeArray, lag_s: Sequence[float], stamps_off_s: Callable[[], tuple[float, ...]] | None) -> _Heard:
    """One sweep, with the moments at which it was taken."""
    echoes = tuple(replace(echo, t_s=echo.t_s + lag) for echo, lag in zip(array.sweep(), lag_s, strict=True))
    return _Heard(echoes, (0.0,) * len(echoes) if stamps_off_s is None else stamps_off_s())


def _leave_out(waiting: deque[_Heard], hooks: RecordingHooks) -> None:
    """Nobody will say where the arm was during these."""
    for _ in waiting:
        hooks.on_left_out(math.nan)
    waiting.clear()


def _placed(stop: int, heard: _Heard, fixture: Fixture, track: ToolTrack, hooks: RecordingHooks) -> Sweep | None:
    """The sweep where the arm was at each of its readings; None when that is not known well enough."""
    echoes, off_s = heard.echoes, np.array(heard.off_s)
    times = [echo.t_s for echo in echoes]
    if min(times) < track.since_s:
        hooks.on_left_out(math.nan)
        return None
    ahead = [echo.range_m if echo.status is Status.OK else 0.0 for echo in echoes]
    middle_s = 0.5 * (min(times) + max(times))
    places = track.at([*times, middle_s], [*ahead, float(np.median(ahead))])
    velocity_m_s, bent_m = places.velocity_m_s[:-1], places.off_m[:-1]
    speed_m_s = np.linalg.norm(velocity_m_s, axis=1)
    # A clock that nobody knows (inf) leaves a standing arm where it stands.
    shifted_m = np.multiply(off_s, speed_m_s, out=np.zeros(len(echoes)), where=speed_m_s > 0.0)
    most_m = float(max((bent_m + shifted_m).max(), places.off_m[-1]))
    if most_m > OFF_LIMIT_M:
        hooks.on_left_out(most_m)
        return None
    beams = places.world_from_grip[:-1, :3, :3] @ fixture.grip_from_sensor[:, :3, 2:]
    share = np.abs(np.einsum("ni,ni->n", beams[..., 0], velocity_m_s)) / np.maximum(speed_m_s, _SLOWEST_M_S)
    return sweep_of(stop, 0, _less_sure(echoes, fixture, np.hypot(bent_m, share * shifted_m)), fixture, _grip(places))


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
