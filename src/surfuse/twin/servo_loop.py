"""Servo, card and plant of the twin in one compiled loop, for as long as nothing but time passes.

The loop calls the same kernels in the same order as the servo's own ticks over the card's registers, so both give the
same numbers to the last bit; it saves the way through Python at every tick.
"""

from __future__ import annotations

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.motion.control.computed_torque import ComputedTorque, computed_torque
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
        wanted = (commands.position_rad, commands.velocity_rad_s, commands.acceleration_rad_s2)
        goal = (np.inf, 0, 0) if until is None else (until.within_rad, until.in_a_row, until.seen)
        ticks, code, seen, passed = _ticks(
            servo.memory,
            law.memory,
            self._card.memory,
            self._plant.memory,
            wanted,
            first,
            first + until.left if until is not None else len(commands),
            goal,
            period / steps,
            steps,
        )
        if ticks:
            self._card.has_run(ticks, period, servo.memory[1][3], passed)
        if until is None:
            return Ran(ticks, code)
        until.left, until.seen = until.left - ticks, seen
        return Ran(ticks, code, seen >= until.in_a_row)


@compiled
def _ticks(
    servo: ServoMemory,
    law: tuple[RigidArm, tuple[FloatArray, ...]],
    card: CardMemory,
    plant: PlantMemory,
    wanted: tuple[FloatArray, FloatArray, FloatArray],
    first: int,
    end: int,
    goal: tuple[float, int, int],
    h: float,
    steps: int,
) -> tuple[int, int, int, bool]:
    """Ticks `first` to `end` of commands (T, J), the last of which is repeated; stops early for what Python must see.

    `goal`: nearness (rad), ticks in a row (0: nothing to arrive at), ticks so far. Returns ticks done, supervision's
    verdict, ticks in a row, whether the last tick passed an index pulse.
    """
    reals, numbers = servo
    constants, joint_from_motor, servo_zero, motor_torque, counts_per_nm, position, velocity, anchor, torque = reals
    new_words, last_words, counts, dac = numbers
    model, control = law
    scales, powers, registers = card
    zero, motor_from_joint, per_count = scales
    torque_per_word, joint_torque = powers
    absolute, offset, frozen, before, phase, turn = registers
    arm, dry, ends, state, matrices, scratch = plant
    positions, speeds, rates = wanted
    within, in_a_row, seen = goal
    rows = positions.shape[0]
    for i in range(first, end):
        row = min(i, rows - 1)
        shown_words(absolute, offset, frozen, new_words)
        code = measure(
            new_words,
            constants,
            joint_from_motor,
            servo_zero,
            positions[row],
            torque,
            last_words,
            counts,
            position,
            velocity,
            anchor,
        )
        if code != FINE:
            return i - first, code, seen, False
        computed_torque(model, control, positions[row], speeds[row], rates[row], position, velocity, torque)
        converter_words(torque, motor_torque, counts_per_nm, dac)
        joint_torques(dac, torque_per_word, joint_torque)
        integrate(arm, dry, ends, state, matrices, scratch, joint_torque, h, steps)
        for j in range(before.shape[0]):
            before[j] = absolute[j]
        absolute_counts(state[0], zero, motor_from_joint, per_count, absolute)
        near = True
        for j in range(position.shape[0]):
            near = near and abs(positions[row, j] - position[j]) <= within
        seen = seen + 1 if near else 0
        passed = passed_index(before, absolute, phase, turn)
        if passed or (in_a_row > 0 and seen >= in_a_row):
            return i + 1 - first, FINE, seen, passed
    return end - first, FINE, seen, False
