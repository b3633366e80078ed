"""Judging a ranger by what it read: each check measures one property, names one fault, and has one limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError
from surfuse.records import FloatArray, IntArray, SensorSpec, Status
from surfuse.rig.simulated.ranger_bench import KnownReadings

_MAD_TO_SIGMA = 1.4826
_SLIP_WINDOW = 0.25
_MOST_SLIPS = 4
_SOUND_SPEED_M_S = 343.2


@dataclass(frozen=True)
class AcceptanceLimits:
    """What a ranger must keep.

    Parameters
    ----------
    bias_m : largest mean error at any distance, to which the noise of the mean is added.
    noise_factor : largest standard deviation of one ping in units of the spec's.
    dropout : largest share of readings of a facing plate without a number.
    slip : largest share of readings that are late by whole half wavelengths.
    drift_m : largest change of the range between switching on and warmth.
    beam : largest relative deviation of the beam from the spec's.
    incidence_rad : by how much the usable incidence may fall short of the spec's.
    crosstalk : largest share of readings that a neighbour changes.
    """

    bias_m: float = 1.5e-3
    noise_factor: float = 2.0
    dropout: float = 0.02
    slip: float = 0.02
    drift_m: float = 1.0e-3
    beam: float = 0.20
    incidence_rad: float = float(np.radians(2.5))
    crosstalk: float = 0.0

    def __post_init__(self) -> None:
        for name in ("bias_m", "noise_factor", "drift_m", "beam"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give a limit > 0")


@dataclass(frozen=True)
class Check:
    """One property: the fault that it names when it fails, value and limit in `unit`; value None: not tested."""

    name: str
    fault: str
    value: float | None
    limit: float
    unit: str
    passed: bool
    note: str = ""

    def text(self) -> str:
        """For people."""
        if self.value is None:
            return f"not tested: {self.note}"
        _, measured, limit, verdict = self.cells()
        return f"{verdict}: {measured} (limit {limit.removesuffix(f' {self.unit}')})"

    def cells(self) -> tuple[str, str, str, str]:
        """For a table: name, what was measured, limit, verdict."""
        limit = f"{self.limit:.3g} {self.unit}"
        if self.value is None:
            return self.name, self.note, limit, "not tested"
        # No more digits than the limit makes matter.
        places = 0 if self.limit >= 100.0 else 1 if self.limit >= 10.0 else 2
        return self.name, f"{self.value:.{places}f} {self.unit}", limit, "pass" if self.passed else "FAIL"


@dataclass(frozen=True)
class Residuals:
    """Errors (N,) of a facing plate that have a number, which distance (N,) they belong to, and slips (N,)."""

    error_m: FloatArray
    group: IntArray
    slips: IntArray
    sigma_m: float
    tells_slips: bool


def residuals(facing: KnownReadings, spec: SensorSpec) -> Residuals:
    """Sort the errors of a facing plate into noise and cycle slips.

    Slips can be told only when the noise is below a quarter of half a wavelength.
    """
    good = facing.status == int(Status.OK)
    error = np.asarray((facing.range_m - facing.expected_m)[good], dtype=np.float64)
    _, group = np.unique(facing.axis_m[good], return_inverse=True)
    level = _by_group(error, group.astype(np.int64))
    late = error - level
    slips = np.zeros(len(error), dtype=np.int64)
    sigma_m = _robust(late)
    half_m = 0.5 * _SOUND_SPEED_M_S / spec.frequency_hz if spec.frequency_hz else 0.0
    tells = half_m > 0.0 and sigma_m < _SLIP_WINDOW * half_m
    if tells:
        whole = np.rint(late / half_m)
        fits = (np.abs(late - whole * half_m) < _SLIP_WINDOW * half_m) & (whole >= 1) & (whole <= _MOST_SLIPS)
        slips = np.where(fits, whole, 0).astype(np.int64)
        sigma_m = _robust(late[slips == 0])
    return Residuals(error, group.astype(np.int64), slips, sigma_m, tells)


def bias_check(found: Residuals, limits: AcceptanceLimits) -> Check:
    """Largest median error of any distance, slips apart."""
    kept = found.slips == 0
    medians = [float(np.median(found.error_m[kept & (found.group == g)])) for g in np.unique(found.group[kept])]
    worst = max((abs(median) for median in medians), default=np.inf)
    fewest = min((int(np.sum(kept & (found.group == g))) for g in np.unique(found.group[kept])), default=1)
    limit = limits.bias_m + 3.0 * 1.25 * found.sigma_m / np.sqrt(max(fewest, 1))
    return _check("accuracy against distance", "bias", 1e3 * worst, 1e3 * limit, "mm")


def noise_check(found: Residuals, spec: SensorSpec, limits: AcceptanceLimits) -> Check:
    """Robust standard deviation of single pings."""
    limit = limits.noise_factor * spec.sigma_m
    return _check("repeatability", "noise", 1e3 * found.sigma_m, 1e3 * limit, "mm")


def dropout_check(facing: KnownReadings, limits: AcceptanceLimits) -> Check:
    """Share of readings of a facing plate without a number."""
    return _check("answers of a facing plate", "dropout", 100.0 * (1.0 - facing.heard), 100.0 * limits.dropout, "%")


def slip_check(found: Residuals, limits: AcceptanceLimits) -> Check:
    """Share of readings that are late by whole half wavelengths."""
    name, fault, limit = "cycle slips", "cycle slips", 100.0 * limits.slip
    if not found.tells_slips:
        return not_tested(name, fault, limit, "%", "no wavelength, or too much noise to tell them")
    return _check(name, fault, 100.0 * float(np.mean(found.slips > 0)), limit, "%")


def drift_check(warm_up: KnownReadings | None, limits: AcceptanceLimits) -> Check:
    """Change of the range of a plate that stands still, from the first tenth of the time to the last third."""
    name, fault, limit = "warm-up drift", "drift", 1e3 * limits.drift_m
    if warm_up is None:
        return not_tested(name, fault, limit, "mm", "no readings from switching on")
    good = warm_up.status == int(Status.OK)
    order = np.argsort(warm_up.t_s[good], kind="stable")
    ranges = warm_up.range_m[good][order]
    if len(ranges) < 10:
        return not_tested(name, fault, limit, "mm", f"only {len(ranges)} readings with a number")
    first, last = ranges[: max(len(ranges) // 10, 3)], ranges[-len(ranges) // 3 :]
    return _check(name, fault, 1e3 * abs(float(np.median(first) - np.median(last))), limit, "mm")


def beam_check(measured_rad: float | None, expected_rad: float | None, limits: AcceptanceLimits) -> Check:
    """Deviation of the -6 dB beam from that of the spec's aperture."""
    name, fault, limit = "beam", "wrong beam", 100.0 * limits.beam
    if measured_rad is None or expected_rad is None:
        return not_tested(name, fault, limit, "%", "needs amplitudes over tilt")
    return _check(name, fault, 100.0 * abs(measured_rad / expected_rad - 1.0), limit, "%")


