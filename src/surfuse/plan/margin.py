"""Enlarging the outline before the scan, because its edges are only known roughly (paper, section 3.2, figure 6b)."""

from __future__ import annotations

import dataclasses

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.offsets import offset
from surfuse.records import Outline

MARGIN_M = 0.02


def enlarged(outline: Outline, margin_m: float = MARGIN_M) -> Outline:
    """The outline moved outwards by the margin (m); its `margin_m` grows by as much.

    Holes stay as they are: they are scanned, so that the readings can tell whether they are there. The standard
    deviations of the vertices are dropped, because the new vertices are not the old ones.

    Raises
    ------
    ConfigError : the margin is negative or not finite.
    DataError : the outline crosses itself.
    """
    if not (np.isfinite(margin_m) and margin_m >= 0.0):
        raise ConfigError(f"margin_m = {margin_m}", cure="give a margin of 0 m or more")
    return dataclasses.replace(
        outline,
        vertices_m=offset(outline.vertices_m, margin_m),
        margin_m=outline.margin_m + margin_m,
        sigma_m=np.zeros(0),
    )
