"""The walk through a scan plan without stops: the array fires while the arm runs along the lines."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass

import numpy as np

from surfuse.acquisition.scan import ScanOutcome
from surfuse.acquisition.station import GripPlaces, sweep_of
from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import RangeArray
from surfuse.motion.moving_arm import MovingArm
from surfuse.motion.planners import LinePlanner
from surfuse.records import Echo, FloatArray, IntArray, JointSamples, ScanPlan, Sweep

_CLOCK_ROUNDING_S = 1e-4  # a node tells times in whole microseconds, and its clock is not ours


@dataclass(frozen=True)
class SmoothParameters:
    """When the array is triggered, and when the scan gives up.

    `lead_s`: time from the trigger of a sweep to the middle of its emissions, so much earlier than the stop it fires.
    `reading_s`: time from the first emission of a reading to the middle of its pings; there its pose is taken.
    `misses_max`: how many sweeps in a row may fail before the scan gives up.
    """

    lead_s: float
    reading_s: float = 0.0
    misses_max: int = 3

    def __post_init__(self) -> None:
        for name in ("lead_s", "reading_s"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give a time of 0 s or more")
        if self.misses_max < 0:
            raise ConfigError(f"misses_max = {self.misses_max}", cure="give 0 or more")


def lines_of(plan: ScanPlan) -> tuple[IntArray, ...]:
    """Numbers of the stops of every line, in visiting order."""
    if len(plan) == 0:
        return ()
    ends = np.flatnonzero(np.diff(plan.row)) + 1
    return tuple(np.asarray(line, dtype=np.int64) for line in np.split(np.arange(len(plan)), ends))


def way_of(plan: ScanPlan, line: IntArray) -> FloatArray:
    """Joints (N, J) that the motion along a line goes through: the end of the line before it, then its own stops."""
    return plan.joints_rad[max(int(line[0]) - 1, 0) : int(line[-1]) + 1]


@dataclass(frozen=True)
class SmoothPass:
    """The arm that runs along the lines, what plans its motions, and when the array is triggered."""

    arm: MovingArm
    planner: LinePlanner
    when: SmoothParameters


@dataclass(frozen=True)
class PassHooks:
    """What is told, and asked, on a pass.

    `on_sweep` takes every sweep with the encoder samples since the one before it; `before_stop` is told each stop;
    `bring` takes the arm to where the line with a stop begins, whenever the line before it was not run; `should_stop`
    is asked before every line, and again after `bring`.
    """

    on_sweep: Callable[[Sweep, JointSamples], None]
    before_stop: Callable[[int], None]
    bring: Callable[[int], None]
    should_stop: Callable[[], bool] = lambda: False


def smooth_scan(
    plan: ScanPlan, run: SmoothPass, array: RangeArray, hooks: PassHooks, done: Container[int] = ()
) -> ScanOutcome:
    """Run along the lines of a plan that have stops left to do, and fire the array at those on the way.

    Every line is one motion from where the line before it ended (or from the first stop) to its own end. There the arm
    is at rest for an instant, so a line depends on nothing that ran before. Each reading carries the pose at its own
    firing time. Stops in `done` are passed without a sweep. A sweep that fails is left out: nobody can go back for it
    in time.

    Raises
    ------
    SafetyStopError : the arm was stopped, or refuses a motion; every sweep before it has been handed on.
    DeviceError : the arm fails, or the array fails too often in a row; the arm has come to rest.
    ConfigError : a line cannot be run along.
    """
    began_s = run.arm.joint_state().t_s
    missed, there = 0, False
    for line in lines_of(plan):
        if all(stop in done for stop in line.tolist()):
            there = False
            continue
        first = int(line[0])
        if hooks.should_stop():
            return ScanOutcome(first, False, missed, run.arm.joint_state().t_s - began_s)
        if not there:
            hooks.bring(first)
            if hooks.should_stop():
                return ScanOutcome(first, False, missed, run.arm.joint_state().t_s - began_s)
        hooks.before_stop(first)
        there = True
        missed += _run_line(plan, line, run, array, hooks, done)
    return ScanOutcome(len(plan), missed == 0, missed, run.arm.joint_state().t_s - began_s)


def _run_line(
    plan: ScanPlan, line: IntArray, run: SmoothPass, array: RangeArray, hooks: PassHooks, done: Container[int]
) -> int:
    """One line; returns how many sweeps failed."""
    way = way_of(plan, line)
    if len(way) < 2:
        raise ConfigError(
            "a scan of one stop has no line to run along", cure="take a smaller step, or scan.mode = 'stops'"
        )
    arm, when = run.arm, run.when
    motion, at_s = run.planner(way)
    began_s = logged_s = arm.start(motion)
    missed, in_a_row = 0, 0
    failure: DeviceError | None = None
    for stop, due_s in zip(line.tolist(), at_s[-len(line) :].tolist(), strict=True):
        if stop in done:
            continue
        arm.wait_until(began_s + max(due_s - when.lead_s, 0.0))
        hooks.before_stop(stop)
        try:
            echoes = array.sweep()
        except DeviceError as error:
            missed, in_a_row, failure = missed + 1, in_a_row + 1, error
            if in_a_row > when.misses_max:
                break
            continue
        in_a_row = 0
        samples = arm.samples_since(logged_s)
        grip = GripPlaces.moving(arm.kinematics, _joints_of(echoes, samples, when.reading_s))
        hooks.on_sweep(sweep_of(stop, int(plan.row[stop]), echoes, array.fixture, grip), samples)
        logged_s = float(samples.t_s[-1])
    # Also after a failure the arm runs to the end of the line: it comes to rest as planned.
    arm.finish()
    if failure is not None and in_a_row > when.misses_max:
        raise DeviceError(
            f"line {int(plan.row[line[0]])}: the array failed {in_a_row} times in a row: {failure.what}",
            cure=failure.cure or "check the array, then resume the run",
            where=failure.where,
        ) from failure
    return missed


def _joints_of(echoes: Sequence[Echo], samples: JointSamples, reading_s: float) -> FloatArray:
    """Joints (S, J) at the moment of each reading."""
    times = np.array([echo.t_s for echo in echoes]) + reading_s
    known = np.isfinite(times)
    # A faulty reading may not say when it was taken; it has no range either.
    times = np.where(known, times, np.mean(times[known]) if known.any() else samples.t_s[-1])
    first = float(samples.t_s[0])
    return samples.at(np.where(np.abs(times - first) < _CLOCK_ROUNDING_S, np.maximum(times, first), times))
