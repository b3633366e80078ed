"""The one way in which the command line reads numbers: finite, and within limits that the message names."""

from __future__ import annotations

import math
from dataclasses import dataclass

import typer

PORT_MAX = 65535
SEED_MAX = 2**63 - 1


@dataclass(frozen=True)
class Real:
    """Reads a finite number from `low` to `high`; `above`: not `low` itself."""

    low: float
    high: float
    above: bool = False

    @property
    def __name__(self) -> str:
        return "number"

    def __call__(self, text: str | float) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise typer.BadParameter(f"no finite number, wanted {self._limits}")
        if not (self.low <= value <= self.high) or (self.above and value == self.low):
            raise typer.BadParameter(f"{value:g} is out of its limits, wanted {self._limits}")
        return value

    @property
    def _limits(self) -> str:
        return f"{'more than' if self.above else 'from'} {self.low:g} {'up ' if self.above else ''}to {self.high:g}"


@dataclass(frozen=True)
class Whole:
    """Reads an integer from `low` to `high`."""

    low: int
    high: int

    @property
    def __name__(self) -> str:
        return "integer"

    def __call__(self, text: str | int) -> int:
        try:
            value = int(text)
        except ValueError:
            raise typer.BadParameter(f"not a valid integer, wanted from {self.low} to {self.high}") from None
        if not self.low <= value <= self.high:
            raise typer.BadParameter(f"{value} is out of its limits, wanted from {self.low} to {self.high}")
        return value