def incidence_check(usable_rad: float | None, spec: SensorSpec, limits: AcceptanceLimits) -> Check:
    """By how much the usable incidence of the tilted plate falls short of the spec's."""
    name, fault, limit = "usable incidence", "incidence", round(float(np.degrees(limits.incidence_rad)), 6)
    if usable_rad is None:
        return not_tested(name, fault, limit, "degrees short", "needs a plate at known tilts")
    # To a millionth of a degree: angles that were typed in degrees shall not fail by their rounding.
    short = round(float(np.degrees(max(spec.incidence_limit_rad - usable_rad, 0.0))), 6)
    return _check(name, fault, short, limit, "degrees short")


def crosstalk_check(matrix: FloatArray | None, limits: AcceptanceLimits) -> Check:
    """Largest share of readings that a neighbour's burst changes."""
    name, fault, limit = "cross-talk", "cross-talk", 100.0 * limits.crosstalk
    if matrix is None:
        return not_tested(name, fault, limit, "%", "needs several sensors that can be fired at will")
    return _check(name, fault, 100.0 * float(matrix.max()), limit, "%")


def not_tested(name: str, fault: str, limit: float, unit: str, note: str) -> Check:
    """A check without a value: it does not fail, and says so."""
    return Check(name, fault, None, limit, unit, True, note)


def _check(name: str, fault: str, value: float, limit: float, unit: str) -> Check:
    return Check(name, fault, value, limit, unit, bool(value <= limit))


def _robust(values: FloatArray) -> float:
    if len(values) == 0:
        return float("inf")
    return _MAD_TO_SIGMA * float(np.median(np.abs(values - np.median(values))))


def _by_group(values: FloatArray, group: IntArray) -> FloatArray:
    """The level (N,) of each value's group: the median of its lower half, which late readings do not reach."""
    level = np.zeros(len(values))
    for number in np.unique(group):
        mine = group == number
        level[mine] = np.median(values[mine])
    return level
