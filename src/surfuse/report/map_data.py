"""Maps and stops as data of the page: what the heat maps, the cuts and the relief read out."""

from __future__ import annotations

import numpy as np

from surfuse.geometry.poses import inverse, rotate_vectors, transform_points
from surfuse.records import FloatArray, FusedPoints, Gap, Gate, Readings, Regime, SurfaceMap
from surfuse.report.colours import ANCHORS, CATEGORIES, anchors
from surfuse.report.content import NamedMap
from surfuse.report.deviation import deviation
from surfuse.report.packing import pack, pack_share, stride_for, thinned

MM = 1000.0

GATE_LABELS = {
    Gate.PASSED: "took part",
    Gate.NO_ECHO: "no echo",
    Gate.TOO_CLOSE: "too close",
    Gate.FAULT: "faulty reading",
    Gate.OUT_OF_RANGE: "out of the sensor's range",
    Gate.OUTSIDE_PART: "outside of the part",
    Gate.BEHIND_CELL: "behind the cell",
}
GAP_LABELS = {
    Gap.NONE: "has a value",
    Gap.NO_VALID_READING: "no valid reading",
    Gap.NO_CONFIDENCE: "sum of confidences is zero",
    Gap.OUTSIDE_PART: "outside of the part",
}
REGIME_LABELS = {
    Regime.EMPTY: "empty",
    Regime.MEASURED: "measured",
    Regime.MIRROR: "mirror-like echo",
    Regime.SPECKLE: "speckle",
    Regime.EDGE: "beside an edge",
    Regime.PRIOR: "prior only, not measured",
    Regime.RAY: "light or touch",
}
REGIME_MEANINGS = {
    Regime.EMPTY: "No value.",
    Regime.MEASURED: "Readings hold the cell; this method does not say how they were heard.",
    Regime.MIRROR: "Heard as the echo of a smooth facet that faces a sensor: the sharpest evidence.",
    Regime.SPECKLE: "Heard as scattered sound of a tilted patch, which comes late and scatters by millimetres.",
    Regime.EDGE: "Only the wave of a rim touches the cell: it tells where the rim is, less how high the cell lies.",
    Regime.PRIOR: "No reading holds the cell: its surroundings are continued. Hatched, grey or dotted, never measured.",
    Regime.RAY: "Read by light or contact where the axis of the sensor ends: direct, as sharp as its spot or zone.",
}
REGIME_COLOURS = {
    Regime.EMPTY: "eef1f4",
    Regime.MEASURED: "0072b2",
    Regime.MIRROR: "009e73",
    Regime.SPECKLE: "e69f00",
    Regime.EDGE: "cc79a7",
    Regime.PRIOR: "999999",
    Regime.RAY: "56b4e9",
}


def legends() -> dict[str, object]:
    """Words and colours that the scripts need whatever the content."""
    return {
        "gates": [GATE_LABELS[gate] for gate in Gate],
        "gaps": [GAP_LABELS[gap] for gap in Gap],
        "regimes": [REGIME_LABELS[regime] for regime in Regime],
        "colours": {name: anchors(name) for name in ANCHORS},
        "categories": ["#" + code for code in CATEGORIES],
        "paint": {
            "gates": ["#" + code for code in CATEGORIES],
            "regimes": ["#" + REGIME_COLOURS[regime] for regime in Regime],
        },
        "prior": int(Regime.PRIOR),
    }


def _map(named: NamedMap, truth: SurfaceMap | None, most_nodes: int, is_truth: bool) -> dict[str, object]:
    surface = named.surface
    stride = stride_for(surface.height_m.size, most_nodes, 2)
    rows, columns = (thinned(n, stride) for n in surface.grid.shape)
    cells = np.ix_(rows, columns)
    height = np.where(surface.mask, surface.height_m, np.nan)
    layers: dict[str, object] = {"height": pack(MM * height[cells], "f4")}
    if not is_truth:
        layers["sigma"] = pack(MM * np.where(surface.mask, surface.sigma_m, np.nan)[cells], "f4")
        layers["confidence"] = pack_share(np.where(surface.mask, surface.confidence, np.nan)[cells])
        layers["count"] = pack(np.minimum(surface.count, 65535)[cells], "u2")
        layers["regime"] = pack(surface.regime[cells], "u1")
        if surface.alternative_height_m is not None and surface.alternative_weight is not None:
            layers["second"] = pack(MM * surface.alternative_height_m[cells], "f4")
            layers["weight"] = pack_share(np.where(surface.mask, surface.alternative_weight, np.nan)[cells])
        if truth is not None:
            layers["error"] = pack(MM * deviation(surface, truth)[cells], "f4")
    return {
        "label": named.label,
        "truth": is_truth,
        "stride": stride,
        "u": pack(MM * surface.grid.u_m[columns], "f4"),
        "v": pack(MM * surface.grid.v_m[rows], "f4"),
        "nu": len(columns),
        "nv": len(rows),
        "layers": layers,
    }


def _span(values: list[FloatArray], low: float, high: float) -> tuple[float, float] | None:
    """Percentiles of the finite values of several layers together; None without any."""
    finite = [layer[np.isfinite(layer)] for layer in values]
    joined = np.concatenate(finite) if finite else np.zeros(0)
    if not joined.size:
        return None
    bottom, top = np.percentile(joined, [low, high])
    return float(bottom), float(top)


