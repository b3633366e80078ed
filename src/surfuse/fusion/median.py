"""Baseline: the median of the validated readings of a sweep."""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.confidence.gate import GateParameters
from surfuse.fusing.median_of_sweep import medians
from surfuse.interfaces import FusionMethod

SUMMARY = "median of the validated readings of each sweep"


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Only those of validation: gate_footprints, gate_allowance_m (m)."""


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""
    return medians(parameters)
