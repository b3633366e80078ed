"""What the servo watches at every tick: following error, encoders that stick or jump, speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray
from surfuse.servo_cards.scales import CardScales, unwrap

FINE = -1
FOLLOWING, STUCK, JUMP, OVERSPEED = 0, 1, 2, 3


@dataclass(frozen=True)
class Supervision:
    """Limits of the servo.

    `following_rad`: largest difference between wanted and measured joint. `stuck_rad`: how far the wanted joint may
    move while its encoder does not. `stuck_counts`: how far, in counts, the torque alone must have moved a joint whose
    encoder stands still. For that estimate `stuck_nm` is what may hold the joint, counted from its torque when the
    encoder last moved, and `inertia_kg_m2` the most that it may have to accelerate. Dry friction holds a joint over
    twice its size, from full forwards to full backwards; the defaults add an unknown load of 2 kg. `jump_counts`:
    largest change of a counter in one tick. `speed_max_rad_s`: of each joint. `late_share`: longest time between two
    ticks, in periods. `speed_filter_s`: time constant of the measured speed.

    Numbers in SI units; the tuples have one entry for each of the six joints.
    """

    following_rad: float = 0.25
    stuck_rad: float = 0.03
    stuck_nm: tuple[float, ...] = (62.0, 45.0, 26.0, 4.5, 4.5, 2.0)
    stuck_counts: float = 15.0
    inertia_kg_m2: tuple[float, ...] = (6.0, 7.0, 2.0, 0.3, 0.3, 0.25)
    jump_counts: int = 400
    speed_max_rad_s: tuple[float, ...] = tuple(np.radians([200.0, 190.0, 200.0, 300.0, 260.0, 220.0]))
    late_share: float = 3.0
    speed_filter_s: float = 3e-3

    def __post_init__(self) -> None:
        for name in ("following_rad", "stuck_rad", "stuck_counts", "jump_counts", "late_share", "speed_filter_s"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ConfigError(f"Supervision.{name} = {getattr(self, name)}", cure="give a positive value")
        for name in ("stuck_nm", "inertia_kg_m2", "speed_max_rad_s"):
            if not all(np.isfinite(value) and value > 0.0 for value in getattr(self, name)):
                raise ConfigError(f"Supervision.{name} = {getattr(self, name)}", cure="give positive values")

    def constants(self, scales: CardScales, period_s: float) -> FloatArray:
        """The limits as rows for `measure`: (6, J) of scales, speeds, torques, inertias, single numbers, zeros."""
        blend = period_s / (period_s + self.speed_filter_s)
        single = [self.following_rad, self.stuck_rad, float(self.jump_counts), period_s, blend, self.stuck_counts]
        limits = self.speed_max_rad_s, self.stuck_nm, self.inertia_kg_m2
        return np.array([scales.rad_per_count, *limits, single, scales.zero_rad])


STANDARD_SUPERVISION = Supervision()


@compiled
def measure(
    words: IntArray,
    constants: FloatArray,
    joint_from_motor: FloatArray,
    wanted: FloatArray,
    torque: FloatArray,
    counters: IntArray,
    motion: FloatArray,
    anchor: FloatArray,
) -> int:
    """Take in the counters of one tick, and judge: -1, or 16 x kind + joint of the first limit that is broken.

    `words` (J,) are the counters as the card shows them, `constants` (6, J) those of `Supervision.constants`,
    `joint_from_motor` (J, J) is the coupling of the wrist. `wanted` (J,) in rad is of this tick, `torque` (J,) in Nm is
    what was asked for at the tick before.

    The rest moves on: `counters` (2, J), the words of the tick before and the motor counts without overflow; `motion`
    (2, J), the joints in rad and their filtered speeds in rad/s; `anchor` (4, J), the wanted joint (rad) and torque
    (Nm) when the counter last moved, and the speed (rad/s) and travel (rad) that the torque alone should have given
    since then.
    """
    last_words, counts, position, velocity, zero = counters[0], counters[1], motion[0], motion[1], constants[5]
    n = words.shape[0]
    following, stuck, jump = constants[4, 0], constants[4, 1], constants[4, 2]
    period, blend, timeouts = constants[4, 3], constants[4, 4], constants[4, 5]
    before = counts.copy()
    unwrap(words, last_words, counts)
    verdict = FINE
    for i in range(n):
        angle = zero[i]
        for j in range(n):
            angle += joint_from_motor[i, j] * counts[j] * constants[0, j]
        velocity[i] += blend * ((angle - position[i]) / period - velocity[i])
        position[i] = angle
    for i in range(n):
        if counts[i] != before[i]:
            anchor[0, i], anchor[1, i], anchor[2, i], anchor[3, i] = wanted[i], torque[i], 0.0, 0.0
        else:
            excess = abs(torque[i] - anchor[1, i]) - constants[2, i]
            anchor[2, i] = max(0.0, anchor[2, i] + period * excess / constants[3, i])
            anchor[3, i] += period * anchor[2, i]
        if verdict != FINE:
            continue
        if abs(counts[i] - before[i]) > jump:
            verdict = 16 * JUMP + i
        elif abs(wanted[i] - anchor[0, i]) > stuck or anchor[3, i] > timeouts * abs(constants[0, i]):
            verdict = 16 * STUCK + i
        # Written so that nan counts as too far.
        elif not abs(wanted[i] - position[i]) <= following:
            verdict = 16 * FOLLOWING + i
        elif abs(velocity[i]) > constants[1, i]:
            verdict = 16 * OVERSPEED + i
    return verdict
