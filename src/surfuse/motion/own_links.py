"""Clearance of an arm's links from each other: rods with round ends, two by two."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.motion.body import Capsule
from surfuse.records import FloatArray, IntArray

_APART = 2  # links that share a joint touch there
_TRIED = 200
_USUAL_SHARE = 0.2
_NEIGHBOURS_M = 0.008
_TINY_M2 = 1e-18  # squared length of what is a point


@dataclass(frozen=True)
class OwnLinks:
    """Rods (R,) of an arm and which of them must keep clear of each other.

    `start_m`, `end_m` (R, 3) in the frame of `link`; `part` indexes `names`; `pairs` (P, 2) are rods. Rods further
    apart than `keep_m` do not count: an arm is as slender as it is built, however wide a berth it gives to others.
    """

    names: tuple[str, ...]
    part: IntArray
    link: IntArray
    start_m: FloatArray
    end_m: FloatArray
    radius_m: FloatArray
    pairs: IntArray
    keep_m: float = 0.005

    def nearest(self, link_poses: FloatArray) -> tuple[FloatArray, IntArray]:
        """Least distance (N,) between rods of a pair (negative: overlap), and the number (N,) of that pair."""
        poses = np.ascontiguousarray(link_poses)
        return _nearest_pair(poses, self.link, self.start_m, self.end_m, self.radius_m, self.pairs)


def own_links(capsules: Sequence[Capsule], pairs: Sequence[tuple[str, str]]) -> OwnLinks:
    """The own-link check of an arm: `pairs` names the parts that must keep clear of each other."""
    names = tuple(dict.fromkeys(capsule.name for capsule in capsules))
    wanted = {frozenset(pair) for pair in pairs}
    chosen = [
        (i, j)
        for i, one in enumerate(capsules)
        for j, other in enumerate(capsules[:i])
        if frozenset((one.name, other.name)) in wanted and one.name != other.name
    ]
    return OwnLinks(
        names,
        np.array([names.index(capsule.name) for capsule in capsules], dtype=np.int64),
        np.array([capsule.link for capsule in capsules], dtype=np.int64),
        np.array([capsule.start_m for capsule in capsules]).reshape(-1, 3),
        np.array([capsule.end_m for capsule in capsules]).reshape(-1, 3),
        np.array([capsule.radius_m for capsule in capsules]),
        np.array(chosen, dtype=np.int64).reshape(-1, 2),
    )


def separable_pairs(
    capsules: Sequence[Capsule],
    link_poses: Callable[[FloatArray], FloatArray],
    lower_rad: FloatArray,
    upper_rad: FloatArray,
    ready_rad: FloatArray,
) -> tuple[tuple[str, str], ...]:
    """Pairs of parts for an arm of which nothing but its shape is known.

    Parts of links that share a joint are left out, and parts that overlap in the ready posture, or are nearer than
    `_NEIGHBOURS_M` in a fifth of all postures: rods are larger than what they cover, and such parts are neighbours in
    truth.

    `link_poses` makes poses (N, L, 4, 4) of joints (N, J); `lower_rad`, `upper_rad`, `ready_rad` (J,).
    """
    names = tuple(dict.fromkeys(capsule.name for capsule in capsules))
    links = {name: [capsule.link for capsule in capsules if capsule.name == name] for name in names}
    rng = np.random.default_rng(0)
    postures = np.vstack([ready_rad, rng.uniform(lower_rad, upper_rad, (_TRIED, len(lower_rad)))])
    poses = link_poses(postures)
    found = []
    for i, one in enumerate(names):
        for other in names[:i]:
            if min(abs(a - b) for a in links[one] for b in links[other]) < _APART:
                continue
            gap, _ = own_links(capsules, [(one, other)]).nearest(poses)
            if gap[0] > 0.0 and np.mean(gap <= _NEIGHBOURS_M) < _USUAL_SHARE:
                found.append((other, one))
    return tuple(found)


@compiled
def _segment_distance(
    d1: tuple[float, float, float], d2: tuple[float, float, float], apart: tuple[float, float, float]
) -> float:
    """Distance of two segments with directions d1, d2, `apart` from the start of the second to that of the first.

    Ericson, Real-Time Collision Detection, 2005, section 5.1.9.
    """
    a = d1[0] * d1[0] + d1[1] * d1[1] + d1[2] * d1[2]
    e = d2[0] * d2[0] + d2[1] * d2[1] + d2[2] * d2[2]
    b = d1[0] * d2[0] + d1[1] * d2[1] + d1[2] * d2[2]
    c = d1[0] * apart[0] + d1[1] * apart[1] + d1[2] * apart[2]
    f = d2[0] * apart[0] + d2[1] * apart[1] + d2[2] * apart[2]
    along, other = 0.0, 0.0
    if a <= _TINY_M2 and e > _TINY_M2:
        other = min(max(f / e, 0.0), 1.0)
    elif a > _TINY_M2 and e <= _TINY_M2:
        along = min(max(-c / a, 0.0), 1.0)
    elif a > _TINY_M2:
        area = a * e - b * b
        if area > _TINY_M2 * _TINY_M2:
            along = min(max((b * f - c * e) / area, 0.0), 1.0)
        other = (b * along + f) / e
        if other < 0.0:
            other = 0.0
            along = min(max(-c / a, 0.0), 1.0)
        elif other > 1.0:
            other = 1.0
            along = min(max((b - c) / a, 0.0), 1.0)
    x = apart[0] + along * d1[0] - other * d2[0]
    y = apart[1] + along * d1[1] - other * d2[1]
    z = apart[2] + along * d1[2] - other * d2[2]
    return math.sqrt(x * x + y * y + z * z)


@compiled
def _nearest_pair(
    links: FloatArray, link: IntArray, start: FloatArray, end: FloatArray, radius: FloatArray, pairs: IntArray
) -> tuple[FloatArray, IntArray]:
    n, rods = links.shape[0], link.shape[0]
    least = np.full(n, np.inf)
    which = np.zeros(n, dtype=np.int64)
    at, along, bound = np.empty((rods, 3)), np.empty((rods, 3)), np.empty(rods)
    for rod in range(rods):
        # Half the length and the thickness: no rod reaches further from its middle.
        bound[rod] = radius[rod] + 0.5 * math.sqrt(np.sum((end[rod] - start[rod]) ** 2))
    for i in range(n):
        for rod in range(rods):
            pose = links[i, link[rod]]
            for r in range(3):
                at[rod, r] = pose[r, 3]
                along[rod, r] = 0.0
                for c in range(3):
                    at[rod, r] += pose[r, c] * start[rod, c]
                    along[rod, r] += pose[r, c] * (end[rod, c] - start[rod, c])
        for k in range(pairs.shape[0]):
            p, q = pairs[k, 0], pairs[k, 1]
            x, y, z = at[p, 0] - at[q, 0], at[p, 1] - at[q, 1], at[p, 2] - at[q, 2]
            mx = x + 0.5 * (along[p, 0] - along[q, 0])
            my = y + 0.5 * (along[p, 1] - along[q, 1])
            mz = z + 0.5 * (along[p, 2] - along[q, 2])
            reach = least[i] + bound[p] + bound[q]
            if reach <= 0.0 or mx * mx + my * my + mz * mz >= reach * reach:
                continue
            d1 = (along[p, 0], along[p, 1], along[p, 2])
            d2 = (along[q, 0], along[q, 1], along[q, 2])
            gap = _segment_distance(d1, d2, (x, y, z)) - radius[p] - radius[q]
            if gap < least[i]:
                least[i] = gap
                which[i] = k
    return least, which
