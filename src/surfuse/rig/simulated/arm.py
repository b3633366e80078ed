"""The simulated cell's arm, made from the configuration: kinematics, driver, start posture, outer shape."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from surfuse.arms import simulated, trident
from surfuse.interfaces import Clock, World
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.control.computed_torque import ComputedTorque
from surfuse.motion.guard import GuardParameters, MotionGuard
from surfuse.motion.obstacles import Floor, Obstacle, RingTable
from surfuse.motion.planners import LinePlanner, slowed, through_lines, torque_limited, trapezoidal, within_tool_speed
from surfuse.records import Fixture
from surfuse.rig.arm_model import ArmModel
from surfuse.rig.configured_arm import arm_model, clearance_model, puma560_kinematics
from surfuse.rig.simulated.servo_arm import ServoDesign, ServoTwinArm, build_servo_arm, control_law, known_model
from surfuse.rig.simulated.twin_arm import TwinArm
from surfuse.settings import Settings

_PLANNED_M = 1e-3
_POTENTIOMETERS = 0x5EED  # keeps the noise of the start-up calibration apart from the world's random streams


@dataclass(frozen=True)
class ArmInCell:
    """The arm with its driver, its model, and the collision check that it makes for a list of obstacles.

    `line_planner` makes the planner of smooth passes for a speed of the tool. `guard` checks every motion.
    """

    arm: TwinArm
    model: ArmModel
    clearance: Callable[[tuple[Obstacle, ...]], ClearanceModel]
    line_planner: Callable[[float], LinePlanner]
    guard: MotionGuard


def arm_in_cell(settings: Settings, fixture: Fixture, world: World, clock: Clock) -> ArmInCell:
    """The arm of the configuration with the array on it.

    Raises
    ------
    ConfigError : there is no such arm.
    """
    model = arm_model(settings, fixture)
    clearance = partial(clearance_model, model, fixture, settings.kit.tube_length_m)
    limits, guard = slowed(model.limits, settings.arm.share_of_speed), _guard(settings, model, clearance)
    arm: TwinArm
    if settings.arm.driven_by == "trident":
        arm = _behind_cards(settings, model, world, clock, guard)
    else:
        arm = _without_dynamics(settings, model, world, clock, guard)
    dynamics = known_model(settings.arm.fixture_kg) if settings.arm.driven_by == "trident" else None
    return ArmInCell(
        arm,
        model,
        clearance,
        lambda speed_m_s: guard.checked(through_lines(model.kinematics, limits, dynamics, speed_m_s)),
        guard,
    )


def _guard(
    settings: Settings, model: ArmModel, clearance: Callable[[tuple[Obstacle, ...]], ClearanceModel]
) -> MotionGuard:
    """The check of every motion; before the part is found it knows the table and the floor."""
    table, own = settings.cell, settings.arm
    ring = RingTable(table.table_height_m, table.table_inner_radius_m, table.table_outer_radius_m)
    # A little less than what is planned with: the arm starts from where it was sent, not quite from where it is.
    keep = GuardParameters(max(own.clearance_m - _PLANNED_M, 0.0), own.tool_speed_max_m_s)
    return MotionGuard(model.kinematics, model.limits, clearance, (Floor(), ring), keep)


def _without_dynamics(
    settings: Settings, model: ArmModel, world: World, clock: Clock, guard: MotionGuard
) -> simulated.SimulatedArm:
    """An arm that is where it is sent, after the time that a move takes within its limits."""
    own = settings.arm
    around = simulated.Surroundings(
        kinematics=model.kinematics,
        limits=model.limits,
        clock=clock,
        guard=guard,
        world=world,
        start_rad=model.ready_rad,
    )
    return simulated.create(
        simulated.Parameters(
            own.settle_s, own.share_of_speed, model.encoder_rad_per_count, own.tool_speed_max_m_s, surroundings=around
        )
    )


def _behind_cards(settings: Settings, model: ArmModel, world: World, clock: Clock, guard: MotionGuard) -> ServoTwinArm:
    """The PUMA 560 with its dynamics, driven through the servo cards."""
    own = settings.arm
    known = known_model(own.fixture_kg)
    # Only computed torque follows a motion that goes to the torque limits; the others get the published limits.
    planner = (
        torque_limited(known, model.limits, speed_share=own.share_of_speed)
        if own.law == ComputedTorque.name
        else trapezoidal(slowed(model.limits, own.share_of_speed))
    )
    rng = np.random.default_rng([settings.seed, _POTENTIOMETERS])
    own_rad = control_law(own.law, known).settle_rad
    settle_rad = own_rad if own.settle_deg is None else float(np.radians(own.settle_deg))
    design = ServoDesign(
        own.law,
        within_tool_speed(planner, model.kinematics, own.tool_speed_max_m_s),
        fixture_kg=own.fixture_kg,
        parameters=trident.Parameters(settle_rad, rest_s=own.settle_s, speed_share=own.share_of_speed),
    )
    parts = build_servo_arm(puma560_kinematics(settings), clock, rng, design, model.ready_rad, guard)
    return ServoTwinArm(parts, world)