def _spans(maps: tuple[NamedMap, ...], truth: SurfaceMap | None) -> dict[str, list[float]]:
    """Common colour limits in mm, so that all maps of a group compare at a glance; a few outliers do not rule them."""
    surfaces = [named.surface for named in maps]
    heights = [np.where(s.mask, s.height_m, np.nan) for s in surfaces]
    low, high = _span(heights, 0.5, 99.5) or (0.0, 0.0)
    if truth is not None:
        true_low, true_high = _span([np.where(truth.mask, truth.height_m, np.nan)], 0.0, 100.0) or (low, high)
        low, high = min(low, true_low), max(high, true_high)
    middle, half = 0.5 * (low + high), max(0.5 * (high - low), 5e-4)
    sigma = _span([np.where(s.mask, s.sigma_m, np.nan) for s in surfaces], 1.0, 99.0) or (0.0, 0.0)
    most = max(sigma[1], 1e-5)
    spans = {
        "height": [MM * (middle - half), MM * (middle + half)],
        # A logarithmic scale: sigmas of two methods may differ a hundredfold.
        "sigma": [MM * float(np.clip(sigma[0], 1e-3 * most, 0.5 * most)), MM * most],
        "second": [MM * (middle - half), MM * (middle + half)],
        "weight": [0.0, 1.0],
        "confidence": [0.0, 1.0],
        "count": [0.0, float(max([1, *(int(s.count.max(initial=0)) for s in surfaces)]))],
    }
    if truth is not None:
        errors = _span([np.abs(deviation(s, truth)) for s in surfaces], 0.0, 98.0) or (0.0, 0.0)
        limit = MM * max(errors[1], 1e-4)
        spans["error"] = [-limit, limit]
    return spans


def group_data(maps: tuple[NamedMap, ...], truth: NamedMap | None, most_nodes: int) -> dict[str, object]:
    """One group of maps that share colour limits and cursor; `most_nodes` is the budget of each map."""
    true_surface = truth.surface if truth else None
    listed = [_map(named, true_surface, most_nodes, False) for named in maps]
    if truth is not None:
        listed.append(_map(truth, true_surface, most_nodes, True))
    return {"maps": listed, "spans": _spans(maps, true_surface)}


def stop_positions(points: FusedPoints, readings: Readings | None, world_from_part: FloatArray) -> FloatArray:
    """Where the grip axis meets the part (M, 2), u and v: the fused point, or for a gap the axis at w = 0."""
    uv = np.array(points.point_m[:, :2])
    missing = ~np.all(np.isfinite(uv), axis=1)
    if readings is None or not np.any(missing):
        return uv
    part_from_world = inverse(world_from_part)
    origin = transform_points(part_from_world, readings.world_from_grip[missing, :3, 3])
    axis = rotate_vectors(part_from_world, readings.world_from_grip[missing, :3, 2])
    slope = np.where(np.abs(axis[:, 2]) > 1e-6, axis[:, 2], np.nan)
    uv[missing] = origin[:, :2] - axis[:, :2] * (origin[:, 2] / slope)[:, None]
    return uv


def stop_data(
    points: FusedPoints, readings: Readings | None, world_from_part: FloatArray, most_readings: int
) -> dict[str, object]:
    """The stops with their fused value, the confidence factors of every sensor and why it was kept out.

    `world_from_part` (4, 4); of more than `most_readings` readings every so many are told. The result
    is what the page's script reads: lists and numbers, None for what is not finite.
    """
    stride = stride_for(len(points.sensor), most_readings)
    keep = np.arange(0, len(points), stride)
    size = np.diff(points.start)[keep]
    start = np.concatenate([[0], np.cumsum(size)])
    rows = np.repeat(points.start[keep] - start[:-1], size) + np.arange(int(start[-1]))
    uv = stop_positions(points, readings, world_from_part)[keep]
    sensors = int(points.sensor.max(initial=-1)) + 1
    names = [spec.name for spec in readings.specs] if readings else [f"sensor {i}" for i in range(sensors)]
    data: dict[str, object] = {
        "stride": stride,
        "sensors": names,
        "u": pack(MM * uv[:, 0], "f4"),
        "v": pack(MM * uv[:, 1], "f4"),
        "stop": [int(stop) for stop in points.stop[keep]],
        "row": [int(row) for row in points.row[keep]],
        "depth": pack(MM * points.depth_m[keep], "f4"),
        "sigma": pack(MM * points.sigma_m[keep], "f4"),
        "gap": pack(points.gap[keep], "u1"),
        "reset": pack(points.reset[keep], "u1"),
        "start": [int(n) for n in start],
        "sensor": [int(n) for n in points.sensor[rows]],
        "gate": pack(points.gate[rows], "u1"),
    }
    data |= {name: pack_share(getattr(points, name)[rows]) for name in ("dc", "dc1", "dc2", "dc3")}
    if readings is not None and len(readings.range_m) == len(points.sensor):
        data["range"] = pack(MM * readings.range_m[rows], "f4")
    return data
