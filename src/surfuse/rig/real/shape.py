"""The outer shape of a real arm of a file, with its sensors, and the check of its moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from surfuse.geometry.poses import inverse
from surfuse.motion.body import Body, Capsule, body_of
from surfuse.motion.clearance import ClearanceModel, check_move
from surfuse.motion.limits import JointLimits
from surfuse.motion.obstacles import Obstacle
from surfuse.motion.own_links import own_links, separable_pairs
from surfuse.records import BoolArray, Fixture, FloatArray

SENSOR_RADIUS_M = 0.01
"""Of a sensor whose aperture is not known."""
_TRIED = 200


@dataclass(frozen=True)
class ArmShape:
    """Rods around the links of an arm and its sensors, with link poses (N, L, 4, 4) of joints (N, J).

    `posture` says how the arm stands now. Parts that would touch each other there are not looked at together: rods are
    larger than what they cover, and the arm stands there after all.
    """

    link_poses: Callable[[FloatArray], FloatArray]
    rods: tuple[Capsule, ...]
    limits: JointLimits
    posture: Callable[[], FloatArray]
    least_m: float

    def clearance(self, obstacles: tuple[Obstacle, ...]) -> ClearanceModel:
        """The check that the arm keeps clear of itself and of these obstacles; the arm must be open."""
        low, high, now = self.limits.lower_rad, self.limits.upper_rad, self.posture()
        pairs = separable_pairs(self.rods, self.link_poses, low, high, now)
        tried = np.vstack([now, np.random.default_rng(0).uniform(low, high, (_TRIED, len(low)))])
        body = body_of(self.rods)
        model = ClearanceModel(self.link_poses, body, obstacles, own_links(self.rods, pairs))
        return replace(model, beside=_never_clear(body, body.place(self.link_poses(tried)), obstacles, self.least_m))


def _never_clear(
    body: Body, centers_m: FloatArray, obstacles: tuple[Obstacle, ...], least_m: float
) -> tuple[BoolArray, ...]:
    """For each obstacle which spheres (B,) are near it in every one of the postures of their centres (N, B, 3).

    An arm stands on its table, and a part may stand beside its foot. What no joint can take away from there tells
    nothing about a posture.
    """
    points, shape = centers_m.reshape(-1, 3), centers_m.shape[:2]
    gaps = (solid.distance(points).reshape(shape) - body.radius_m for solid in obstacles)
    return tuple(np.asarray(np.all(gap < least_m, axis=0)) for gap in gaps)


def sensor_rods(fixture: Fixture, tool_from_grip: FloatArray, tool_link: int) -> tuple[Capsule, ...]:
    """A rod from the tool's frame to the face of each sensor, as thick as its aperture, in the frame of the grip."""
    start = inverse(tool_from_grip)[:3, 3]
    rods = []
    for spec, grip_from_sensor in zip(fixture.specs, fixture.grip_from_sensor, strict=True):
        radius_m = max(0.5 * (spec.aperture_m or 0.0), SENSOR_RADIUS_M)
        end = grip_from_sensor[:3, 3] - radius_m * grip_from_sensor[:3, 2]
        (x0, y0, z0), (x1, y1, z1) = start.tolist(), end.tolist()
        rods.append(Capsule(f"sensor '{spec.name}'", tool_link, (x0, y0, z0), (x1, y1, z1), radius_m))
    return tuple(rods)


def shapeless(rods: tuple[Capsule, ...], joints: int) -> str:
    """In words which links (0: base, then one a joint) have no shape in the arm's file; empty where all have one."""
    there = {rod.link for rod in rods}
    names = ["the base" if link == 0 else f"link {link}" for link in range(joints + 1) if link not in there]
    if not names:
        return ""
    return "its file holds no shapes" if len(names) > joints else f"its file holds no shape of {', '.join(names)}"


class MoveCheck:
    """The check that the driver of a real arm asks before each move, once it is known what stands around the arm.

    A move that begins nearer to something than `least_m` may come no nearer.
    """

    def __init__(self, clearance: Callable[[tuple[Obstacle, ...]], ClearanceModel], least_m: float) -> None:
        self._make, self._least_m = clearance, least_m
        self._clearance: ClearanceModel | None = None

    def surround(self, obstacles: tuple[Obstacle, ...]) -> None:
        """From now on these are the obstacles."""
        self._clearance = self._make(obstacles)

    def __call__(self, start_rad: FloatArray, end_rad: FloatArray) -> None:
        """Check a straight move in joint space, both ends (J,).

        Raises
        ------
        SafetyStopError : names the part of the arm, what it would touch, the distance and the limit.
        """
        if self._clearance is not None:
            check_move(self._clearance, start_rad, end_rad, self._least_m, from_within=True)
