"""A PUMA 560 behind a simulated servo card, for the tests of cards, servo and driver."""

from dataclasses import dataclass, field, replace

import numpy as np

from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, Puma560
from surfuse.arm_models.puma560_dynamics import FIXTURE, loaded_puma560
from surfuse.arms import trident
from surfuse.geometry.poses import pose
from surfuse.motion.arm_surroundings import Guard
from surfuse.motion.control_law import ControlLaw
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.motion.trapezoid import TrapezoidalMove
from surfuse.records import FloatArray
from surfuse.rig.simulated.servo_arm import control_law
from surfuse.servo_cards.calibration import Calibration
from surfuse.servo_cards.scales import CardScales
from surfuse.twin.dynamics.plant import ArmPlant
from surfuse.twin.servo_card import CardParameters, SimulatedCard

KINEMATICS = Puma560(np.eye(4), pose(np.eye(3), [0.0, 0.0, 0.08 - FLANGE_OFFSET_M]))
MODEL = loaded_puma560(FIXTURE)
STANDARD, CARD = trident.Parameters(), CardParameters()
TARGET = READY_RAD + np.radians([8.0, -4.0, 3.0, 5.0, -3.0, 10.0])


class Clock:
    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        return self.time_s

    def advance(self, duration_s: float) -> None:
        assert duration_s >= 0.0
        self.time_s += duration_s


def trapezoid(start: FloatArray, end: FloatArray) -> TrapezoidalMove:
    return TrapezoidalMove(start, end, LIMITS)


@dataclass
class Bench:
    law: ControlLaw = field(default_factory=lambda: control_law("computed_torque", MODEL))
    truth: ArmDynamics = MODEL
    start: FloatArray = field(default_factory=lambda: READY_RAD.copy())
    reference: Calibration | FloatArray | None = None
    parameters: trident.Parameters = STANDARD
    card_parameters: CardParameters = CARD
    guard: Guard | None = None

    def __post_init__(self) -> None:
        self.clock = Clock()
        self.plant = ArmPlant(self.truth, self.start, LIMITS.lower_rad, LIMITS.upper_rad)
        rng = np.random.default_rng(0)
        self.card = SimulatedCard(self.plant, CardScales(), self.clock, rng, self.card_parameters)
        calibrated = isinstance(self.reference, Calibration)
        around = trident.Surroundings(
            kinematics=KINEMATICS,
            limits=LIMITS,
            clock=self.clock,
            guard=self.guard,
            bus=self.card,
            law=self.law,
            planner=trapezoid,
            standing_rad=None if calibrated else self.start if self.reference is None else self.reference,
        )
        self.arm_parameters = replace(self.parameters, surroundings=around)
        if calibrated:
            self.arm_parameters = replace(self.arm_parameters, calibration=self.reference)
        self.arm = trident.create(self.arm_parameters)
