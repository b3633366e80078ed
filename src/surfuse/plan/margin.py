"""Enlarging the outline before the scan, because its edges are only known roughly (paper, section 3.2, figure 6b)."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from surfuse.errors import ConfigError
from surfuse.geometry.offsets import offset
from surfuse.plan.front_view import FrontView, front_view
from surfuse.records import Outline

MARGIN_M = 0.02


@dataclass(frozen=True)
class MarginParameters:
    """How the margin follows from what is known of the outline.

    Parameters
    ----------
    containment : share of parts whose true outline shall lie inside the enlarged one.
    unseen_m : what no standard deviation covers: sides that are nearly edge-on or too dark, corners that dominant
        points cut. Measured over random scenes by `benchmarks/bench_margin.py`.
    """

    containment: float = 0.99
    unseen_m: float = 0.008

    def __post_init__(self) -> None:
        if not 0.5 <= self.containment < 1.0:
            raise ConfigError(f"containment = {self.containment}", cure="give a share from 0.5 to below 1")
        if not 0.0 <= self.unseen_m < 1.0:
            raise ConfigError(f"unseen_m = {self.unseen_m}", cure="give a length from 0 to below 1 m")


def scan_area(outline: Outline, parameters: MarginParameters | None = None) -> Outline:
    """The outline to be scanned: the part as seen along w, enlarged by the margin that its uncertainty asks for.

    Raises
    ------
    DataError : the outline crosses itself.
    """
    view = front_view(outline)
    seen = dataclasses.replace(outline, vertices_m=view.vertices_m, sigma_m=np.zeros(0), viewpoint_m=None)
    return enlarged(seen, _margin(outline, view, parameters or MarginParameters()))


def margin_for(outline: Outline, parameters: MarginParameters | None = None) -> float:
    """The margin (m) that holds the true outline with the stated probability, around the outline as seen along w.

    The one-sided Gaussian quantile of the largest standard deviation of a vertex, without the share that the front view
    has already put right (the relief of the foot), and what is unseen.
    """
    return _margin(outline, front_view(outline), parameters or MarginParameters())


def _margin(outline: Outline, view: FrontView, chosen: MarginParameters) -> float:
    variance = outline.sigma_m**2
    if outline.viewpoint_m is not None and outline.viewpoint_m[2] > 0.0:
        aside = np.abs(outline.vertices_m - outline.viewpoint_m[:2]).max(axis=1) / outline.viewpoint_m[2]
        # Never below a hundredth: what was put right is not known without error either.
        variance = np.maximum(variance - (view.relief_m * aside) ** 2, 0.01 * variance)
    return chosen.unseen_m + float(ndtri(chosen.containment)) * float(np.sqrt(variance.max()))


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
