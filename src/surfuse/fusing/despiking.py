"""Despiking: which readings their neighbours on the part confirm."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from surfuse.fusing.places import feet_on_part
from surfuse.fusing.survey import SAME_PLACE_M, Survey
from surfuse.records import BoolArray, MapGrid

NEIGHBOURS = 12
"""Neighbours that are asked: with four sensors on one lattice, those of three places."""

JUDGES = 4
"""With fewer neighbours a reading is not judged."""

SHARE = 0.25
"""Share of the neighbours that must agree: the inner corner of a step has a quarter of its surroundings on its side."""

STEEPEST = 1.0
"""Steepest slope between neighbours that is still a slope: 45 degrees, beyond every usable incidence."""

PASSES = 2

FLOOR_M = 0.002
SIGMAS = 4.0


def supported(survey: Survey) -> BoolArray:
    """Which readings (N,) at least a quarter of their nearest neighbours confirms.

    A neighbour confirms a height that lies within 45 degrees of its own, plus 2 mm and four standard deviations.
    Neighbours are the twelve nearest within three stops, where the axes looked and not where the echoes seemed to
    come from, whichever sensor read them and whenever: not the other sensors of the same stop, which look elsewhere.
    A lone spike, late or early, has nobody on its side; both sides of a step have. Those left are asked once more
    about each other, so that spikes do not confirm spikes.
    """
    n = len(survey)
    if n <= JUDGES:
        return np.ones(n, dtype=np.bool_)
    # With one stop only the readings of the same place can be asked.
    reach = 3.0 * survey.spacing_m if np.isfinite(survey.spacing_m) else SAME_PLACE_M
    distance, index = cKDTree(survey.aim_m).query(survey.aim_m, k=min(NEIGHBOURS + 1, n), distance_upper_bound=reach)
    # Among readings at one place the reading itself need not come first.
    near = np.isfinite(distance) & (index != np.arange(n)[:, None])
    other = np.where(near, index, 0)
    rise = np.abs(survey.foot_m[other, 2] - survey.foot_m[:, None, 2])
    noise = np.hypot(survey.sigma_m[other], survey.sigma_m[:, None])
    allowed = STEEPEST * np.where(near, distance, 0.0) + SIGMAS * noise + FLOOR_M
    keep = np.ones(n, dtype=np.bool_)
    for _ in range(PASSES):
        asked = near & keep[other]
        judges, agree = asked.sum(axis=1), (asked & (rise <= allowed)).sum(axis=1)
        keep &= (judges < JUDGES) | (agree >= SHARE * judges)
    return keep


def telling(survey: Survey, grid: MapGrid, despike: bool = True) -> BoolArray:
    """Which readings (N,) tell the height where their axis ends: it meets the part, and neighbours confirm it.

    A reading whose axis misses the outline was heard from the rim, from nearer or later than the part is there.
    """
    on_part = feet_on_part(survey, grid)
    return on_part & supported(survey) if despike else on_part
