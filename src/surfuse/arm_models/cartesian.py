"""A machine with three straight axes: how it stands in the world, how far it travels, which way its tool looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.poses import are_rigid, inverse, pose
from surfuse.records import BoolArray, FloatArray

_ON_LIMIT_M = 1e-6

UNTURNED = tuple(float(number) for number in np.eye(4).ravel())
LOOKING_DOWN = (1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0)


@dataclass(frozen=True)
class CartesianMachine:
    """Poses of its tool have one orientation.

    Parameters
    ----------
    world_from_machine : 16 numbers, a pose row by row.
    tool_turn : 9 numbers, a rotation row by row: the tool's axes in the machine.
    travel_min_m, travel_max_m : least and greatest place of the tool, in the machine's coordinates.
    turn_tolerance_rad : how much a pose may be turned and still be taken.
    """

    world_from_machine: tuple[float, ...]
    tool_turn: tuple[float, ...]
    travel_min_m: tuple[float, float, float]
    travel_max_m: tuple[float, float, float]
    turn_tolerance_rad: float

    def __post_init__(self) -> None:
        _check_pose("world_from_machine", self.world_from_machine, 4)
        _check_pose("tool_turn", self.tool_turn, 3)
        for axis, low, high in zip("xyz", self.travel_min_m, self.travel_max_m, strict=True):
            if not (np.isfinite([low, high]).all() and low < high):
                raise ConfigError(
                    f"travel of {axis} from {low} to {high} m", cure="give a least below a greatest value"
                )
            if max(abs(low), abs(high)) > 20.0:
                raise ConfigError(f"travel of {axis} from {low} to {high} m", cure="give metres, not millimetres")

    @property
    def beam(self) -> FloatArray:
        """The tool's z (3,) in the machine: where its sensors look."""
        return self._turn[:, 2]

    def tool_at(self, place_m: FloatArray) -> FloatArray:
        """`world_from_tool` (4, 4) at a place (3,) of the machine."""
        placed: FloatArray = self._world @ pose(self._turn, place_m)
        return placed

    def place_of(self, world_from_tool: FloatArray) -> FloatArray:
        """The place (3,) of the machine for a pose (4, 4)."""
        placed: FloatArray = (inverse(self._world) @ world_from_tool)[:3, 3]
        return np.clip(placed, self.travel_min_m, self.travel_max_m)

    def reachable(self, world_from_tool: FloatArray) -> BoolArray:
        """Which poses (N, 4, 4) the machine can take."""
        return np.array([self.excess(one) is None for one in world_from_tool], dtype=np.bool_)

    def excess(self, world_from_tool: FloatArray) -> str | None:
        """Why a pose (4, 4) cannot be taken, with value and limit; None when it can."""
        if not np.isfinite(world_from_tool).all():
            return "the pose holds numbers that are not finite"
        if not bool(are_rigid(world_from_tool)):
            return "the pose is no rotation and place: it is mirrored or stretched"
        machine_from_tool = inverse(self._world) @ world_from_tool
        turned_rad = _angle_rad(self._turn.T @ machine_from_tool[:3, :3])
        if not turned_rad <= self.turn_tolerance_rad:
            most_deg = np.degrees(self.turn_tolerance_rad)
            return (
                f"the pose is turned by {np.degrees(turned_rad):.2f} deg from the tool's only orientation, "
                f"at most {most_deg:g} deg"
            )
        places = zip("xyz", machine_from_tool[:3, 3], self.travel_min_m, self.travel_max_m, strict=True)
        for axis, value, low, high in places:
            if not low - _ON_LIMIT_M <= value <= high + _ON_LIMIT_M:
                return f"{axis} = {value:.4f} m in the machine lies outside of its travel, {low:g} to {high:g} m"
        return None

    @property
    def _world(self) -> FloatArray:
        return np.reshape(self.world_from_machine, (4, 4))

    @property
    def _turn(self) -> FloatArray:
        return np.reshape(self.tool_turn, (3, 3))


def _angle_rad(turn: FloatArray) -> float:
    """The angle of a rotation (3, 3), by sine and cosine, which is exact also near 0."""
    twice_sine = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return float(np.arctan2(np.linalg.norm(twice_sine), np.trace(turn) - 1.0))


def _check_pose(name: str, numbers: tuple[float, ...], size: int) -> None:
    """Refuse what is no rotation (9 numbers) or no rigid pose (16 numbers)."""
    if len(numbers) != size * size:
        raise ConfigError(f"{name} has {len(numbers)} numbers", cure=f"give {size * size}, row by row")
    square = np.reshape(numbers, (size, size))
    if not bool(are_rigid(square if size == 4 else pose(square, np.zeros(3)))):
        raise ConfigError(
            f"{name} = {list(numbers)} is no right-handed {'rotation and place' if size == 4 else 'rotation'}",
            cure="give axes of length 1 at right angles, the third to the right hand of the first two",
        )
