"""The arm of the configuration without a driver: kinematics, limits, outer shape, and its check of clearance."""

from __future__ import annotations

import numpy as np

from surfuse.arm_models import puma560
from surfuse.arm_models.puma560_volume import CAPSULES, OWN_PAIRS, TOOL_LINK, column
from surfuse.errors import ConfigError
from surfuse.extras import needed_by
from surfuse.geometry.poses import pose
from surfuse.motion.body import body_of, fixture_capsules
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.obstacles import Obstacle
from surfuse.motion.own_links import own_links, separable_pairs
from surfuse.records import Fixture
from surfuse.rig.arm_model import ArmModel
from surfuse.rig.description import tool_from_array
from surfuse.settings import Settings


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


def puma560_kinematics(settings: Settings) -> puma560.Puma560:
    """The PUMA 560 on its stand, with the faces of the transducers as tool."""
    return puma560.Puma560(
        pose(np.eye(3), [0.0, 0.0, settings.arm.base_height_m]),
        pose(np.eye(3), [0.0, 0.0, settings.arm.grip_offset_m - puma560.FLANGE_OFFSET_M]) @ tool_from_array(settings),
    )


def clearance_model(
    model: ArmModel, fixture: Fixture, tube_length_m: float, obstacles: tuple[Obstacle, ...]
) -> ClearanceModel:
    """The check that arm, array and tubes keep clear of each other and of these obstacles."""
    rods = (*model.capsules, *fixture_capsules(fixture, model.tool_link, tube_length_m))
    limits, pairs = model.limits, model.own_pairs
    if pairs is None:
        pairs = separable_pairs(rods, model.link_poses, limits.lower_rad, limits.upper_rad, model.ready_rad)
    own = own_links(rods, pairs)
    return ClearanceModel(model.link_poses, body_of(rods), (*model.around, *obstacles), own)
