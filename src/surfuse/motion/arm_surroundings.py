"""What a rig tells the driver of an arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from surfuse.interfaces import MACHINE_CLOCK, Clock, Kinematics
from surfuse.motion.limits import JointLimits
from surfuse.records import FloatArray

Guard = Callable[[FloatArray, FloatArray], None]
"""Called with start and target joints (J,) before every move; raises `SafetyStopError` to refuse it."""


@dataclass(frozen=True)
class ArmSurroundings:
    """The arm's model, the limits that its moves keep to, the clock of the rig, and the check of every move.

    `kinematics` is the model; `guard` refuses a move before it begins (None: nothing is
    checked).
    """

    kinematics: Kinematics
    limits: JointLimits
    clock: Clock = MACHINE_CLOCK
    guard: Guard | None = None
