"""Rangers that send at the same moment: each driver in a thread of its own, let go together."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from surfuse.interfaces import RangeSensor
from surfuse.records import Echo


class ThreadedVolley:
    """A `SimultaneousFire` of any drivers; they start within the jitter of the scheduler.

    Parameters
    ----------
    sensors : the rangers in the order of their numbers in the node.
    """

    def __init__(self, sensors: Sequence[RangeSensor]) -> None:
        self._sensors = tuple(sensors)

    def __call__(self, numbers: Sequence[int]) -> tuple[Echo | None, ...]:
        """One echo of each sensor, None of one whose driver failed."""
        start = threading.Barrier(len(numbers))
        with ThreadPoolExecutor(len(numbers), "surfuse-volley") as pool:
            return tuple(pool.map(lambda number: self._fired(number, start), numbers))

    def _fired(self, number: int, start: threading.Barrier) -> Echo | None:
        start.wait()
        try:
            return self._sensors[number].fire()
        except Exception:  # a driver is foreign code: whatever breaks in it must not stop the node
            return None
