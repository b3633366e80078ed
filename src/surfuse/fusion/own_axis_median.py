"""Every reading put where its own axis meets the surface, then the median of what several sensors read there.

Re-registration to the own axis instead of the grip axis is this project's baseline for axis-parallel arrays: with the
sensor spacing a whole multiple of the step, every place is seen by every sensor from another stop. Median and despiking
after Tukey, Exploratory Data Analysis (1977), chapter 7, and Hampel, J. Am. Stat. Assoc. 69 (1974) 383-393.
"""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.confidence.gate import GateParameters
from surfuse.fusing.despiking import telling
from surfuse.fusing.mapwise import Estimate, mapwise
from surfuse.fusing.places import covered
from surfuse.fusing.sites import at_least_scatter, between, median_sites
from surfuse.fusing.survey import Survey
from surfuse.interfaces import FusionMethod
from surfuse.records import MapGrid

SUMMARY = "median of the despiked readings at the places where their own axes meet the surface"


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Validation (gate_footprints, gate_allowance_m in m), and whether spikes are taken out.

    despike : refuse readings that fewer than a quarter of their neighbours on the part confirm.
    """

    despike: bool = True


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def estimate(heard: Survey, grid: MapGrid) -> Estimate:
        used = telling(heard, grid, parameters.despike)
        kept = heard.select(used)
        sites = at_least_scatter(median_sites(kept.foot_m, kept.sigma_m, kept.spacing_m))
        height, sigma = between(sites, grid, covered(kept, grid))
        return Estimate(height, sigma, used)

    return mapwise("own_axis_median", parameters, estimate)
