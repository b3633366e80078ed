"""The twin's PUMA 560 behind servo cards: plant, card, control law and driver put together."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Self

import numpy as np

from surfuse import registry
from surfuse.arm_models.puma560 import LIMITS, READY_RAD, Puma560
from surfuse.arm_models.puma560_dynamics import FIXTURE, extra_load, loaded_puma560
from surfuse.arms import trident
from surfuse.errors import SurfuseError
from surfuse.interfaces import Clock, Generator, World
from surfuse.motion.arm_surroundings import Guard
from surfuse.motion.control_law import ControlLaw, LawSurroundings
from surfuse.motion.planners import Planner, torque_limited
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.motion.trajectory import Trajectory
from surfuse.records import FloatArray, JointSamples, JointState
from surfuse.servo_cards.scales import STANDARD_SCALES
from surfuse.twin.dynamics.plant import ArmPlant
from surfuse.twin.servo_card import SimulatedCard
from surfuse.twin.servo_loop import CompiledTicks


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
    plug_in = registry.load("control_laws", name)
    law: ControlLaw = plug_in.create(plug_in.Parameters(surroundings=LawSurroundings(model, nominal_rad)))
    return law


def known_model(fixture_kg: float = FIXTURE.mass_kg) -> ArmDynamics:
    """The arm with its sensor fixture, as its controller knows it."""
    return loaded_puma560(replace(FIXTURE, mass_kg=fixture_kg))


def true_dynamics(unknown: Unknown, fixture_kg: float = FIXTURE.mass_kg) -> ArmDynamics:
    """The arm as it is in the twin."""
    fixture = replace(FIXTURE, mass_kg=fixture_kg)
    loads = (fixture, extra_load(unknown.load_kg)) if unknown.load_kg > 0.0 else (fixture,)
    dynamics = loaded_puma560(*loads)
    return replace(dynamics, coulomb_motor_nm=(1.0 + unknown.friction_share) * dynamics.coulomb_motor_nm)


class ArmTime:
    """The time in which arm and cards live: that of the cell, or, while the arm moves beside other devices, its own.

    Those devices let the cell's time pass in large steps. The arm is then brought after it, tick by tick, whenever
    somebody asks where it is.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._own_s: float | None = None

    def now_s(self) -> float:
        """The arm's time."""
        return self._clock.now_s() if self._own_s is None else self._own_s

    def cell_s(self) -> float:
        """The cell's time."""
        return self._clock.now_s()

    def advance(self, duration_s: float) -> None:
        """Let the arm's time pass, and the cell's with it unless they are apart."""
        if self._own_s is None:
            self._clock.advance(duration_s)
        else:
            self._own_s += duration_s

    def advance_cell(self, duration_s: float) -> None:
        """Let the cell's time pass."""
        self._clock.advance(duration_s)

    def part(self) -> None:
        """From now on the arm has a time of its own."""
        self._own_s = self._clock.now_s()

    def join(self) -> None:
        """From now on there is one time again: the later of both."""
        if self._own_s is not None:
            self._clock.advance(max(0.0, self._own_s - self._clock.now_s()))
            self._own_s = None


@dataclass(frozen=True)
class ServoArm:
    """An arm behind a simulated card, the plant behind that, and the time in which they live."""

    arm: trident.TridentArm
    plant: ArmPlant
    card: SimulatedCard
    law: ControlLaw
    time: ArmTime


@dataclass(frozen=True)
class ServoDesign:
    """How an arm behind servo cards is driven.

    `law` is the name of the control law, `planner` by default the one that goes to the torque limits. `unknown` is
    what the arm has and its model lacks, `fixture_kg` the load at the grip. `parameters` are the driver's own. Without
    `calibrated_at_start` the driver is told where the arm stands, else it calibrates itself when it is opened.
    `compiled_loop` false runs every tick through the card's registers, to the same numbers.
    """

    law: str = "computed_torque"
    planner: Planner | None = None
    unknown: Unknown = field(default_factory=Unknown)
    fixture_kg: float = FIXTURE.mass_kg
    parameters: trident.Parameters | None = None
    calibrated_at_start: bool = True
    compiled_loop: bool = True


STANDARD_DESIGN = ServoDesign()


