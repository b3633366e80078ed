"""The paper's method: an average of the sweep weighted by degrees of confidence (section 3.2, equations 1 and 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surfuse.confidence.agreement import agreement_confidence, median_of_others, sort_into, updated_error_rate
from surfuse.confidence.boundary import boundary_confidence, boundary_scale
from surfuse.confidence.columns import PointColumns, ScanColumns
from surfuse.confidence.gate import GateParameters, Limits
from surfuse.confidence.parameters import check_within
from surfuse.confidence.prediction import WINDOW, predicted_depth, prediction_confidence, remember
from surfuse.confidence.sweepwise import SweepwiseFusion, begin_stop, widest, write_factors, write_gap, write_value
from surfuse.confidence.uncertainty import sigma_of_average
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray, Gap, IntArray

SUMMARY = "the paper's average weighted by degrees of confidence: prediction, agreement, boundary"
NO_CONFIDENCE = int(Gap.NO_CONFIDENCE)


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Constants of the three factors; the paper gives none, the defaults follow from its rig. Lengths in m.

    use_dc1, use_dc2, use_dc3 : switch a factor off (it is then 1 for every reading), for ablation.
    prediction_scale_m : deviation from the predicted value at which dc1 has fallen to 0.61. Default 12 mm: what a
        sensor 25 mm off the grip axis reads differently on a plate at the largest usable incidence, 25 degrees.
    change_m : when the plain average of a sweep differs more than this from the prediction, the surface has changed.
        Default 30 mm: well above a straight line's error on smooth parts, and under the 45 mm by which the average
        jumps when two of four sensors pass a 9 cm step.
    allowed_m : deviation from the others of the sweep beyond which a reading counts as an error. Default 25 mm: what
        two sensors 5 cm apart differ on a plate at 25 degrees (23 mm), so that a usable tilt is no error.
    error_memory : number of readings over which the running error rate of a sensor forgets. Default 20: about one
        scan line of the 20 cm part. No unit.
    boundary_share : scale of the boundary sigmoid as a share of the beam's footprint radius. Default 1/4: dc3 goes
        from 2 % to 98 % while the footprint crosses the outline. No unit.
    boundary_floor_m : smallest scale of the sigmoid, for narrow beams. Default 2 mm: the error of a camera outline,
        1 % of a 20 cm part.
    gate_footprints, gate_allowance_m : validation, see `GateParameters`.
    """

    use_dc1: bool = True
    use_dc2: bool = True
    use_dc3: bool = True
    prediction_scale_m: float = 0.012
    change_m: float = 0.030
    allowed_m: float = 0.025
    error_memory: float = 20.0
    boundary_share: float = 0.25
    boundary_floor_m: float = 0.002

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("prediction_scale_m", "change_m", "allowed_m", "boundary_floor_m"):
            check_within("weighted_average", name, getattr(self, name), 0.0, float("inf"), above=True)
        check_within("weighted_average", "error_memory", self.error_memory, 1.0, float("inf"))
        check_within("weighted_average", "boundary_share", self.boundary_share, 0.0, float("inf"))


class _Constants(NamedTuple):
    """`Parameters` as the kernel takes them."""

    use_dc1: bool
    use_dc2: bool
    use_dc3: bool
    prediction_scale_m: float
    change_m: float
    allowed_m: float
    error_memory: float
    boundary_share: float
    boundary_floor_m: float


class Memory(NamedTuple):
    """What the method remembers: window (3, 3) of fused points (world, oldest first), how many of them are held
    (1,), their scan line (1,), and the running error rate (S,) of each sensor.
    """

    window_m: FloatArray
    held: IntArray
    row: IntArray
    error_rate: FloatArray


def _fresh(sensors: int) -> Memory:
    window = np.zeros((WINDOW, 3))
    return Memory(window, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64), np.zeros(sensors))


@compiled
def _prediction(
    memory: Memory, row: int, pose: FloatArray, value_m: FloatArray, passed: FloatArray, n: int, constants: _Constants
) -> tuple[float, bool]:
    """Predicted value (nan: none, full confidence) and whether the surface has changed; a new line starts afresh."""
    if memory.row[0] != row:
        memory.row[0] = row
        memory.held[0] = 0
    if not constants.use_dc1:
        return np.nan, False
    predicted = predicted_depth(memory.window_m, memory.held[0], pose)
    total, count = 0.0, 0.0
    for s in range(n):
        if passed[s] != 0.0:
            total += value_m[s]
            count += 1.0
    if abs(total / count - predicted) > constants.change_m:
        memory.held[0] = 0
        return np.nan, True
    return predicted, False


@compiled
def _dc2(value: float, sensor: int, ordered: FloatArray, n: int, memory: Memory, constants: _Constants) -> float:
    """dc2 of a reading, after its sensor's error rate has been moved on."""
    deviation = value - median_of_others(value, ordered, n)
    is_error = abs(deviation) > constants.allowed_m
    rate = updated_error_rate(memory.error_rate[sensor], is_error, constants.error_memory)
    memory.error_rate[sensor] = rate
    return agreement_confidence(deviation, constants.allowed_m, rate)


@compiled
def _walk(scan: ScanColumns, limits: Limits, constants: _Constants, memory: Memory, out: PointColumns) -> None:
    """Fuse stop after stop."""
    width = widest(scan)
    value, sigma, inside = np.empty(width), np.empty(width), np.empty(width)
    weight, passed, ordered = np.empty(width), np.empty(width), np.empty(width)
    for j in range(scan.row.shape[0]):
        first, n = scan.start[j], scan.start[j + 1] - scan.start[j]
        if begin_stop(scan, limits, j, value, sigma, inside, passed, out) == 0:
            continue
        pose = scan.world_from_grip[j]
        predicted, out.reset[j] = _prediction(memory, scan.row[j], pose, value, passed, n, constants)
        n_passed = sort_into(value, passed, n, ordered) if constants.use_dc2 else 0
        weights, moment = 0.0, 0.0
        for s in range(n):
            weight[s] = 0.0
            if passed[s] == 0.0:
                continue
            i = first + s
            sensor, dc1, dc2, dc3 = scan.sensor[i], 1.0, 1.0, 1.0
            if predicted == predicted:
                dc1 = prediction_confidence(value[s] - predicted, constants.prediction_scale_m)
            if constants.use_dc2:
                dc2 = _dc2(value[s], sensor, ordered, n_passed, memory, constants)
            if constants.use_dc3:
                footprint = scan.range_m[i] * limits.spread[sensor]
                scale = boundary_scale(footprint, constants.boundary_share, constants.boundary_floor_m)
                dc3 = boundary_confidence(inside[s], scale)
            weight[s] = write_factors(out, i, dc1, dc2, dc3)
            weights += weight[s]
            moment += weight[s] * value[s]
        if weights == 0.0:
            write_gap(out, j, NO_CONFIDENCE)
            continue
        depth = moment / weights  # equation 1
        write_value(out, j, depth, sigma_of_average(weight, value, sigma, n, depth), pose, limits.part_from_world)
        remember(
            memory.window_m,
            memory.held,
            pose[0, 3] + depth * pose[0, 2],
            pose[1, 3] + depth * pose[1, 2],
            pose[2, 3] + depth * pose[2, 2],
        )


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""
    constants = _Constants(*(getattr(parameters, name) for name in _Constants._fields))

    def walk(scan: ScanColumns, limits: Limits, memory: Memory, out: PointColumns) -> None:
        _walk(scan, limits, constants, memory, out)

    return SweepwiseFusion("weighted_average", parameters, _fresh, walk)
