"""Parts of the judgement: height fields with their outlines, one set to develop on and one that is held out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
Height = Callable[[Array, Array], Array]
STEP_M = 0.001
GROUPS = ("facing", "tilted", "step", "curved", "other", "turned")


@dataclass(frozen=True)
class JudgedScene:
    """One part: height (m) over (u, v), extent +-`half_m`, where it is (None: everywhere), how the wrist is turned.

    `edge` names the axis across which a straight step lies ("" for none); `wrist_deg` turns wrist and readings along
    the normal of a plate tilted about v.
    """

    name: str
    group: str
    height: Height
    half_m: tuple[float, float] = (0.1, 0.1)
    inside: Height | None = None
    outline_m: Array | None = None
    edge: str = ""
    wrist_deg: float = 0.0
    tilt_deg: float = 0.0

    def within(self, u: Array, v: Array) -> Array:
        """Where the part is."""
        box = (np.abs(u) <= self.half_m[0] + 1e-9) & (np.abs(v) <= self.half_m[1] + 1e-9)
        return box if self.inside is None else box & self.inside(u, v)

    def outline(self, larger: float = 1.01) -> Array:
        """Corners (K, 2) as a camera sees them: one per cent too large."""
        a, b = self.half_m
        corners = np.array([[-a, -b], [a, -b], [a, b], [-a, b]]) if self.outline_m is None else self.outline_m
        return larger * corners

    def mesh(self) -> tuple[Array, Array]:
        """Vertices (V, 3) on a raster of one millimetre and triangles (F, 3), wound to face +w."""
        count = [round(h / STEP_M) for h in self.half_m]
        u, v = (np.linspace(-h, h, 2 * n + 1) for h, n in zip(self.half_m, count, strict=True))
        uu, vv = np.meshgrid(u, v)
        vertices = np.column_stack([uu.ravel(), vv.ravel(), self.height(uu, vv).ravel()])
        first = (np.arange(len(v) - 1)[:, None] * len(u) + np.arange(len(u) - 1)[None, :]).ravel()
        right, up = first + 1, first + len(u)
        faces = np.vstack([np.column_stack([first, right, up + 1]), np.column_stack([first, up + 1, up])])
        return vertices, faces[self.within(uu, vv).ravel()[faces].all(axis=1)]


def plane(a: float, b: float = 0.0) -> Height:
    """Tilted by a degrees along u and b degrees along v."""
    return lambda u, v: np.tan(np.radians(a)) * u + np.tan(np.radians(b)) * v


def tilted(a: float, group: str = "tilted", wrist: float = 0.0) -> JudgedScene:
    name = f"{'turned' if wrist else 'plate'} {a:g} deg"
    return JudgedScene(name, group, plane(a), (0.1 * np.cos(np.radians(a)), 0.1), wrist_deg=wrist, tilt_deg=a)


def ball(radius: float, sign: float = 1.0, u_only: bool = False, v_only: bool = False) -> Height:
    """Part of a sphere, or of a cylinder; sign -1: hollow."""
    return lambda u, v: sign * (np.sqrt(radius**2 - (0 if v_only else u**2) - (0 if u_only else v**2)) - radius)


def waves(amplitude: float, length: float, direction_deg: float = 0.0) -> Height:
    c, s = np.cos(np.radians(direction_deg)), np.sin(np.radians(direction_deg))
    return lambda u, v: amplitude * np.sin(2.0 * np.pi * (c * u + s * v) / length)


def circle(radius: float) -> Array:
    angle = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _development() -> list[JudgedScene]:
    s = JudgedScene
    corner = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.0], [0.0, 0.0], [0.0, 0.1], [-0.1, 0.1]])
    return [
        s("plate", "facing", plane(0.0)),
        *(tilted(a) for a in (5.0, 8.0, 12.0, 20.0, 25.0, 30.0, 35.0)),
        s("plate 15 and 14 deg", "tilted", plane(15.0, 14.0), (0.095, 0.095)),
        s("relief", "step", lambda u, v: np.where(v < 0.0, 0.09, 0.0), edge="v"),
        s("relief between nodes", "step", lambda u, v: np.where(u < -0.017, 0.09, 0.0), edge="u"),
        s("relief 5 cm", "step", lambda u, v: np.where(u > 0.013, 0.05, 0.0), edge="u"),
        s("cylinder 25 cm", "curved", ball(0.25, v_only=True)),
        s("cylinder 15 cm", "curved", ball(0.15, v_only=True), (0.1, 0.09)),
        s("hollow cylinder 40 cm", "curved", ball(0.4, -1.0, v_only=True)),
        s("sphere 30 cm", "curved", ball(0.3)),
        s("bowl 35 cm", "curved", ball(0.35, -1.0)),
        s("saddle 25 cm", "curved", lambda u, v: 2.0 * (u**2 - v**2)),
        s("waves 8 mm, 12 cm", "curved", waves(0.008, 0.12)),
        s("waves 6 mm, 10 cm", "curved", waves(0.006, 0.1, 36.9)),
        s("egg box 6 mm", "curved", lambda u, v: 0.006 * np.cos(48.3 * u) * np.cos(41.9 * v)),
        s("terraces 3 cm", "other", lambda u, v: 0.03 * ((u > -0.0333) * 1.0 + (u >= 0.0333))),
        s("groove 6 cm", "other", lambda u, v: np.where(np.abs(u) < 0.03, -0.03, 0.0)),
        s("panel", "other", lambda u, v: np.where((np.abs(u) < 0.06) & (np.abs(v) < 0.06), -0.03, 0.0)),
        s("block", "other", lambda u, v: np.where((np.abs(u - 0.01) < 0.055) & (np.abs(v + 0.01) < 0.05), 0.05, 0.0)),
        s("step across", "other", lambda u, v: np.where(u + 0.6 * v > 0.004, 0.06, 0.0)),
        s("roof 12 deg", "other", lambda u, v: -np.tan(np.radians(12.0)) * np.abs(u)),
        s("L-shape", "other", plane(0.0, 5.0), inside=lambda u, v: (u <= 0) | (v <= 0), outline_m=corner),
        s("dome on a disc", "other", ball(0.3), (0.09, 0.09), lambda u, v: u**2 + v**2 <= 0.0081, circle(0.09)),
        s("hole", "other", plane(0.0), inside=lambda u, v: u**2 + v**2 >= 0.035**2),
        *(tilted(a, "turned", a) for a in (20.0, 60.0)),
    ]  # fmt: skip


def _held_out() -> list[JudgedScene]:
    s = JudgedScene
    trapezium = np.array([[-0.1, -0.09], [0.1, -0.09], [0.06, 0.09], [-0.06, 0.09]])
    return [
        s("plate", "facing", lambda u, v: 0.0 * u + 0.004, (0.11, 0.09)),
        *(tilted(a) for a in (3.0, 10.0, 15.0, 20.0, 22.0, 30.0)),
        s("plate 20 deg about u", "tilted", plane(0.0, -20.0), (0.1, 0.094)),
        s("plate 8 and 17 deg", "tilted", plane(-8.0, 17.0), (0.097, 0.095)),
        s("relief", "step", lambda u, v: np.where(v < 0.0, 0.09, 0.0), (0.11, 0.1), edge="v"),
        s("relief between nodes", "step", lambda u, v: np.where(v > 0.024, 0.09, 0.0), edge="v"),
        s("relief 7 cm", "step", lambda u, v: np.where(u < 0.006, 0.07, 0.0), edge="u"),
        s("cylinder 30 cm", "curved", ball(0.3, u_only=True)),
        s("cylinder 20 cm, askew", "curved", lambda u, v: np.sqrt(0.04 - (0.8 * u - 0.6 * v) ** 2) - 0.2, (0.09, 0.09)),
        s("hollow cylinder 50 cm", "curved", ball(0.5, -1.0, u_only=True)),
        s("sphere 45 cm", "curved", ball(0.45)),
        s("bowl 60 cm", "curved", ball(0.6, -1.0)),
        s("saddle 40 cm", "curved", lambda u, v: 2.5 * u * v),
        s("waves 5 mm, 14 cm", "curved", waves(0.005, 0.14, 90.0)),
        s("waves 10 mm, 16 cm", "curved", waves(0.01, 0.16, 20.0)),
        s("waves 3 mm, 8 cm", "curved", waves(0.003, 0.08)),
        s("terraces 2.5 cm", "other", lambda u, v: 0.025 * ((v > -0.036) * 1.0 + (v > 0.031))),
        s("groove 9 cm", "other", lambda u, v: np.where(np.abs(v - 0.006) < 0.045, -0.04, 0.0)),
        s("groove 4 cm", "other", lambda u, v: np.where(np.abs(u + 0.012) < 0.02, -0.02, 0.0)),
        s("panel 11 cm", "other", lambda u, v: np.where((np.abs(u) < 0.054) & (np.abs(v) < 0.056), -0.02, 0.0)),
        s("block", "other", lambda u, v: np.where((np.abs(u + 0.02) < 0.046) & (np.abs(v) < 0.064), 0.035, 0.0)),
        s("step on a slope", "other", lambda u, v: np.where(v < 0.004, 0.06, 0.0) + 0.1 * u),
        s("roof 18 deg", "other", lambda u, v: -np.tan(np.radians(18.0)) * np.abs(v)),
        s("trapezium", "other", plane(6.0), (0.1, 0.09), lambda u, v: np.abs(u) <= 0.08 - 0.2222 * v, trapezium),
        s("disc", "other", plane(0.0), (0.08, 0.08), lambda u, v: u**2 + v**2 <= 0.0064, circle(0.08)),
        s("two holes", "other", plane(3.0), inside=lambda u, v: ((np.abs(u) - 0.05) ** 2 + v**2) >= 0.02**2),
        *(tilted(a, "turned", a) for a in (5.0, 30.0, 45.0)),
    ]  # fmt: skip


def scenes(held_out: bool) -> list[JudgedScene]:
    """The parts of one set."""
    return _held_out() if held_out else _development()
