"""A point that travels on a straight line in time; twenty times as fast as told, so that tests are short."""

import math
import time

HASTE = 20.0


class Traveller:
    """Positions of any number of coordinates."""

    def __init__(self, where):
        self._start, self._end, self._began, self._takes_s = list(where), list(where), 0.0, 0.0

    def go(self, end, speed):
        self._start, self._end, self._began = self.where(), list(end), time.monotonic()
        self._takes_s = math.dist(self._start, self._end) / speed / HASTE

    def halt(self):
        self._start = self._end = self.where()
        self._takes_s = 0.0

    def moves(self):
        return time.monotonic() - self._began < self._takes_s

    def where(self):
        share = min(1.0, (time.monotonic() - self._began) / self._takes_s) if self._takes_s else 1.0
        return [a + share * (b - a) for a, b in zip(self._start, self._end, strict=True)]
