"""The paper's method: an average of the sweep weighted by degrees of confidence (section 3.2, equations 1 and 2)."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surfuse.confidence.agreement import agreement_confidences, deviations
from surfuse.confidence.boundary import boundary_confidences
from surfuse.confidence.gate import GateParameters, Limits, gap_reason, validate
from surfuse.confidence.parameters import check_within
from surfuse.confidence.prediction import WINDOW, predicted_depth, prediction_confidence, remember
from surfuse.fusing.sweepwise import BLOCK, SweepwiseFusion, block_readings, pieces_at_lines
from surfuse.fusing.uncertainty import sigma_of_average
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray, Gap, IntArray
from surfuse.records.kernel_columns import PointColumns, ScanColumns

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
    """What the method remembers from stop to stop, moved on in place.

    `window_m` (3, 3) holds the last fused points in the world, oldest first, `held` (1,) how many of them there are,
    `row` (1,) the scan line that they lie on. `error_rate` (S,) is the running error rate of each sensor, in [0, 1].
    """

    window_m: FloatArray
    held: IntArray
    row: IntArray
    error_rate: FloatArray


def _fresh(sensors: int) -> Memory:
    window = np.zeros((WINDOW, 3))
    return Memory(window, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64), np.zeros(sensors))


@compiled
def _stop_by_itself(
    scan: ScanColumns,
    limits: Limits,
    stops: tuple[int, int],
    constants: _Constants,
    scratch: tuple[FloatArray, FloatArray, FloatArray],
    out: PointColumns,
) -> None:
    """Validate a range of stops; what depends on no other stop: dc3, and the deviations that dc2 is made of."""
    value, sigma, inside = scratch
    gate, dc, dc1, dc2, dc3 = out.gate, out.dc, out.dc1, out.dc2, out.dc3
    validate(scan, limits, stops, gate, value, sigma, inside)
    for i in range(scan.start[stops[0]], scan.start[stops[1]]):
        dc[i] = 0.0
        dc1[i] = dc2[i] = dc3[i] = 1.0 if gate[i] == 0 else np.nan
    if constants.use_dc2:
        deviations(scan, stops, gate, value, dc2)
    if constants.use_dc3:
        share, floor = constants.boundary_share, constants.boundary_floor_m
        boundary_confidences(scan, limits, stops, gate, inside, share, floor, dc3)


@compiled
def _sensors_history(
    scan: ScanColumns, stops: tuple[int, int], constants: _Constants, error_rate: FloatArray, out: PointColumns
) -> None:
    """dc2 of a range of stops: each sensor's error rate rests on all of its readings before."""
    if constants.use_dc2:
        allowed, memory = constants.allowed_m, constants.error_memory
        agreement_confidences(scan, stops, out.gate, allowed, memory, error_rate, out.dc2)


@compiled
def _average_line(
    scan: ScanColumns,
    stops: tuple[int, int],
    constants: _Constants,
    memory: Memory,
    value_m: FloatArray,
    out: PointColumns,
) -> None:
    """dc1, dc and M(n) of a range of stops, one after the other: each prediction rests on the values before it."""
    start, grips, rows, window = scan.start, scan.world_from_grip, scan.row, memory.window_m
    gate, dc, dc1, dc2, dc3, depths, resets = out.gate, out.dc, out.dc1, out.dc2, out.dc3, out.depth_m, out.reset
    use, scale, change = constants.use_dc1, constants.prediction_scale_m, constants.change_m
    held, base = memory.held[0], start[stops[0]]
    for j in range(stops[0], stops[1]):
        if rows[j] != (rows[j - 1] if j > stops[0] else memory.row[0]):
            held = 0
        predicted = predicted_depth(window, held, grips, j) if use else np.nan
        total, count = 0.0, 0
        for i in range(start[j], start[j + 1]):
            if gate[i] == 0:
                total += value_m[i - base]
                count += 1
        resets[j] = count > 0 and abs(total / count - predicted) > change
        if resets[j]:
            held, predicted = 0, np.nan
        weights, moment = 0.0, 0.0
        for i in range(start[j], start[j + 1]):
            if gate[i] == 0:
                if predicted == predicted:
                    dc1[i] = prediction_confidence(value_m[i - base] - predicted, scale)
                dc[i] = dc1[i] * dc2[i] * dc3[i]  # equation 2
                weights += dc[i]
                moment += dc[i] * value_m[i - base]
        depths[j] = moment / weights if weights > 0.0 else np.nan  # equation 1
        if weights > 0.0:
            held = remember(window, held, grips, j, depths[j])
    memory.held[0], memory.row[0] = held, rows[stops[1] - 1]


