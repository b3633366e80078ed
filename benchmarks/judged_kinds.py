"""Kinds of parts that are hard for first echoes: one set to develop on, and kinds that are kept aside.

The set to develop on holds terraces, treads, chamfers, bolts, ribs, waves and steps of several heights. The kinds kept
aside (raised and sunk shapes, crossed ribs, cones, spirals, leaning things) serve figures and nothing else.
"""

from __future__ import annotations

import numpy as np
from judged_scenes import Array, Height, JudgedScene


def _smooth_step(x: Array, width: float) -> Array:
    """0 to 1 by a straight ramp about 0."""
    return np.clip(x / width + 0.5, 0.0, 1.0)


def _terraces(sizes_m: tuple[float, ...], rise_m: float) -> Height:
    """Square terraces, one upon the other; the first is the floor."""
    return lambda u, v: sum(rise_m * (np.maximum(np.abs(u), np.abs(v)) < 0.5 * s) for s in sizes_m[1:]) + 0.0 * u


def _discs(places: tuple[tuple[float, float], ...], radius_m: float, height_m: float) -> Height:
    return lambda u, v: sum(height_m * (np.hypot(u - a, v - b) < radius_m) for a, b in places) + 0.0 * u


def kinds_to_develop_on() -> list[JudgedScene]:
    """Kinds that the constants may be chosen on."""
    s = JudgedScene
    return [
        s("pyramid", "kinds", _terraces((0.2, 0.14, 0.08), 0.02)),
        s("pyramid, higher", "kinds", _terraces((0.2, 0.13, 0.07), 0.03)),
        s("stairs", "kinds", lambda u, v: 0.012 * np.floor((u + 0.1) / 0.03)),
        s("stairs along v", "kinds", lambda u, v: 0.02 * np.floor((v + 0.097) / 0.045)),
        s("waves 10 mm, 12 cm", "kinds", lambda u, v: 0.01 * np.cos(2.0 * np.pi * u / 0.12)),
        s("chamfer 3 cm", "kinds", lambda u, v: -np.clip(u - 0.02, 0.0, 0.03)),
        s("bolts", "kinds", _discs(((-0.04, 0.02), (0.045, -0.03)), 0.01, 0.015)),
        s("rib 8 mm", "kinds", lambda u, v: np.where(np.abs(u - 0.003) < 0.004, 0.03, 0.0)),
        s("step 3 cm", "kinds", lambda u, v: np.where(v < 0.007, 0.03, 0.0), edge="v"),
        s("step 9 cm", "kinds", lambda u, v: np.where(u < 0.012, 0.09, 0.0), edge="u"),
        s("step 5 cm", "kinds", lambda u, v: np.where(u < -0.0085, 0.05, 0.0), edge="u"),
        s("step 4 cm, slope 5 deg", "kinds", lambda u, v: np.where(v > 0.011, 0.04, 0.0) + 0.0875 * u, edge="v"),
        s("corner step", "kinds", lambda u, v: np.where((u < 0.01) & (v < 0.02), 0.04, 0.0)),
    ]


def _ring(u: Array, v: Array) -> Array:
    r = np.hypot(u, v)
    return np.where((r > 0.035) & (r < 0.065), 0.025, 0.0)


def _letter(u: Array, v: Array) -> Array:
    stem, bar = _inside(u, v, 0.015, 0.07), _inside(u, v - 0.05, 0.06, 0.02)
    return np.where(stem | bar, 0.03, 0.0)


def _pocket(u: Array, v: Array) -> Array:
    island = np.where(np.hypot(u - 0.01, v) < 0.03, 0.025, 0.0)
    return np.where(_inside(u, v, 0.07, 0.07), -0.025, 0.0) + island


def _sloped_block(u: Array, v: Array) -> Array:
    return 0.04 * _smooth_step(0.06 - np.maximum(np.abs(u), np.abs(v)), 0.03)


def _hump(u: Array, v: Array) -> Array:
    return np.where(v < -0.02, 0.04, 0.02 * np.exp(-((v - 0.04) ** 2 + u**2) / 0.0008))


def _inside(u: Array, v: Array, half_u: float, half_v: float) -> Array:
    return (np.abs(u) < half_u) & (np.abs(v) < half_v)


def kinds_kept_aside() -> list[JudgedScene]:
    """Kinds of which no figure was looked at while a constant was chosen."""
    s = JudgedScene
    ridge = np.tan(np.radians(20.0))
    return [
        s("ring raised", "aside", _ring),
        s("letter raised", "aside", _letter),
        s("pocket with island", "aside", _pocket),
        s("crossed ribs", "aside",
          lambda u, v: np.where((np.abs(u + 0.02) < 0.012) | (np.abs(v - 0.01) < 0.012), 0.02, 0.0)),
        s("cone", "aside", lambda u, v: np.clip(0.05 - 0.6 * np.hypot(u, v), 0.0, None)),
        s("block with sloped sides", "aside", _sloped_block),
        s("spiral ramp", "aside", lambda u, v: 0.03 * np.mod(np.arctan2(v, u) / (2.0 * np.pi), 1.0)),
        s("leaning slab", "aside", lambda u, v: np.where(_inside(u, v, 0.05, 0.06), 0.04 + 0.35 * u, 0.0)),
        s("hump beside a step", "aside", _hump),
        s("sunk disc", "aside", lambda u, v: np.where(np.hypot(u + 0.01, v) < 0.06, -0.02, 0.0)),
        s("ridge and plane", "aside", lambda u, v: np.where(u < 0.0, 0.0, ridge * np.minimum(u, 0.1 - u))),
        s("two plates apart", "aside", lambda u, v: np.where(u + 0.3 * v < -0.01, 0.035, 0.0) + 0.1 * v),
    ]  # fmt: skip
