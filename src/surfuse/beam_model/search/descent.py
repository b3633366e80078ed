"""From a start to the most probable surface, and how probable that explanation is as a whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.beam_model.prior.band_matrix import factor, log_determinant, solve
from surfuse.beam_model.prior.smoothness import Stiffness
from surfuse.beam_model.search.estimation import Arrivals, Estimation, arrivals, loudness, misfit, pulls
from surfuse.beam_model.search.unheld_pieces import reattached
from surfuse.records import FloatArray

# Prior standard deviation of a height about the start, so that the determinants exist.
LOOSE_M = 0.5
DAMPING = (1.0, 0.5, 0.2, 0.05)
# Gain of a step, over the root of the number of stations, below which a temper is done.
SETTLED_GAIN = 0.02
# A start that is pulled from farther away than this is not asked how loud its echoes would be.
DEAF_M = 0.001


@dataclass(frozen=True)
class Solution:
    """A surface (R, C), the arrivals over it, and its score: minus log evidence (Laplace's approximation).

    `height_m` in m; `crease_m` is the bend beyond which it has edges, `stiffness` the prior it was found with, `start`
    the name of where the descent began. Scores are natural logarithms: a difference of 1 is a factor of e.
    """

    height_m: FloatArray
    heard: Arrivals
    stiffness: Stiffness
    crease_m: float
    score: float
    start: str


def crease(p: Estimation, stiffness: Stiffness) -> float:
    """Bend (m) between cells beyond which the prior calls it an edge."""
    return float(np.clip(np.sqrt(2.0 * 8.0 * stiffness.second) * p.raster.g_m, 0.0015, 0.004))


def objective(p: Estimation, height: FloatArray, heard: Arrivals, stiffness: Stiffness, temper_m: float) -> float:
    """Minus log posterior of a surface, up to a constant.

    `height` (R, C) in m, `heard` the arrivals over it. `temper_m` is added to the deviation of every residual, so that
    a bad start is pulled from afar. In units of log likelihood.
    """
    loud = float(np.sum(loudness(p, height, crease(p, stiffness)))) if temper_m < DEAF_M else 0.0
    return float(np.sum(misfit(p, heard, temper_m))) + p.plate.energy(height, stiffness) + loud


def descend(
    p: Estimation, height: FloatArray, stiffness: Stiffness, crease_m: float, tempers_m: tuple[float, ...]
) -> tuple[FloatArray, Arrivals]:
    """Gauss-Newton with backtracking; each step solves the linearised problem and keeps what lowers the objective.

    One step for each of `tempers_m` (see `objective`), left out once the steps of the same temper gain nothing. Returns
    heights (R, C) in m and the arrivals over them; `height` (R, C) is the start and stays as it is.
    """
    heard = arrivals(p, height, crease_m)
    settled = False
    for k, temper in enumerate(tempers_m):
        if settled and temper == tempers_m[k - 1]:
            continue
        now = objective(p, height, heard, stiffness, temper)
        goal = newton_goal(p, height, heard, stiffness, temper)
        value = now
        for share in DAMPING:
            trial = height + share * (goal - height)
            there = arrivals(p, trial, crease_m)
            value = objective(p, trial, there, stiffness, temper)
            if value < now:
                height, heard = trial, there
                break
        settled = now - value < SETTLED_GAIN * len(p.stations) ** 0.5
    return height, heard


def newton_goal(
    p: Estimation, height: FloatArray, heard: Arrivals, stiffness: Stiffness, temper_m: float
) -> FloatArray:
    """Minimum (R, C) of the objective linearised at a surface."""
    data, target = pulls(p, heard, height, temper_m)
    band = p.plate.precision(height, stiffness, LOOSE_M**-2)
    band[:, 0] += p.plate.vector(data)
    return p.plate.field(solve(factor(band), p.plate.vector(data * target + height * LOOSE_M**-2)))


def evidence(p: Estimation, height: FloatArray, heard: Arrivals, stiffness: Stiffness) -> float:
    """Minus log evidence: objective plus half the log ratio of posterior and prior precision.

    Laplace's approximation (MacKay, Neural Computation 4, 1992), at a minimum `height` (R, C) in m of the objective
    without temper. Only differences between explanations of the same readings mean something.
    """
    prior = p.plate.precision(height, stiffness, LOOSE_M**-2)
    posterior = prior.copy()
    posterior[:, 0] += p.plate.vector(pulls(p, heard, height, 0.0)[0])
    volume = 0.5 * (log_determinant(factor(posterior)) - log_determinant(factor(prior)))
    return objective(p, height, heard, stiffness, 0.0) + volume


def find(p: Estimation, start: FloatArray, name: str, stiffness: Stiffness, tempers_m: tuple[float, ...]) -> Solution:
    """Descend from a start and score what is found.

    `start` (R, C) in m. After the descent pieces that no reading holds are laid onto their neighbours; where that
    changes anything the last tempers are run again. `name` says where it began.
    """
    width = crease(p, stiffness)
    height, heard = descend(p, start, stiffness, width, tempers_m)
    again = reattached(p, height, heard, width)
    if again is not height:
        height, heard = descend(p, again, stiffness, width, tempers_m[-3:])
    return Solution(height, heard, stiffness, width, evidence(p, height, heard, stiffness), name)