def build_servo_arm(
    kinematics: Puma560,
    clock: Clock,
    rng: Generator,
    design: ServoDesign = STANDARD_DESIGN,
    start_rad: FloatArray = READY_RAD,
    guard: Guard | None = None,
) -> ServoArm:
    """An arm that stands at `start_rad` (6,), brakes on; `guard` checks every move before it."""
    model = known_model(design.fixture_kg)
    chosen = control_law(design.law, model)
    dynamics = true_dynamics(design.unknown, design.fixture_kg)
    plant = ArmPlant(dynamics, start_rad, LIMITS.lower_rad, LIMITS.upper_rad)
    own_time = ArmTime(clock)
    card = SimulatedCard(plant, STANDARD_SCALES, own_time, rng)
    around = trident.Surroundings(
        kinematics=kinematics,
        limits=LIMITS,
        clock=own_time,
        guard=guard,
        bus=card,
        law=chosen,
        planner=design.planner or torque_limited(model, LIMITS),
        standing_rad=None if design.calibrated_at_start else start_rad,
        loop=CompiledTicks(card, plant) if design.compiled_loop else None,
    )
    arm = trident.create(replace(design.parameters or trident.Parameters(chosen.settle_rad), surroundings=around))
    return ServoArm(arm, plant, card, chosen, own_time)


class ServoTwinArm:
    """A `ServoArm` for the twin's cell, with the interface of `surfuse.arms.simulated.SimulatedArm`.

    The plant gives the motor side of every joint. What lies between motor and link (gears, elastic links) is the
    world's `repeatability`, drawn at every stop and unseen by the encoders.
    """

    def __init__(self, servo_arm: ServoArm, world: World) -> None:
        self._parts = servo_arm
        self._world = world
        self._between = np.zeros(len(servo_arm.plant.position_rad))
        self._settled = False
        self._moving = False
        self._fault: SurfuseError | None = None

    @property
    def parts(self) -> ServoArm:
        """Driver, card, plant and law, for tests of faults and for studies of the motion itself."""
        return self._parts

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
        self._catch_up()
        plant, time = self._parts.plant, self._parts.time
        late_s = time.cell_s() - time.now_s() if self._moving else 0.0
        return np.asarray(plant.position_rad + late_s * plant.velocity_rad_s + self._between)

    def true_tool_pose(self) -> FloatArray:
        """`world_from_tool` (4, 4) at the true joints."""
        return self.kinematics.forward(self.true_joints_rad)

    def joint_state(self) -> JointState:
        """What the encoders show."""
        self._catch_up()
        return self._parts.arm.joint_state()

    def move_to(self, joints_rad: FloatArray, speed_share: float | None = None) -> JointState:
        """Go there and settle; see `TridentArm.move_to`."""
        self._settled = False
        state = self._parts.arm.move_to(joints_rad, speed_share)
        self._settled = True
        self._between = self._world.repeatability(len(state.position_rad))
        return state

    def start(self, trajectory: Trajectory) -> float:
        """Begin a motion that goes on while other devices let time pass; see `MovingArm.start`."""
        self._settled = False
        began_s = self._parts.arm.begin(trajectory)
        self._between = self._world.repeatability(len(self._between))
        self._fault, self._moving = None, True
        self._parts.time.part()
        return began_s

    def wait_until(self, t_s: float) -> None:
        """Let the cell's time run to this moment, and the arm after it; see `MovingArm.wait_until`."""
        time = self._parts.time
        time.advance_cell(max(0.0, t_s - time.cell_s()))
        self._catch_up()
        self._raise_fault()

    def samples_since(self, t_s: float) -> JointSamples:
        """Encoder samples of this motion; see `MovingArm.samples_since`. They lag by a tick at most."""
        self._catch_up()
        self._raise_fault()
        return self._parts.arm.samples_since(t_s)

    def finish(self) -> JointState:
        """Wait for the end of the motion and settle; see `MovingArm.finish`."""
        self._catch_up()
        self._raise_fault()
        self._moving = False
        self._parts.time.join()
        state = self._parts.arm.finish()
        self._settled = True
        return state

    def _catch_up(self) -> None:
        """Bring the arm to the cell's time.

        Sensors ask where the arm is, perhaps from the thread of their node: what stops the arm is kept for the caller
        who waits for the arm.
        """
        if not self._moving:
            return
        try:
            self._parts.arm.run_until(self._parts.time.cell_s())
        except SurfuseError as error:
            self._fault, self._moving = error, False
            self._parts.time.join()

    def _raise_fault(self) -> None:
        fault, self._fault = self._fault, None
        if fault is not None:
            raise fault

    def begin_stop(self) -> None:
        """Forget the history of the servo: the arm stands exactly where it was last sent.

        A stop then depends on its own target and the one before alone, so that an interrupted scan can be resumed
        with the same result. The difference is within the settling tolerance. An arm that has not settled since its
        last move is left alone.
        """
        if self._settled and self._parts.arm.servo.running:
            self._parts.plant.rest_at(self._parts.arm.target_rad)
            self._parts.card.look_again()
            self._parts.arm.servo.rest()
