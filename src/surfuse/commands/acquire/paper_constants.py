"""The constants of the paper's method on scans that exist: what each does to the error, and which serve all best."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from surfuse import registry
from surfuse.commands.fuse.map_of_log import fused
from surfuse.commands.fuse.methods import create_method
from surfuse.errors import ConfigError
from surfuse.records import MapGrid, SurfaceMap
from surfuse.runs.scan_log import ScanLog
from surfuse.settings import FusionSettings
from surfuse.surface.dense_score import heights_between

PAPER = "weighted_average"
FACTORS = (0.125, 0.25, 0.5, 2.0, 4.0, 8.0)
"""Multiples of each constant that the search for the best common setting tries."""

SHOWN = (0.125, 0.5, 2.0, 8.0)
"""Multiples whose errors are shown, each constant changed alone: between twice and eight times a cliff may hide."""

ROUNDS = 3
LEAST_GAIN = 1e-3  # share of the error that a change must take away to be kept
COVERAGE_LOST = 0.005  # a setting that leaves more of the part out than this is none: what is missing has no error


@dataclass(frozen=True)
class TrialScan:
    """A scan that the constants are tried on: its log, the grid of its map, truth sampled every millimetre."""

    name: str
    scan: ScanLog
    grid: MapGrid
    dense: SurfaceMap


@dataclass(frozen=True)
class Constant:
    """One constant of the method by its name, and a value, in the unit of its name."""

    name: str
    value: float


@dataclass(frozen=True)
class Trial:
    """A setting, all of its constants, with the dense error in mm on each scan, in their order.

    `coverage` is the share (0 to 1) of the true part, sampled every millimetre, where each map has a value.
    """

    constants: tuple[Constant, ...]
    dense_rmse_mm: tuple[float, ...]
    coverage: tuple[float, ...]

    @property
    def mean_mm(self) -> float:
        """Geometric mean of the errors; inf where a scan gave no map."""
        if not all(math.isfinite(one) for one in self.dense_rmse_mm):
            return math.inf
        return float(np.exp(np.mean(np.log(np.maximum(self.dense_rmse_mm, 1e-6)))))


@dataclass(frozen=True)
class Sensitivity:
    """What one constant does: the trials with `SHOWN` times its value, None where that is not allowed."""

    constant: Constant
    trials: tuple[Trial | None, ...]


@dataclass(frozen=True)
class ConstantsStudy:
    """The method as configured, at the best setting for all scans together, and with each constant changed alone."""

    configured: Trial
    best: Trial
    sensitivity: tuple[Sensitivity, ...]

    @property
    def changed(self) -> tuple[Constant, ...]:
        """The constants that the best setting has otherwise than configured, with its values."""
        before = {one.name: one.value for one in self.configured.constants}
        return tuple(one for one in self.best.constants if one.value != before[one.name])


def study_constants(scans: Sequence[TrialScan], settings: FusionSettings, go_on: Callable[[], None]) -> ConstantsStudy:
    """Change the constants of the paper's method, one at a time and then together, on readings that exist.

    The best common setting is searched by coordinates over `FACTORS` times each constant, by the geometric mean of the
    dense errors of all scans; nothing says that it is the best of all. `go_on` is called before each constant, and
    raises to end the study.

    Raises
    ------
    ConfigError : the configured constants are out of their limits.
    """
    bench = _Bench(scans, settings)
    configured = bench.trial(configured_constants(settings))
    if configured is None:
        raise ConfigError(f"fusion.parameters.{PAPER} cannot be used", cure="give constants within their limits")
    sensitivity = []
    for constant in configured.constants:
        go_on()
        trials = tuple(bench.trial(_with(configured.constants, constant, factor)) for factor in SHOWN)
        sensitivity.append(Sensitivity(constant, trials))
    return ConstantsStudy(configured, _best(bench, configured, go_on), tuple(sensitivity))


def configured_constants(settings: FusionSettings) -> tuple[Constant, ...]:
    """The method's constants that are numbers, with the values that they are configured to have."""
    values = settings.parameters.get(PAPER, {})
    parameters = registry.parameters("fusion", PAPER, values, f"fusion.parameters.{PAPER}")
    assert dataclasses.is_dataclass(parameters)
    named = [(one.name, getattr(parameters, one.name)) for one in dataclasses.fields(parameters)]
    return tuple(Constant(name, value) for name, value in named if isinstance(value, float))


def with_constants(settings: FusionSettings, constants: Sequence[Constant]) -> FusionSettings:
    """The settings with these constants of the paper's method."""
    values = {**settings.parameters.get(PAPER, {}), **{one.name: one.value for one in constants}}
    return settings.model_copy(update={"parameters": {**settings.parameters, PAPER: values}})


class _Bench:
    """Tries settings on the scans, each once."""

    def __init__(self, scans: Sequence[TrialScan], settings: FusionSettings) -> None:
        self._scans, self._settings = tuple(scans), settings
        self._tried: dict[tuple[Constant, ...], Trial | None] = {}

    def trial(self, constants: tuple[Constant, ...]) -> Trial | None:
        """The errors with these constants; None where the method does not take them."""
        if constants not in self._tried:
            self._tried[constants] = self._try(constants)
        return self._tried[constants]

    def _try(self, constants: tuple[Constant, ...]) -> Trial | None:
        try:
            method = create_method(with_constants(self._settings, constants), PAPER)
        except ConfigError:
            return None
        errors, coverage = [], []
        for one in self._scans:
            _, surface = fused(one.scan, method, one.grid)
            error = (heights_between(surface, one.dense.grid) - one.dense.height_m)[one.dense.mask]
            found = error[np.isfinite(error)]
            errors.append(1e3 * float(np.sqrt(np.mean(found**2))) if len(found) else math.nan)
            coverage.append(len(found) / max(1, len(error)))
        return Trial(constants, tuple(errors), tuple(coverage))


def _best(bench: _Bench, start: Trial, go_on: Callable[[], None]) -> Trial:
    best = start
    for _ in range(ROUNDS):
        before = best
        for constant in start.constants:
            go_on()
            trials = [bench.trial(_with(best.constants, constant, factor)) for factor in (1.0, *FACTORS)]
            whole = [one for one in trials if one is not None and _covers(one, start)]
            found = min(whole, key=lambda one: one.mean_mm, default=best)
            if found.mean_mm < best.mean_mm * (1.0 - LEAST_GAIN):
                best = found
        if best is before:
            break
    return best


def _covers(trial: Trial, start: Trial) -> bool:
    """Whether a setting leaves no more of any part out than the first one did."""
    return all(now >= then - COVERAGE_LOST for now, then in zip(trial.coverage, start.coverage, strict=True))


def _with(constants: tuple[Constant, ...], changed: Constant, factor: float) -> tuple[Constant, ...]:
    """The constants, one of them a multiple of the value given in `changed`."""
    return tuple(Constant(one.name, factor * changed.value) if one.name == changed.name else one for one in constants)