@compiled
def _spreads_and_gaps(
    scan: ScanColumns, stops: tuple[int, int], value_m: FloatArray, sigma_m: FloatArray, out: PointColumns
) -> None:
    """Standard deviation of each M of a range of stops, or why there is none."""
    start, depths, sigmas, gaps, gate, dc = scan.start, out.depth_m, out.sigma_m, out.gap, out.gate, out.dc
    base = start[stops[0]]
    for j in range(stops[0], stops[1]):
        sigmas[j], gaps[j] = np.nan, 0
        if depths[j] == depths[j]:
            sigmas[j] = sigma_of_average(dc, value_m, sigma_m, base, start[j], start[j + 1], depths[j])
            continue
        gaps[j] = gap_reason(gate, start[j], start[j + 1])
        for i in range(start[j], start[j + 1]):
            if gate[i] == 0:
                gaps[j] = NO_CONFIDENCE


@compiled
def _walk(scan: ScanColumns, limits: Limits, constants: _Constants, memory: Memory, out: PointColumns) -> None:
    """Fuse block after block of stops."""
    n_stops, room = scan.row.shape[0], block_readings(scan.start)
    value, sigma, inside = np.empty(room), np.empty(room), np.empty(room)
    for block in range(0, n_stops, BLOCK):
        stops = (block, min(block + BLOCK, n_stops))
        _stop_by_itself(scan, limits, stops, constants, (value, sigma, inside), out)
        _sensors_history(scan, stops, constants, memory.error_rate, out)
        _average_line(scan, stops, constants, memory, value, out)
        _spreads_and_gaps(scan, stops, value, sigma, out)


@compiled
def _prepare(
    scan: ScanColumns,
    limits: Limits,
    stops: tuple[int, int],
    constants: _Constants,
    scratch: tuple[FloatArray, FloatArray],
    out: PointColumns,
) -> None:
    """What depends on no other stop, block after block of a piece; values and sigmas are kept for `_conclude`."""
    value, sigma = scratch
    inside, base = np.empty(block_readings(scan.start)), scan.start[stops[0]]
    for block in range(stops[0], stops[1], BLOCK):
        own = (block, min(block + BLOCK, stops[1]))
        first = scan.start[own[0]] - base
        _stop_by_itself(scan, limits, own, constants, (value[first:], sigma[first:], inside), out)


@compiled
def _conclude(
    scan: ScanColumns,
    stops: tuple[int, int],
    constants: _Constants,
    memory: Memory,
    scratch: tuple[FloatArray, FloatArray],
    out: PointColumns,
) -> None:
    """dc1, M and sigma of a piece that begins with a scan line of its own."""
    _average_line(scan, stops, constants, memory, scratch[0], out)
    _spreads_and_gaps(scan, stops, scratch[0], scratch[1], out)


def _walk_in_pieces(
    scan: ScanColumns,
    limits: Limits,
    constants: _Constants,
    memory: Memory,
    out: PointColumns,
    pieces: list[tuple[int, int]],
) -> None:
    """The same numbers with a thread a piece: only the sensors' error rates go through the whole scan in order.

    Each piece but the first begins with a scan line, where the window is empty anyway.
    """
    scratch = [
        (np.empty(int(scan.start[b] - scan.start[a])), np.empty(int(scan.start[b] - scan.start[a]))) for a, b in pieces
    ]
    memories = [memory, *(_fresh(len(memory.error_rate)) for _ in pieces[1:])]
    for later, (first, _) in zip(memories[1:], pieces[1:], strict=True):
        later.row[0] = scan.row[first]
    with ThreadPoolExecutor(len(pieces)) as pool:
        jobs = [pool.submit(_prepare, scan, limits, p, constants, s, out) for p, s in zip(pieces, scratch, strict=True)]
        for piece, job in zip(pieces, jobs, strict=True):
            job.result()
            _sensors_history(scan, piece, constants, memory.error_rate, out)
        ends = [
            pool.submit(_conclude, scan, p, constants, m, s, out)
            for p, m, s in zip(pieces, memories, scratch, strict=True)
        ]
        for end in ends:
            end.result()
    memory.window_m[:], memory.held[:], memory.row[:] = memories[-1].window_m, memories[-1].held, memories[-1].row


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""
    constants = _Constants(*(getattr(parameters, name) for name in _Constants._fields))

    def walk(scan: ScanColumns, limits: Limits, memory: Memory, out: PointColumns) -> None:
        pieces = pieces_at_lines(scan.row, os.cpu_count() or 1)
        if len(pieces) > 1:
            _walk_in_pieces(scan, limits, constants, memory, out, pieces)
        else:
            _walk(scan, limits, constants, memory, out)

    return SweepwiseFusion("weighted_average", parameters, _fresh, walk)
