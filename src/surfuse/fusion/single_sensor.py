"""Baseline: one reading a stop, as from an array of one sensor.

What fusion adds is what it is better than this. The chosen sensor is read; where it has no valid reading, the next one
in the order of the array stands in. The live value of a stop is that reading projected onto the grip axis, the paper's
equation 1 with one sensor; in the map each reading stands where its own axis meets the surface, because a scan with one
sensor would have put its own axis there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.confidence.gate import GateParameters, Limits, gap_reason, validate
from surfuse.confidence.parameters import check_within
from surfuse.fusing.mapwise import Estimate, mapwise
from surfuse.fusing.places import covered
from surfuse.fusing.sites import at_least_scatter, between, mean_sites
from surfuse.fusing.survey import Survey
from surfuse.fusing.sweepwise import BLOCK, SweepwiseFusion, block_readings
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import IntArray, MapGrid
from surfuse.records.kernel_columns import PointColumns, ScanColumns

SUMMARY = "one reading a stop, as from an array of one sensor: what fusion is measured against"


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Validation (gate_footprints, gate_allowance_m in m), and which sensor.

    sensor : number of the sensor, counted from 0 in the order of the log's description.
    """

    sensor: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_within("single_sensor", "sensor", float(self.sensor), 0.0, 1e9)


@compiled
def turn(sensor: int, chosen: int, sensors: int) -> int:
    """When it is a sensor's turn to stand in: 0 for the chosen one, 1 for the next in the order of the array."""
    return (sensor - chosen) % max(sensors, 1)


def first_in_turn(heard: Survey, chosen: int) -> IntArray:
    """The readings of a survey (rows) that are their sweep's first in turn.

    `chosen` is the sensor's number; rows (K,) increasing.
    """
    sensors = int(heard.sensor.max(initial=0)) + 1
    rank = (heard.sensor - chosen) % sensors
    best = np.full(int(heard.sweep.max(initial=-1)) + 1, sensors)
    np.minimum.at(best, heard.sweep, rank)
    return np.flatnonzero(rank == best[heard.sweep])


@compiled
def _walk(scan: ScanColumns, limits: Limits, chosen: int, out: PointColumns) -> None:
    start, sensor, depths, sigmas, gaps, resets = scan.start, scan.sensor, out.depth_m, out.sigma_m, out.gap, out.reset
    sensors = limits.sigma_m.shape[0]
    gate, dc, dc1, dc2, dc3 = out.gate, out.dc, out.dc1, out.dc2, out.dc3
    stops, room = scan.row.shape[0], block_readings(start)
    value, sigma, inside = np.empty(room), np.empty(room), np.empty(room)
    for block in range(0, stops, BLOCK):
        end, base = min(block + BLOCK, stops), start[block]
        validate(scan, limits, (block, end), gate, value, sigma, inside)
        for j in range(block, end):
            first, last, best = start[j], start[j + 1], sensors
            for i in range(first, last):
                dc[i] = 0.0
                dc1[i] = dc2[i] = dc3[i] = 1.0 if gate[i] == 0 else np.nan
                if gate[i] == 0:
                    best = min(best, turn(sensor[i], chosen, sensors))
            depths[j], sigmas[j], gaps[j], resets[j] = np.nan, np.nan, 0, False
            if best == sensors:
                gaps[j] = gap_reason(gate, first, last)
                continue
            total, own, count = 0.0, 0.0, 0
            for i in range(first, last):
                if gate[i] == 0 and turn(sensor[i], chosen, sensors) == best:
                    dc[i] = 1.0
                    total, own, count = total + value[i - base], max(own, sigma[i - base]), count + 1
            depths[j], sigmas[j] = total / count, own / np.sqrt(count)


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def fresh(sensors: int) -> None:
        return None

    def walk(scan: ScanColumns, limits: Limits, memory: None, out: PointColumns) -> None:
        _walk(scan, limits, parameters.sensor, out)

    def estimate(heard: Survey, grid: MapGrid) -> Estimate:
        used = np.zeros(len(heard), dtype=np.bool_)
        used[first_in_turn(heard, parameters.sensor)] = True
        kept = heard.select(used)
        sites = at_least_scatter(mean_sites(kept.foot_m, kept.sigma_m, kept.spacing_m))
        height, sigma = between(sites, grid, covered(kept, grid))
        return Estimate(height, sigma, used)

    one = SweepwiseFusion("single_sensor", parameters, fresh, walk)
    return mapwise("single_sensor", parameters, estimate, local=one)
