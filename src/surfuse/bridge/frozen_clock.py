"""A clock that stands still over moves and sweeps, which nobody else would notice: it neither goes back nor jumps."""

from __future__ import annotations

from collections.abc import Sequence

from surfuse.errors import SafetyStopError

FROZEN_SWEEPS = 5
"""So many sweeps in a row, each after a move, may have the stamps of the one before."""


class FrozenClock:
    """Compares the stamps of sweeps; the clock of a simulation advances at least over a move or a sweep."""

    def __init__(self, where: str) -> None:
        self._where = where
        self.new_connection()

    def new_connection(self) -> None:
        """A bridge that was started again counts anew."""
        self._told_s: float | None = None
        self._times, self._moved = 0, False

    def moved(self) -> None:
        """The arm has come to where it was sent."""
        self._moved = True

    def take(self, times_s: Sequence[float]) -> None:
        """The stamps of a sweep; one without a reading says nothing.

        Raises
        ------
        SafetyStopError : the clock stands still; with value and limit.
        """
        if not times_s:
            return
        if any(time_s != self._told_s for time_s in times_s):
            self._told_s, self._times = max(times_s), 0
        elif self._moved:
            self._times += 1
        self._moved = False
        if self._times >= FROZEN_SWEEPS:
            raise SafetyStopError(
                f"the clock of the bridge stands still: t_s = {self._told_s:.6f} in {self._times} sweeps in a row that "
                f"came after moves, below {FROZEN_SWEEPS} may repeat the stamps of the one before",
                where=self._where,
                cure="stamp each reading and state with the time at which it was taken (time.monotonic)",
            )
