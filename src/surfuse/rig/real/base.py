"""Where the base of a real arm stands."""

from __future__ import annotations

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.poses import is_rigid
from surfuse.records import FloatArray
from surfuse.settings import Settings


def world_from_base(settings: Settings) -> FloatArray:
    """Pose (4, 4) of the arm's base in the world; that of the world itself unless the cell file says it.

    Raises
    ------
    ConfigError : it is no rigid pose.
    """
    numbers = settings.arm.world_from_base
    if numbers is None:
        return np.eye(4)
    if len(numbers) != 16 or not is_rigid(np.array(numbers).reshape(4, 4)):
        raise ConfigError(
            f"arm.world_from_base has {len(numbers)} numbers that are no rigid pose",
            cure="give 16 numbers: a 4 x 4 pose, row by row, right-handed",
        )
    return np.array(numbers, dtype=np.float64).reshape(4, 4)
