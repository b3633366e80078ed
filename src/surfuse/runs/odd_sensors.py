"""Sensors that a scan learns nothing from, though nothing fails: dead ones, and those that always say the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from surfuse.records import BoolArray, FloatArray, ReadingColumns, Readings, SensorSpec, Status

LEAST_READINGS = 8
"""Fewer say nothing about a sensor."""

_SAME_M = 1e-9
_MOVED_M = 1e-3  # a sensor that stays where it is may well hear the same
_MOST_NAMED = 6  # the zones of one chip are sensors of their own: 64 sentences would hide all others
_WORDS = ((Status.NO_ECHO, "no echo"), (Status.TOO_CLOSE, "too close"), (Status.FAULT, "fault or no answer"))


@dataclass
class _Heard:
    """What one sensor said so far: readings by status, its nearest and farthest range, the box it moved in."""

    counts: dict[Status, int] = field(default_factory=lambda: dict.fromkeys(Status, 0))
    least_m: float = np.inf
    most_m: float = -np.inf
    low_m: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    high_m: FloatArray = field(default_factory=lambda: np.full(3, -np.inf))

    def take(self, columns: ReadingColumns, mine: BoolArray) -> None:
        """The readings of the rows `mine` (N,) bool."""
        status = columns.status[mine]
        for one in Status:
            self.counts[one] += int(np.count_nonzero(status == int(one)))
        ranges_m = columns.range_m[mine][status == int(Status.OK)]
        places_m = columns.position_m[mine][status == int(Status.OK)]
        self.least_m = float(np.min(ranges_m, initial=self.least_m))
        self.most_m = float(np.max(ranges_m, initial=self.most_m))
        self.low_m = np.minimum(self.low_m, np.min(places_m, axis=0, initial=np.inf))
        self.high_m = np.maximum(self.high_m, np.max(places_m, axis=0, initial=-np.inf))

    @property
    def readings(self) -> int:
        return sum(self.counts.values())

    @property
    def echoes(self) -> int:
        return self.counts[Status.OK]

    @property
    def judged(self) -> bool:
        """Whether there are echoes enough, from places enough, to expect that they differ."""
        return self.echoes >= LEAST_READINGS and float(np.max(self.high_m - self.low_m)) > _MOVED_M

    @property
    def same(self) -> bool:
        return self.judged and self.most_m - self.least_m <= _SAME_M


class HeardOfSensors:
    """Gathers what each sensor of a scan said, sweep by sweep or all at once; small, however long the scan is."""

    def __init__(self, specs: Sequence[SensorSpec]) -> None:
        self._names = tuple(spec.name for spec in specs)
        self._heard = tuple(_Heard() for _ in specs)
        self._sweeps = 0

    def take(self, columns: ReadingColumns, sweeps: int = 1) -> None:
        """The readings of so many sweeps."""
        self._sweeps += sweeps
        for number, heard in enumerate(self._heard):
            heard.take(columns, columns.sensor == number)

    def sentences(self) -> tuple[str, ...]:
        """What is odd, a sentence for each sensor; a scan too short to tell has none."""
        return (*_few(self._silent()), *_few(self._stuck()))

    def _silent(self) -> dict[str, str]:
        """Sensors without a single echo. A sensor is fired as often as the others, even if it never answers."""
        fired = max((heard.readings for heard in self._heard), default=0) or self._sweeps
        if fired < LEAST_READINGS:
            return {}
        pairs = zip(self._names, self._heard, strict=True)
        return {name: _silence(name, heard, fired) for name, heard in pairs if heard.echoes == 0}

    def _stuck(self) -> dict[str, str]:
        """Sensors whose echoes are all the same.

        A plate that faces the array gives every sensor without noise the same range everywhere: where all of several
        sensors do so, none is called stuck.
        """
        judged = {name: heard for name, heard in zip(self._names, self._heard, strict=True) if heard.judged}
        same = {name: heard for name, heard in judged.items() if heard.same}
        if len(judged) == 1:
            return {name: _sameness(name, heard) + _LONE for name, heard in same.items()}
        if len(same) == len(judged):
            return {}
        return {name: _sameness(name, heard) + _AMONG_OTHERS for name, heard in same.items()}


_LONE = (
    ": right for a flat part that faces it, but a stuck sensor says the same and there is no other one to compare "
    "with; hold something before it and read it with 'surfuse doctor --cell'"
)
_AMONG_OTHERS = (
    " while the ranges of other sensors vary: it is stuck, or hears something that moves along with it; hold something "
    "before it and read it with 'surfuse doctor --cell'"
)


def _silence(name: str, heard: _Heard, fired: int) -> str:
    cure = "the map is made without it; check its cable, its power and where it points"
    if heard.readings == 0:
        return f"sensor '{name}' gave no reading at all, {fired} were due: {cure}"
    kinds = [f"{words} {heard.counts[status]}" for status, words in _WORDS if heard.counts[status]]
    missing = fired - heard.readings
    told = ", ".join([*kinds, *([f"missing {missing}"] if missing else [])])
    return f"sensor '{name}' gave no echo in {fired} of {fired} readings (status: {told}): {cure}"


def _sameness(name: str, heard: _Heard) -> str:
    answer = f"{1e3 * heard.least_m:.1f} mm in {heard.echoes} of {heard.echoes} echoes"
    return f"sensor '{name}' answered {answer}, the very same range from different places"


def _few(sentences: dict[str, str]) -> tuple[str, ...]:
    """All of them, or the first few and the names of the rest."""
    told, rest = list(sentences.values())[:_MOST_NAMED], list(sentences)[_MOST_NAMED:]
    return (*told, f"the same of {len(rest)} more sensors: {', '.join(rest)}") if rest else tuple(told)


def odd_sensors(readings: Readings) -> tuple[str, ...]:
    """A sentence, with the name, the count and the cure, for each sensor that is dead or stuck."""
    heard = HeardOfSensors(readings.specs)
    heard.take(readings, readings.n_sweeps)
    return heard.sentences()
