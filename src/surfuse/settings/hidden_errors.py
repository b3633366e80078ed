"""What is wrong with the rig without anybody knowing: errors that are planted in the simulated cell."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from surfuse.errors import ConfigError
from surfuse.settings.rig_tables import RigTable, Vector

LARGEST_MM, LARGEST_DEG = 200.0, 30.0

Vectors = Annotated[tuple[Vector, ...], Field(strict=False, max_length=64)]
_NONE: Vector = (0.0, 0.0, 0.0)


class HiddenErrors(RigTable):
    """Errors of the simulated rig that none of its descriptions tells: what is measured is true, what is known is not.

    Only the twin reads this table. Log, map and scene hold what a user of such a rig would believe. Turns are rotation
    vectors: the axis times the angle.
    """

    camera_mm: Vector = Field(_NONE, description="camera: how far it truly sits away, in its frame (x right, y down)")
    camera_deg: Vector = Field(_NONE, description="camera: how it is truly turned, about its own axes")
    sensor_mm: Vectors = Field(
        (),
        description="array: a vector a sensor, in the frame of the grip, z along the beams; fewer: the rest is right",
    )
    sensor_deg: Vectors = Field((), description="array: a turn a sensor, about axes of the grip through the sensor")
    base_mm: Vector = Field(_NONE, description="arm: how far its base truly stands away, in the world")
    base_deg: Vector = Field(_NONE, description="arm: how its base is truly turned, about axes of the world")
    temperature_k: float = Field(0.0, ge=-40.0, le=40.0, description="air: by how much it is warmer than told")
    speed_percent: float = Field(
        0.0, ge=-5.0, le=5.0, description="air: how much faster sound is than its temperature says"
    )

    @model_validator(mode="after")
    def _is_an_error_and_no_other_unit(self) -> Self:
        for name, limit in (("_mm", LARGEST_MM), ("_deg", LARGEST_DEG)):
            for key in (key for key in type(self).model_fields if key.endswith(name)):
                size = float(np.max(np.abs(np.array(getattr(self, key), dtype=np.float64)), initial=0.0))
                if size > limit:
                    raise ConfigError(f"hidden.{key} holds {size:g}, limit {limit:g}", cure="give a smaller error")
        return self
