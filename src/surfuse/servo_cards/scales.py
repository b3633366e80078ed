"""From encoder counts to joint angles and from joint torques to converter words, wrist coupling included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray
from surfuse.servo_cards.registers import DAC_FULL, DAC_ZERO

WORD = 1 << 16


@dataclass(frozen=True)
class CardScales:
    """Scales of the six channels, from Trident ROBOT.C v4.3.

    `rad_per_count`: motor-side joint angle of one count after decoding, with sign. `counts_per_nm`: converter counts
    for 1 N m at the joint ("measured" values, after Armstrong, Khatib and Burdick 1986). `coupling`: how far motor
    5 turns joint 5 back per joint-4 angle, and motor 6 joint 6 per joint-4 and per uncoupled joint-5 angle.
    `zero_rad`: joint angle at count 0. `counts_per_turn`: of each motor, from index pulse to index pulse.
    """

    rad_per_count: tuple[float, ...] = (1.0035e-4, -7.3156e-5, 1.17e-4, -8.2663e-5, -8.7376e-5, -8.1885e-5)
    counts_per_nm: tuple[float, ...] = (-21.0, 11.0, -22.9, 84.6, 102.0, 96.2)
    coupling: tuple[float, float, float] = (0.0139037, -0.0130401, 0.180556)
    zero_rad: tuple[float, ...] = (0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0)
    counts_per_turn: tuple[int, ...] = (1000, 800, 1000, 1000, 1000, 1000)

    def __post_init__(self) -> None:
        for name in ("rad_per_count", "counts_per_nm", "counts_per_turn"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if not np.all(np.isfinite(values) & (values != 0.0)):
                raise ConfigError(f"CardScales.{name} = {values.tolist()}", cure="give finite values other than 0")

    @property
    def motor_from_joint(self) -> FloatArray:
        """Matrix (6, 6) from joint angles to uncoupled angles, those that the motors make.

        Trident decodes q5 = m5 - c45 q4 and q6 = m6 - c46 q4 - c56 m5.
        """
        c45, c46, c56 = self.coupling
        matrix = np.eye(6)
        matrix[4, 3] = c45
        matrix[5, 3] = c46 + c56 * c45
        matrix[5, 4] = c56
        return matrix

    @property
    def joint_from_motor(self) -> FloatArray:
        """The inverse of `motor_from_joint`.

        (J, J): joint angles from the motors' angles, and, transposed, motor torques from joint torques.
        """
        return np.asarray(np.linalg.inv(self.motor_from_joint), dtype=np.float64)

    @property
    def resolution_rad(self) -> FloatArray:
        """Joint angle (6,) of one count."""
        size: FloatArray = np.abs(np.asarray(self.rad_per_count, dtype=np.float64))
        return size

    def counts(self, joints_rad: FloatArray) -> FloatArray:
        """Absolute counts (6,), not rounded, at joint angles (6,).

        Joint angles in rad.
        """
        motors = self.motor_from_joint @ (np.asarray(joints_rad) - np.asarray(self.zero_rad))
        counts: FloatArray = motors / np.asarray(self.rad_per_count)
        return counts

    def joints(self, counts: FloatArray | IntArray) -> FloatArray:
        """Joint angles (6,) at absolute counts (6,).

        In rad.
        """
        motors = np.asarray(counts, dtype=np.float64) * np.asarray(self.rad_per_count)
        return np.asarray(self.joint_from_motor @ motors + np.asarray(self.zero_rad), dtype=np.float64)


STANDARD_SCALES = CardScales()


@compiled
def unwrap(words: IntArray, last_words: IntArray, counts: IntArray) -> None:
    """Carry 16-bit counters on over their overflows: each moved less than half its range since the last reading.

    `counts` and `last_words` (J,) are updated in place. `words` (J,) are 16-bit values, 0 to 65535.
    """
    for j in range(words.shape[0]):
        change = (words[j] - last_words[j]) & 0xFFFF
        if change >= 0x8000:
            change -= 0x10000
        counts[j] += change
        last_words[j] = words[j]


@compiled
def converter_words(torque: FloatArray, motor_torque: FloatArray, counts_per_nm: FloatArray, words: IntArray) -> None:
    """Converter words (J,) for joint torques (J,): power is the same on both sides of the wrist's coupling.

    `motor_torque` (J, J) is the transpose of `joint_from_motor`. Torques beyond the converter's range give its ends.

    `torque` in Nm, `counts_per_nm` (J,) with the sign of the converter; words are from 0 to `DAC_FULL`, no torque is
    `DAC_ZERO`.
    """
    n = torque.shape[0]
    for i in range(n):
        motor = 0.0
        for j in range(n):
            motor += motor_torque[i, j] * torque[j]
        word = DAC_ZERO + int(np.rint(motor * counts_per_nm[i]))
        words[i] = min(max(word, 0), DAC_FULL)
