"""The walk through a scan plan: move, settle, sweep, hand on, go on (paper, section 3.2: start-stop)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from surfuse.acquisition.station import take_sweep
from surfuse.acquisition.stop_arm import StopArm
from surfuse.errors import ConfigError, DeviceError, UnreachableError
from surfuse.interfaces import RangeArray
from surfuse.records import ScanPlan, Sweep, ToolState


@dataclass(frozen=True)
class ScanParameters:
    """`retries`: how often a stop's sweep is fired again after a device error before the scan gives up."""

    retries: int = 2

    def __post_init__(self) -> None:
        if self.retries < 0:
            raise ConfigError(f"retries = {self.retries}", cure="give 0 or more")


@dataclass(frozen=True)
class ScanOutcome:
    """How a walk ended: `next_stop` is the first stop not scanned, `finished` says that there is none.

    `retried` counts the sweeps fired again; `robot_time_s` runs from the start of the walk to its end on the arm's
    own clock.
    """

    next_stop: int
    finished: bool
    retried: int
    robot_time_s: float


def _go_on() -> bool:
    return False


def _nothing(stop: int) -> None:
    return None


def _refused(stop: int, error: UnreachableError) -> None:
    raise error


@dataclass(frozen=True)
class WalkHooks:
    """What is told, and asked, on the walk.

    `on_sweep` takes every sweep and must return before the arm moves on, so what it has stored is never behind the arm.
    `before_stop` is called with the number of each stop before the arm moves there. `should_stop` is asked between
    stops. `on_unreachable` takes a stop that the arm refused to go to; the walk goes on when it returns.
    """

    on_sweep: Callable[[Sweep], None]
    before_stop: Callable[[int], None] = _nothing
    should_stop: Callable[[], bool] = _go_on
    on_unreachable: Callable[[int, UnreachableError], None] = _refused


def scan(
    plan: ScanPlan,
    arm: StopArm,
    array: RangeArray,
    hooks: WalkHooks,
    start_at: int = 0,
    parameters: ScanParameters = ScanParameters(),
) -> ScanOutcome:
    """Visit the stops of a plan from number `start_at` on.

    The order and the stops come from the plan alone: another walk (one smooth pass) takes the same plan, array and
    `sweep_of`.

    Raises
    ------
    SafetyStopError : the arm refuses a move, or moves while the array fires; every sweep before has been handed on.
    DeviceError : the arm fails, or the array fails more often than it may; every sweep before it has been handed on.
    ConfigError : the plan has no stop `start_at`.
    """
    if not 0 <= start_at <= len(plan):
        raise ConfigError(f"start_at = {start_at}, the plan has {len(plan)} stops", cure="start at one of them")
    began_s = arm.now_s()
    retried = 0
    stop = start_at
    while stop < len(plan) and not hooks.should_stop():
        hooks.before_stop(stop)
        try:
            standing = arm.go_to(plan, stop)
        except UnreachableError as error:
            hooks.on_unreachable(stop, error)
        else:
            sweep, again = _sweep_with_retries(plan, stop, standing, array, parameters.retries)
            arm.check_still(standing)
            retried += again
            hooks.on_sweep(sweep)
        stop += 1
    return ScanOutcome(stop, stop == len(plan), retried, arm.now_s() - began_s)


def _sweep_with_retries(
    plan: ScanPlan, stop: int, standing: ToolState, array: RangeArray, retries: int
) -> tuple[Sweep, int]:
    """The sweep of a stop, and how often it had to be fired again."""
    failures = 0
    while True:
        try:
            return take_sweep(stop, int(plan.row[stop]), standing, array), failures
        except DeviceError as error:
            failures += 1
            if failures > retries:
                raise DeviceError(
                    f"stop {stop} of {len(plan)}: the array failed {failures} times: {error.what}",
                    cure=error.cure or "check the array, then resume the run",
                    where=error.where,
                ) from error
