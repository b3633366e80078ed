"""Servo, card and plant of the twin in one compiled loop, for as long as nothing but time passes.

The loop calls the same kernels in the same order as the servo's own ticks over the card's registers, so both give the
same numbers to the last bit; it saves the way through Python at every tick.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.motion.control.computed_torque import ComputedTorque, TorqueLoop, computed_torque
from surfuse.motion.control_law import Commands
from surfuse.motion.newton_euler import RigidArm
from surfuse.records import FloatArray
from surfuse.servo_cards.scales import converter_words
from surfuse.servo_cards.servo import JointServo, Ran, ServoMemory, SettleGoal
from surfuse.servo_cards.supervision import FINE, measure
from surfuse.twin.dynamics.plant import ArmPlant, PlantMemory, integrate
from surfuse.twin.servo_card import (
    CardMemory,
    SimulatedCard,
    absolute_counts,
    joint_torques,
    passed_index,
    shown_words,
)


class CompiledTicks:
    """The loop over one simulated card, for computed torque; other laws run tick by tick. A `TickLoop`."""

    def __init__(self, card: SimulatedCard, plant: ArmPlant) -> None:
        self._card = card
        self._plant = plant

    def __call__(self, servo: JointServo, commands: Commands, first: int, until: SettleGoal | None) -> Ran:
        """See `TickLoop`."""
        law = servo.law
        if not (isinstance(law, ComputedTorque) and self._card.undisturbed):
            return Ran(0)
        period, steps = law.period_s, self._plant.steps_in(law.period_s)
        wanted = Wanted(commands.position_rad, commands.velocity_rad_s, commands.acceleration_rad_s2)
        goal = Goal(np.inf, 0, 0) if until is None else Goal(until.within_rad, until.in_a_row, until.seen)
        end = first + until.left if until is not None else len(commands)
        ticks, code, seen, passed = _ticks(
            servo.memory,
            law.memory,
            self._card.memory,
            self._plant.memory,
            wanted,
            (first, end),
            goal,
            (period / steps, steps),
        )
        if ticks:
            self._card.has_run(ticks, period, servo.memory.written_words, passed)
        if until is None:
            return Ran(ticks, code)
        until.left, until.seen = until.left - ticks, seen
        return Ran(ticks, code, seen >= until.in_a_row)


class Wanted(NamedTuple):
    """`Commands` as the kernel takes them: (T, J) in rad, rad/s and rad/s^2."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class Goal(NamedTuple):
    """`SettleGoal` as the kernel takes it: nearness in rad, ticks in a row (0: nothing to arrive at), ticks so far."""

    within: float
    in_a_row: int
    seen: int


@compiled
def _ticks(
    servo: ServoMemory,
    law: tuple[RigidArm, TorqueLoop],
    card: CardMemory,
    plant: PlantMemory,
    wanted: Wanted,
    span: tuple[int, int],
    goal: Goal,
    substeps: tuple[float, int],
) -> tuple[int, int, int, bool]:
    """Ticks `span` (first, end) of commands, the last of which is repeated; stops early for what Python must see.

    `substeps` are the length (s) and number of the plant's steps in a tick. Returns ticks done, supervision's verdict,
    ticks in a row, whether the last tick passed an index pulse.
    """
    constants, coupling, motor_torque, counts_per_nm, torque, counters, motion, anchor, shown, written = servo
    position, velocity = motion[0], motion[1]
    model, control = law
    zero, motor_from_joint, per_count, per_word, joint_torque, absolute, offset, frozen, before, phase, turn = card
    joints = plant[3][0]
    first, end = span
    within, in_a_row, seen = goal
    for i in range(first, end):
        row = min(i, wanted.position.shape[0] - 1)
        target = wanted.position[row]
        shown_words(absolute, offset, frozen, shown)
        code = measure(shown, constants, coupling, target, torque, counters, motion, anchor)
        if code != FINE:
            return i - first, code, seen, False
        speed, rate = wanted.velocity[row], wanted.acceleration[row]
        computed_torque(model, control, target, speed, rate, position, velocity, torque)
        converter_words(torque, motor_torque, counts_per_nm, written)
        joint_torques(written, per_word, joint_torque)
        integrate(plant, joint_torque, substeps[0], substeps[1])
        for j in range(before.shape[0]):
            before[j] = absolute[j]
        absolute_counts(joints, zero, motor_from_joint, per_count, absolute)
        seen = seen + 1 if _near(target, position, within) else 0
        passed = passed_index(before, absolute, phase, turn)
        if passed or (in_a_row > 0 and seen >= in_a_row):
            return i + 1 - first, FINE, seen, passed
    return end - first, FINE, seen, False


@compiled
def _near(wanted: FloatArray, measured: FloatArray, within: float) -> bool:
    """Whether every joint (J,) is within so many radians of where it is wanted."""
    near = True
    for j in range(measured.shape[0]):
        near = near and abs(wanted[j] - measured[j]) <= within
    return near
