"""Registers of the TRC004 servo interface card, and the bus that leads to them.

Addresses, masks and formats: Trident ROBOT.C and ROBOT.H v4.3 (R. Voyles 1993-2000), as published in
github.com/HaoguangYang/PUMA500_QNX_Hack-in. The manual's period of the watchdog and the way it is fed are not public:
here a change of one output bit feeds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

JOINTS = 6

ENC_INDEX_BASE = 0x00  # counter at the last index pulse, one word a joint; reading clears the joint's INDEX bit
STATUS_REG = 0x0C
ENC_COUNT_BASE = 0x10
ADC_VALUE = 0x1C
ADC_START = 0x1E
ENC_LOAD_BASE = 0x20
ADC_MUX_SELECT = 0x2C
DISCRETE_REG = 0x2E  # written: six outputs; read: outputs in the low byte, six inputs in the high byte
DAC_BASE = 0x30
STEP = 2  # bytes between the registers of two joints

STATUS_POWER_ON = 0x8000
STATUS_ADC_BUSY = 0x4000
STATUS_INDEX = 0x3F00
STATUS_INDEX_SHIFT = 8

DAC_ZERO = 0x800
DAC_FULL = 0xFFF
ADC_VOLT_PER_LSB = 20.0 / 65536.0  # revision F: 12 bits, left-justified in the word
ADC_MASK = 0xFFF0

OUT_ARM_POWER = 0x01
OUT_BRAKE_RELEASE = 0x02
OUT_WATCHDOG = 0x20
IN_EMERGENCY_STOP_CLOSED = 0x01

NO_CARD = 0xFFFF  # what an empty slot reads


class CardBus(Protocol):
    """The registers of a card as 16-bit words, and the timer that paces the servo."""

    def read(self, register: int, count: int = 1) -> Sequence[int]:
        """Words of `count` registers from `register` on."""

    def write(self, register: int, words: Sequence[int]) -> None:
        """Write words to the registers from `register` on."""

    def wait(self, duration_s: float) -> float:
        """Wait for the next tick of the servo, one period after the last; returns the time that has really passed."""
