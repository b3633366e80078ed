"""Codes that say what became of a reading, a point or a cell."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """What a reading is; the range then is finite, +inf, -inf or nan in this order."""

    OK = 0
    NO_ECHO = 1
    TOO_CLOSE = 2
    FAULT = 3


class Gate(IntEnum):
    """Why validation kept a reading out of the average; the order is the order of the tests."""

    PASSED = 0
    NO_ECHO = 1
    TOO_CLOSE = 2
    FAULT = 3
    OUT_OF_RANGE = 4
    OUTSIDE_PART = 5
    BEHIND_CELL = 6


class Gap(IntEnum):
    """Why a stop has no fused value."""

    NONE = 0
    NO_VALID_READING = 1
    NO_CONFIDENCE = 2
    OUTSIDE_PART = 3


class Regime(IntEnum):
    """What the value of a map cell rests on; RAY: light or contact, which measure where their axis ends."""

    EMPTY = 0
    MEASURED = 1
    MIRROR = 2
    SPECKLE = 3
    EDGE = 4
    PRIOR = 5
    RAY = 6
