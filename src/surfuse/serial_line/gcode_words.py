"""Places of a machine, as messages and G-code write them."""

from __future__ import annotations

Millimetres = tuple[float, float, float]
"""x, y, z in the machine's own coordinates."""


def shown(place_mm: Millimetres) -> str:
    """A place as it is written in messages."""
    return ", ".join(f"{axis} = {value:.3f}" for axis, value in zip("xyz", place_mm, strict=True)) + " mm"


def axes_words(place_mm: Millimetres) -> str:
    """A place as words of G-code."""
    return " ".join(f"{axis}{value:.3f}" for axis, value in zip("XYZ", place_mm, strict=True))
