"""The arm of an MJCF or URDF file in the cell: where it stands, how it may move, in which posture it looks around."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surfuse.arm_models import model_file
from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import pose
from surfuse.motion.body import Capsule, body_of, fixture_capsules
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.limits import check_position
from surfuse.motion.obstacles import Column, Floor, Obstacle, RingTable
from surfuse.motion.own_links import own_links, separable_pairs
from surfuse.records import Fixture, FloatArray
from surfuse.rig.arm_model import ArmModel
from surfuse.rig.description import tool_from_array
from surfuse.settings import Settings

ENCODER_RAD = 1e-4  # of the simulated encoders; files do not say
_COLUMN_RADIUS_M = 0.10
_UPRIGHT = 1e-6
_GRIP_OUTWARDS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_ROOM_ENOUGH_M = 0.10
_SINGULAR_LEAST = 0.02


def model_of_file(settings: Settings, fixture: Fixture) -> ArmModel:
    """The arm of `arm.file`, its first axis over the middle of the ring table.

    Raises
    ------
    ConfigError : no tool frame is named, joint 1 does not turn about the vertical, or no ready posture is found.
    DataError : the file is refused (see `arms.models.arm_file.read_arm`).
    SafetyStopError : the ready posture that was given is outside the joint limits.
    """
    own = settings.arm
    path = Path(own.file or "")
    if not path.is_file():
        what = "it is a folder" if path.exists() else "there is no such file"
        raise DataError(what, where=str(path), cure="give an MJCF or URDF file")
    if own.tool is None:
        raise ConfigError(
            "no tool frame is named",
            cure="name the site, body or link that carries the array: --tool FRAME",
            where=own.file or "",
        )
    if own.driver == "trident":
        raise ConfigError(
            f"arm.driver = 'trident' with the arm '{path.name}'",
            cure="the servo cards and their dynamics are those of the PUMA 560: take arm.driver = 'kinematic'",
        )
    limits = model_file.Parameters(np.radians(own.joint_speed_deg_s), np.radians(own.joint_acceleration_deg_s2))
    arm = model_file.create(path, own.tool, np.eye(4), np.eye(4), limits)
    axis, point = arm.screw_arguments[0][0], arm.screw_arguments[1][0]
    if not axis[2] > 1.0 - _UPRIGHT:
        raise ConfigError(
            f"joint '{arm.joint_names[0]}' turns about ({axis[0]:.3g}, {axis[1]:.3g}, {axis[2]:.3g}), wanted (0, 0, 1)",
            cure="the search turns the first joint about the vertical: correct the file, or turn its base",
            where=str(path),
        )
    on_stand = pose(np.eye(3), [-point[0], -point[1], own.base_height_m])
    tool_from_grip = pose(np.eye(3), [0.0, 0.0, own.grip_offset_m]) @ tool_from_array(settings)
    arm = model_file.create(path, own.tool, on_stand, tool_from_grip, limits)
    around = (Column(own.base_height_m, _COLUMN_RADIUS_M, ignores=("base", "link 1")),)
    tool_link = len(arm.joint_names) + 1
    return ArmModel(
        arm,
        arm.link_poses,
        arm.limits,
        _ready(settings, arm, fixture, tool_link, around),
        (ENCODER_RAD,) * len(arm.joint_names),
        arm.capsules,
        tool_link,
        around,
    )


def _ready(
    settings: Settings, arm: model_file.ModelFileArm, fixture: Fixture, tool_link: int, around: tuple[Obstacle, ...]
) -> FloatArray:
    """The posture of the search: as given, else the roomiest one with the array looking outwards over the table."""
    if settings.arm.ready_deg is not None:
        given = np.radians(settings.arm.ready_deg)
        check_position(given, arm.limits)
        return np.asarray(given)
    table = settings.cell
    ring = RingTable(table.table_height_m, table.table_inner_radius_m, table.table_outer_radius_m)
    rods = (*arm.capsules, *fixture_capsules(fixture, tool_link, settings.kit.tube_length_m))
    radii, heights = np.meshgrid(np.arange(0.25, 0.75, 0.06), table.table_height_m + np.arange(0.0, 0.6, 0.1))
    targets = np.array([pose(_GRIP_OUTWARDS, [r, 0.0, z]) for r, z in zip(radii.flat, heights.flat, strict=True)])
    solutions, valid = arm.inverse(targets)
    own = own_links(rods, _pairs_that_part(arm, rods, solutions[valid]))
    check = ClearanceModel(arm.link_poses, body_of(rods), (*around, Floor(), ring), own)
    merit = np.full(valid.shape, -np.inf)
    if valid.any():
        room, away = check(solutions[valid]).distance_m, arm.singularity_distance(solutions[valid])[:, 0]
        usable = (room > settings.arm.clearance_m) & (away > _SINGULAR_LEAST)
        merit[valid] = np.where(usable, np.minimum(room, _ROOM_ENOUGH_M) / _ROOM_ENOUGH_M + away, -np.inf)
    # The configuration that is good at most places is the one of the scan, so that the way to it is short.
    good = np.isfinite(merit).sum(axis=0)
    if not good.any():
        raise ConfigError(
            f"no posture was found in which the tool frame '{settings.arm.tool}' looks outwards over the table "
            f"({int(valid.sum())} postures reach such a place, none is clear of everything)",
            cure="change arm.base_height_m, name another tool frame (z along the beams), or give arm.ready_deg",
            where=settings.arm.file or "",
        )
    k = int(np.argmax(good))
    return np.asarray(solutions[int(np.argmax(merit[:, k])), k])


def _pairs_that_part(
    arm: model_file.ModelFileArm, rods: tuple[Capsule, ...], postures: FloatArray
) -> tuple[tuple[str, str], ...]:
    """Pairs of parts that are apart in some of the postures (N, J): the ready one is not known yet."""
    few = postures[:: max(1, len(postures) // 12)]
    pairs: dict[tuple[str, str], None] = {}
    for posture in few:
        pairs |= dict.fromkeys(separable_pairs(rods, arm.link_poses, arm.lower_rad, arm.upper_rad, posture))
    return tuple(pairs)
