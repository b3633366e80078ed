"""Bytes in any portions to frames of fixed length with a header and an 8-bit sum at the end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from surfuse.records import Status

_RANGE_OF = {Status.NO_ECHO: math.inf, Status.TOO_CLOSE: -math.inf, Status.FAULT: math.nan}


@dataclass(frozen=True)
class LineReading:
    """What one frame says; the range is +inf, -inf or nan when the status is not OK."""

    range_m: float
    status: Status
    amplitude: float = math.nan


def without_range(status: Status) -> LineReading:
    """A reading that has no number, as REP-117 writes it."""
    return LineReading(_RANGE_OF[status], status)


class LineParser(Protocol):
    """Incremental and free of side effects: bytes in, readings out; `rejected` counts what was no frame."""

    rejected: int

    def feed(self, data: bytes) -> list[LineReading]: ...
    def reset(self) -> None: ...


class SummedFrames:
    """Frames `header ... sum`, where sum is that of all bytes before it modulo 256.

    After damage a frame counts only when it follows a good one without a gap: one sum of 8 bits is met by one random
    piece of the stream in 256, two in a row are not.

    Parameters
    ----------
    header : how a frame begins.
    length : bytes of a frame, header and sum included.
    interpret : a whole, good frame to its reading.
    """

    def __init__(self, header: bytes, length: int, interpret: Callable[[bytes], LineReading]) -> None:
        self._header, self._length, self._interpret = header, length, interpret
        self._buffer = bytearray()
        self._in_step = True
        self.rejected = 0

    def feed(self, data: bytes) -> list[LineReading]:
        """Readings of the frames that these bytes complete."""
        readings = []
        self._buffer += data
        while len(self._buffer) >= self._length:
            frame = bytes(self._buffer[: self._length])
            if frame.startswith(self._header) and sum(frame[:-1]) & 0xFF == frame[-1]:
                if self._in_step:
                    readings.append(self._interpret(frame))
                self._in_step = True
                del self._buffer[: self._length]
            else:
                self.rejected += self._in_step
                self._in_step = False
                del self._buffer[: self._next_header()]
        return readings

    def reset(self) -> None:
        """Forget the bytes of a frame that has only begun."""
        self._buffer.clear()
        self._in_step = True

    def _next_header(self) -> int:
        found = self._buffer.find(self._header[:1], 1)
        return len(self._buffer) if found < 0 else found
