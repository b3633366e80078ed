"""The simulated cell's arm, made from the configuration: kinematics, driver, start posture, outer shape."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from surfuse.arm_models import puma560
from surfuse.arm_models.puma560_volume import CAPSULES, OWN_PAIRS, TOOL_LINK, column
from surfuse.arms import simulated, trident
from surfuse.errors import ConfigError
from surfuse.extras import needed_by
from surfuse.geometry.poses import pose
from surfuse.interfaces import Clock, World
from surfuse.motion.body import body_of, fixture_capsules
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.control.computed_torque import ComputedTorque
from surfuse.motion.guard import GuardParameters, MotionGuard
from surfuse.motion.obstacles import Floor, Obstacle, RingTable
from surfuse.motion.own_links import own_links, separable_pairs
from surfuse.motion.planners import LinePlanner, slowed, through_lines, torque_limited, trapezoidal, within_tool_speed
from surfuse.records import Fixture
from surfuse.rig.arm_model import ArmModel, TwinArm
from surfuse.rig.simulated.servo_arm import ServoTwinArm, build_servo_arm, known_model
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
    clearance = partial(_clearance, model, fixture, settings.kit.tube_length_m)
    limits, guard = slowed(model.limits, settings.arm.speed_share), _guard(settings, model, clearance)
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


def arm_model(settings: Settings, fixture: Fixture) -> ArmModel:
    """The arm of the configuration without driver.

    Raises
    ------
    ConfigError : there is no such arm, or a package that its file needs is missing.
    DataError : the arm's file is refused.
    """
    if settings.arm.file is not None:
        with needed_by("an arm file", settings.arm.file):
            from surfuse.rig.arm_of_file import model_of_file
        return model_of_file(settings, fixture)
    if settings.arm.tool is not None:
        raise ConfigError(f"arm.tool = '{settings.arm.tool}' without an arm file", cure="give arm.file, or --arm FILE")
    if settings.arm.name != "puma560":
        raise ConfigError(
            f"arm.name = '{settings.arm.name}'",
            cure="the simulated cell has the arm 'puma560', or that of a file (arm.file)",
        )
    kinematics = puma560_kinematics(settings)
    return ArmModel(
        kinematics,
        kinematics.link_poses,
        puma560.LIMITS,
        puma560.READY_RAD,
        puma560.ENCODER_RAD_PER_COUNT,
        CAPSULES,
        TOOL_LINK,
        (column(settings.arm.base_height_m),),
        OWN_PAIRS,
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
            own.settle_s, own.speed_share, model.encoder_rad_per_count, own.tool_speed_max_m_s, surroundings=around
        )
    )


def _behind_cards(settings: Settings, model: ArmModel, world: World, clock: Clock, guard: MotionGuard) -> ServoTwinArm:
    """The PUMA 560 with its dynamics, driven through the servo cards."""
    own = settings.arm
    known = known_model(own.fixture_kg)
    # Only computed torque follows a motion that goes to the torque limits; the others get the published limits.
    planner = (
        torque_limited(known, model.limits, speed_share=own.speed_share)
        if own.law == ComputedTorque.name
        else trapezoidal(slowed(model.limits, own.speed_share))
    )
    rng = np.random.default_rng([settings.seed, _POTENTIOMETERS])
    parts = build_servo_arm(
        puma560_kinematics(settings),
        clock,
        rng,
        own.law,
        within_tool_speed(planner, model.kinematics, own.tool_speed_max_m_s),
        start_rad=model.ready_rad,
        parameters=trident.Parameters(np.radians(own.settle_deg), rest_s=own.settle_s),
        fixture_kg=own.fixture_kg,
        guard=guard,
    )
    return ServoTwinArm(parts, world)


def puma560_kinematics(settings: Settings) -> puma560.Puma560:
    """The PUMA 560 on its stand, with the faces of the transducers as tool."""
    return puma560.Puma560(
        pose(np.eye(3), [0.0, 0.0, settings.arm.base_height_m]),
        pose(np.eye(3), [0.0, 0.0, settings.arm.grip_offset_m - puma560.FLANGE_OFFSET_M]),
    )


def _clearance(
    model: ArmModel, fixture: Fixture, tube_length_m: float, obstacles: tuple[Obstacle, ...]
) -> ClearanceModel:
    rods = (*model.capsules, *fixture_capsules(fixture, model.tool_link, tube_length_m))
    limits, pairs = model.limits, model.own_pairs
    if pairs is None:
        pairs = separable_pairs(rods, model.link_poses, limits.lower_rad, limits.upper_rad, model.ready_rad)
    own = own_links(rods, pairs)
    return ClearanceModel(model.link_poses, body_of(rods), (*model.around, *obstacles), own)
