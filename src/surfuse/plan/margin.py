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


@dataclass(frozen=True)
class MarginParameters:
    """How the margin follows from what is known of the outline.

    Parameters
    ----------
    containment : share of parts whose true outline shall lie inside the enlarged one.
    unseen_m : what no standard deviation covers: sides that are nearly edge-on or too dark, corners that dominant
        points cut. Measured over random scenes by `benchmarks/bench_margin.py`.
    run_in_stops : steps beyond the rim that are scanned at least. A prediction needs two values before its own (paper,
        section 3.2), so a rim without stops outside of it comes out worse.
    run_in_max_m : the longest run-in, for coarse steps: farther out hardly a sensor of the array points at the part.
    """

    containment: float = 0.99
    unseen_m: float = 0.008
    run_in_stops: float = 2.0
    run_in_max_m: float = 0.02

    def __post_init__(self) -> None:
        if not 0.5 <= self.containment < 1.0:
            raise ConfigError(f"containment = {self.containment}", cure="give a share from 0.5 to below 1")
        if not 0.0 <= self.run_in_stops <= 100.0:
            raise ConfigError(f"run_in_stops = {self.run_in_stops}", cure="give a number of stops from 0 to 100")
        for name in ("unseen_m", "run_in_max_m"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give a length from 0 to below 1 m")


def scan_area(outline: Outline, step_m: float, parameters: MarginParameters | None = None) -> Outline:
    """The outline to be scanned: the part as seen along w, enlarged by the margin that its uncertainty asks for.

    The margin is at least the run-in, which follows from the step of the scan (m).

    Raises
    ------
    DataError : the outline crosses itself.
    """
    view = front_view(outline)
    seen = dataclasses.replace(outline, vertices_m=view.vertices_m, sigma_m=np.zeros(0), viewpoint_m=None)
    chosen = parameters or MarginParameters()
    run_in_m = min(chosen.run_in_stops * step_m, chosen.run_in_max_m)
    return enlarged(seen, max(_margin(outline, view, chosen), run_in_m))


def margin_for(outline: Outline, parameters: MarginParameters | None = None) -> float:
    """The margin (m) that holds the true outline with the stated probability, around the outline as seen along w.

    The one-sided Gaussian quantile of the largest standard deviation of a vertex, without the share that the front view
    has already put right (the relief of the foot), and what is unseen.
    """
    return _margin(outline, front_view(outline), parameters or MarginParameters())


def margin_on_plane(outline: Outline, step_m: float, parameters: MarginParameters | None = None) -> float:
    """The same (m) of an outline on a plane that the camera looks down at, whose sides stand up from w = 0.

    Nothing is put right: the outline as seen holds the part. At least the run-in, as in `scan_area`.
    """
    chosen = parameters or MarginParameters()
    sigma_m = float(outline.sigma_m.max())
    run_in_m = min(chosen.run_in_stops * step_m, chosen.run_in_max_m)
    return max(chosen.unseen_m + float(ndtri(chosen.containment)) * sigma_m, run_in_m)


def margin_in_words(outline: Outline, margin_m: float, given: bool) -> str:
    """The margin (m) of a plan and why it is that large, given the outline as the camera saw it."""
    asked = margin_for(outline)
    if given:
        return f"{1e3 * margin_m:.1f} mm as configured; the outline's uncertainty asks for {1e3 * asked:.1f} mm"
    if margin_m > asked + 1e-6:
        return f"{1e3 * margin_m:.1f} mm, the run-in; the outline's uncertainty asks for {1e3 * asked:.1f} mm"
    return f"{1e3 * margin_m:.1f} mm, asked for by the outline's uncertainty"


def _margin(outline: Outline, view: FrontView, chosen: MarginParameters) -> float:
    variance = outline.sigma_m**2
    if outline.viewpoint_m is not None and outline.viewpoint_m[2] > 0.0:
        aside = np.abs(outline.vertices_m - outline.viewpoint_m[:2]).max(axis=1) / outline.viewpoint_m[2]
        # Never below a hundredth: what was put right is not known without error either.
        variance = np.maximum(variance - (view.relief_m * aside) ** 2, 0.01 * variance)
    return chosen.unseen_m + float(ndtri(chosen.containment)) * float(np.sqrt(variance.max()))


def enlarged(outline: Outline, margin_m: float) -> Outline:
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
