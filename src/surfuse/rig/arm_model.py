"""What is known of an arm that stands in the cell, whatever drives it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from surfuse.interfaces import Kinematics
from surfuse.motion.body import Capsule
from surfuse.motion.limits import JointLimits
from surfuse.motion.obstacles import Obstacle
from surfuse.records import FloatArray


@dataclass(frozen=True)
class ArmModel:
    """What is known of an arm that stands in the cell: of J joints, with link poses (..., L, 4, 4).

    `ready_rad` (J,) is the posture of the search. `capsules` are its own outer shape, `tool_link` the index of the
    tool among the link poses, `around` the solids that it stands on and that only its outer links could touch.
    `own_pairs` are parts that must keep clear of each other (None: found from the shape).
    """

    kinematics: Kinematics
    link_poses: Callable[[FloatArray], FloatArray]
    limits: JointLimits
    ready_rad: FloatArray
    encoder_rad_per_count: tuple[float, ...]
    capsules: tuple[Capsule, ...]
    tool_link: int
    around: tuple[Obstacle, ...]
    own_pairs: tuple[tuple[str, str], ...] | None = None
