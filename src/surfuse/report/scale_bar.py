"""A scale in the scene: the axes of the part frame as bars of one round length, with their names."""

from __future__ import annotations

import numpy as np
import viser

from surfuse.geometry.poses import transform_points
from surfuse.records import FloatArray

_AXES = (("u", (213, 94, 0)), ("v", (0, 158, 115)), ("w", (0, 114, 178)))


def round_length(extent_m: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is no longer than a third of the extent (m)."""
    third = max(extent_m, 1e-6) / 3.0
    power = 10.0 ** np.floor(np.log10(third))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= third * (1.0 + 1e-9)))


def length_in_words(length_m: float) -> str:
    """A round length with its unit."""
    return f"{length_m:g} m" if length_m >= 1.0 else f"{1e3 * length_m:g} mm"


def add_scale_bar(
    scene: viser.SceneApi, world_from_part: FloatArray, low_uv_m: FloatArray, high_uv_m: FloatArray
) -> None:
    """Stand the bars beside the lower corner of the box from low to high (2,) in the part frame."""
    extent_m = float(np.max(high_uv_m - low_uv_m))
    length, away = round_length(extent_m), 0.06 * extent_m
    # Beside the part, not below it, where the table is.
    corner = np.array([low_uv_m[0] - away, low_uv_m[1], 0.0])
    ends = np.stack([np.tile(corner, (3, 1)), corner + length * np.eye(3)], axis=1)
    world = transform_points(world_from_part, ends.reshape(-1, 3)).reshape(3, 2, 3)
    colours = np.repeat(np.array([colour for _, colour in _AXES], dtype=np.uint8)[:, None], 2, axis=1)
    scene.add_line_segments("/scale/bars", world, colours, thickness=4.0, thickness_units="screen")
    for (name, _), (_, tip) in zip(_AXES, world, strict=True):
        text = f"{name}  {length_in_words(length)}" if name == "u" else name
        scene.add_label(f"/scale/{name}", text, position=tip)
