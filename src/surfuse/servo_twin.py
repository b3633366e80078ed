"""The twin's PUMA 560 behind servo cards: plant, card, control law and driver put together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

import numpy as np

from surfuse.arms import trident
from surfuse.arms.cards.calibration import Calibration
from surfuse.arms.cards.scales import STANDARD_SCALES
from surfuse.arms.cards.simulated_card import SimulatedCard
from surfuse.arms.models.puma560_dynamics import FIXTURE, extra_load, loaded_puma560
from surfuse.arms.puma560 import LIMITS, READY_RAD, Puma560
from surfuse.errors import UsageError, nearest
from surfuse.interfaces import Clock, Generator, World
from surfuse.motion.control.computed_torque import ComputedTorque
from surfuse.motion.control.gravity_pd import GravityPd
from surfuse.motion.control.independent_pid import IndependentPid
from surfuse.motion.control.law import ControlLaw
from surfuse.motion.control.set_points_28ms import SetPoints28ms
from surfuse.motion.planners import Planner, torque_limited
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.records import FloatArray, JointState
from surfuse.world.dynamics.plant import ArmPlant

LAWS = ("set_points_28ms", "independent_pid", "gravity_pd", "computed_torque")


@dataclass(frozen=True)
class Unknown:
    """What the controller does not know: an extra load at the flange (kg) and a share of further dry friction."""

    load_kg: float = 0.0
    friction_share: float = 0.0


def control_law(name: str, model: ArmDynamics, nominal_rad: FloatArray = READY_RAD) -> ControlLaw:
    """A control law by name.

    Raises
    ------
    UsageError : no such law.
    """
    match name:
        case "set_points_28ms":
            return SetPoints28ms(model, nominal_rad)
        case "independent_pid":
            return IndependentPid(model, nominal_rad)
        case "gravity_pd":
            return GravityPd(model, nominal_rad)
        case "computed_torque":
            return ComputedTorque(model)
    raise UsageError(f"unknown control law '{name}'", cure=nearest(name, LAWS))


def known_model() -> ArmDynamics:
    """The arm with its sensor fixture, as its controller knows it."""
    return loaded_puma560(FIXTURE)


def true_dynamics(unknown: Unknown) -> ArmDynamics:
    """The arm as it is in the twin."""
    loads = (FIXTURE, extra_load(unknown.load_kg)) if unknown.load_kg > 0.0 else (FIXTURE,)
    dynamics = loaded_puma560(*loads)
    return replace(dynamics, coulomb_motor_nm=(1.0 + unknown.friction_share) * dynamics.coulomb_motor_nm)


@dataclass(frozen=True)
class ServoArm:
    """An arm behind a simulated card, and the plant behind that."""

    arm: trident.TridentArm
    plant: ArmPlant
    card: SimulatedCard
    law: ControlLaw


def build_servo_arm(
    kinematics: Puma560,
    clock: Clock,
    rng: Generator,
    law: str = "computed_torque",
    planner: Planner | None = None,
    unknown: Unknown | None = None,
    start_rad: FloatArray = READY_RAD,
    parameters: trident.Parameters | None = None,
    calibrated_at_start: bool = True,
) -> ServoArm:
    """An arm that stands at `start_rad` (6,), brakes on; it calibrates itself when it is opened, if asked to.

    `planner` is by default the one that goes to the torque limits. Without `calibrated_at_start` the driver is told
    where the arm stands.
    """
    model = known_model()
    chosen = control_law(law, model)
    plant = ArmPlant(true_dynamics(unknown or Unknown()), start_rad, LIMITS.lower_rad, LIMITS.upper_rad)
    card = SimulatedCard(plant, STANDARD_SCALES, clock, rng)
    arm = trident.create(
        kinematics,
        card,
        clock,
        LIMITS,
        chosen,
        planner or torque_limited(model, LIMITS),
        Calibration() if calibrated_at_start else start_rad,
        parameters or trident.Parameters(),
    )
    return ServoArm(arm, plant, card, chosen)


class ServoTwinArm:
    """A `ServoArm` for the twin's cell, with the interface of `surfuse.arms.simulated.SimulatedArm`.

    The plant gives the motor side of every joint. What lies between motor and link (gears, elastic links) is the
    world's `repeatability`, drawn at every stop and unseen by the encoders.
    """

    def __init__(self, servo_arm: ServoArm, world: World) -> None:
        self._parts = servo_arm
        self._world = world
        self._between = np.zeros(len(servo_arm.plant.position_rad))

    def __enter__(self) -> Self:
        self._parts.arm.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._parts.arm.__exit__(kind, error, trace)

    @property
    def kinematics(self) -> Puma560:
        """Kinematics with the grip as tool."""
        kinematics = self._parts.arm.kinematics
        assert isinstance(kinematics, Puma560)
        return kinematics

    @property
    def true_joints_rad(self) -> FloatArray:
        """Where the links (6,) truly are: for simulated devices that ride on the arm, never for the log."""
        return np.asarray(self._parts.plant.position_rad + self._between)

    def true_tool_pose(self) -> FloatArray:
        """`world_from_tool` (4, 4) at the true joints."""
        return self.kinematics.forward(self.true_joints_rad)

    def joint_state(self) -> JointState:
        """What the encoders show."""
        return self._parts.arm.joint_state()

    def move_to(self, joints_rad: FloatArray) -> JointState:
        """Go there and settle; see `TridentArm.move_to`."""
        state = self._parts.arm.move_to(joints_rad)
        self._between = self._world.repeatability(len(state.position_rad))
        return state

    def begin_stop(self) -> None:
        """Forget the history of the servo: the arm stands exactly where it was last sent.

        A stop then depends on its own target and the one before alone, so that an interrupted scan can be resumed
        with the same result. The difference is within the settling tolerance.
        """
        if self._parts.arm.servo.running:
            self._parts.plant.rest_at(self._parts.arm.target_rad)
            self._parts.arm.servo.rest()
