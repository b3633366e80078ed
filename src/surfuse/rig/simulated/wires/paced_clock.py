"""The clock of this machine, on which devices may take less time than they would."""

from __future__ import annotations

import time


class PacedClock:
    """Waiting takes `1 / times_faster` of the time."""

    def __init__(self, times_faster: float) -> None:
        self._times_faster = times_faster

    def now_s(self) -> float:
        """Seconds of this machine since an arbitrary moment."""
        return time.monotonic()

    def advance(self, duration_s: float) -> None:
        """Wait."""
        time.sleep(max(duration_s, 0.0) / self._times_faster)
