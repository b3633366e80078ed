"""How far other explanations of the same readings are from the one that was chosen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surfuse.beam_model.prior.raster import Raster
from surfuse.beam_model.search.descent import Solution
from surfuse.records import FloatArray, MapGrid

# Evidence of this many units is worth one: chosen by the coverage of the intervals on the development parts.
TEMPER = 25.0


def rival_spread(found: Sequence[Solution], temper: float = TEMPER) -> FloatArray:
    """Root mean square distance (R, C) in m of all explanations from the first, the best one.

    Their weights are exp(-(score - best) / temper): evidence is the sum over readings whose errors are not quite
    independent and whose model is not quite right, so that its differences are worth less than they say.
    """
    scores = np.array([one.score for one in found])
    weight = np.exp(-np.maximum(scores - scores[0], 0.0) / temper)
    weight /= weight.sum()
    best = found[0].height_m
    return np.asarray(
        np.sqrt(sum(w * (one.height_m - best) ** 2 for w, one in zip(weight, found, strict=True))), dtype=np.float64
    )


def laid_on(layer: FloatArray, coarse: Raster, raster: Raster) -> FloatArray:
    """A layer of one raster at the nearest nodes of another (R, C); 0 outside."""
    u, v = raster.nodes()
    return np.nan_to_num(coarse.sample(layer, MapGrid(u, v, np.eye(4))))
