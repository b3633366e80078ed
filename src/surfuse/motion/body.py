"""The volume of an arm as spheres that ride on its links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.compiled import compiled
from surfuse.records import Fixture, FloatArray, IntArray


@dataclass(frozen=True)
class Capsule:
    """A rod with round ends on link `link` (index into the link poses), from start to end (3,) in that frame.

    `name` is what messages call it. `start_m` and `end_m` (3,) are the ends of its centre line, `radius_m` its
    thickness about that line; all in m. A ball has two equal ends.
    """

    name: str
    link: int
    start_m: tuple[float, float, float]
    end_m: tuple[float, float, float]
    radius_m: float

    def __post_init__(self) -> None:
        if not (self.radius_m > 0.0 and np.all(np.isfinite([*self.start_m, *self.end_m, self.radius_m]))):
            raise ConfigError(f"'{self.name}' has radius {self.radius_m} m", cure="give a positive radius")


@dataclass(frozen=True)
class Body:
    """Spheres (B,): `link` they ride on, `center_m` (B, 3) in that link's frame, `radius_m`; `part` indexes `names`."""

    names: tuple[str, ...]
    part: IntArray
    link: IntArray
    center_m: FloatArray
    radius_m: FloatArray

    def place(self, link_poses: FloatArray) -> FloatArray:
        """Centres (N, B, 3) in the world for link poses (N, L, 4, 4)."""
        return _placed(np.ascontiguousarray(link_poses), self.link, self.center_m)


@compiled
def _placed(links: FloatArray, link: IntArray, centers: FloatArray) -> FloatArray:
    n, count = links.shape[0], link.shape[0]
    placed = np.empty((n, count, 3))
    for i in range(n):
        for b in range(count):
            pose = links[i, link[b]]
            x, y, z = centers[b, 0], centers[b, 1], centers[b, 2]
            for r in range(3):
                placed[i, b, r] = pose[r, 0] * x + pose[r, 1] * y + pose[r, 2] * z + pose[r, 3]
    return placed


def body_of(capsules: Sequence[Capsule]) -> Body:
    """Cover capsules by spheres that contain them: too large by at most 12 percent of the radius."""
    names = tuple(dict.fromkeys(capsule.name for capsule in capsules))
    part: list[int] = []
    link: list[int] = []
    centers: list[FloatArray] = []
    radii: list[float] = []
    for capsule in capsules:
        start, end = np.array(capsule.start_m), np.array(capsule.end_m)
        length = float(np.linalg.norm(end - start))
        # Spheres one radius apart leave a waist at half a radius from each: sqrt(1 + 1/4) covers it.
        count = max(1, int(np.ceil(length / capsule.radius_m))) + 1 if length > 0.0 else 1
        spacing = length / (count - 1) if count > 1 else 0.0
        for t in np.linspace(0.0, 1.0, count):
            part.append(names.index(capsule.name))
            link.append(capsule.link)
            centers.append(start + t * (end - start))
            radii.append(float(np.hypot(capsule.radius_m, 0.5 * spacing)))
    return Body(
        names,
        np.array(part, dtype=np.int64),
        np.array(link, dtype=np.int64),
        np.array(centers).reshape(-1, 3),
        np.array(radii),
    )


def fixture_capsules(
    fixture: Fixture, tool_link: int, tube_length_m: float = 0.20, tube_radius_m: float = 0.02, bracket_m: float = 0.08
) -> tuple[Capsule, ...]:
    """The tubes in front of the sensors and the bracket behind them, as capsules of the grip frame.

    `tube_length_m` 0 means bare transducers; `bracket_m` is the depth of the bracket behind the array. Tubes end in
    the plane of their mouths.
    """
    origins = fixture.grip_from_sensor[:, :3, 3]
    span = float(np.max(np.linalg.norm(origins[:, :2], axis=1), initial=0.0)) + tube_radius_m
    behind = float(np.min(origins[:, 2], initial=0.0))
    back = min(behind - bracket_m + span, behind)
    capsules = [Capsule("sensor bracket", tool_link, (0.0, 0.0, back), (0.0, 0.0, behind), min(span, 0.06))]
    for grip_from_sensor in fixture.grip_from_sensor:
        start = grip_from_sensor[:3, 3]
        end = start + max(tube_length_m - tube_radius_m, 0.0) * grip_from_sensor[:3, 2]
        capsules.append(_capsule("sensor tube", tool_link, start, end, tube_radius_m))
    return tuple(capsules)


def _capsule(name: str, link: int, start: FloatArray, end: FloatArray, radius_m: float) -> Capsule:
    (x0, y0, z0), (x1, y1, z1) = start.tolist(), end.tolist()
    return Capsule(name, link, (x0, y0, z0), (x1, y1, z1), radius_m)
