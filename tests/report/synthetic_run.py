"""A made-up scan of a plate with a 9 cm relief: what a report of a whole run holds, without running anything."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surfuse.geometry.poses import pose
from surfuse.records import (
    DenseScore,
    FloatArray,
    FusedPoints,
    Gap,
    Gate,
    MapGrid,
    Readings,
    Regime,
    Score,
    SensorSpec,
    SkippedStop,
    SurfaceMap,
)
from surfuse.report.content import (
    ComparisonContent,
    FoundPartView,
    KeyFigure,
    NamedMap,
    PlanView,
    ReportContent,
    ReportEvent,
    SceneComparison,
    Scenery,
    ScoreRow,
)

WORLD_FROM_PART = pose(np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), [1.1, 0.0, 1.0])
CONFIG = (
    '[cell]\nscene = "relief"\n\n[array]\nspacing_m = 0.05\nstep_m = 0.01\n\n[fusion]\nmethod = "weighted_average"\n'
)


def true_height(u: FloatArray, v: FloatArray) -> FloatArray:
    """Plate at w = 0 with a block 9 cm thick on its lower half; nan beside the plate."""
    inside = (np.abs(u) <= 0.1 + 1e-9) & (v >= -1e-9) & (v <= 0.2 + 1e-9)
    return np.where(inside, np.where(v <= 0.1 + 1e-9, 0.09, 0.0), np.nan)


def surface(step_m: float, blur_m: float, noise_m: float, method: str, rng: np.random.Generator) -> SurfaceMap:
    """The plate as a method would see it: step rounded over `blur_m`, with noise; no value in one corner."""
    u_m = np.arange(-0.1, 0.1 + step_m / 2, step_m)
    v_m = np.arange(0.0, 0.2 + step_m / 2, step_m)
    u, v = np.meshgrid(u_m, v_m)
    height = true_height(u, v)
    if blur_m > 0.0:
        height = 0.09 / (1.0 + np.exp((v - 0.1 - 0.4 * blur_m) / (0.25 * blur_m)))
    height = height + noise_m * rng.standard_normal(height.shape)
    mask = ~((u > 0.075) & (v > 0.175))
    edge = np.abs(v - 0.1) < blur_m
    return SurfaceMap(
        grid=MapGrid(u_m, v_m, WORLD_FROM_PART),
        height_m=np.where(mask, height, np.nan),
        sigma_m=np.where(mask, noise_m + 1e-4 + np.where(edge, 0.006, 0.0), np.nan),
        confidence=np.where(mask, np.where(edge, 0.4, 0.95), 0.0),
        count=np.where(mask, 4, 0),
        mask=mask,
        regime=np.where(mask, np.where(edge, Regime.EDGE, Regime.MEASURED), Regime.EMPTY),
        method=method,
    )


def rival(rng: np.random.Generator) -> SurfaceMap:
    """The plate as a method sees it that knows of second surfaces, with a strip that no reading holds."""
    plain = surface(0.01, 0.012, 1e-4, "sharp", rng)
    v = plain.grid.v_m[:, None] + 0.0 * plain.grid.u_m
    beside = plain.mask & (np.abs(v - 0.1) < 0.006)
    strip = plain.mask & (v > 0.105) & (v < 0.125)
    return replace(
        plain,
        regime=np.where(strip, np.uint8(Regime.PRIOR), plain.regime),
        alternative_height_m=np.where(beside, 0.09 - plain.height_m, np.nan),
        alternative_weight=np.where(beside, 0.3, 0.0),
    )


def scan(rng: np.random.Generator, step_m: float = 0.01) -> tuple[Readings, FusedPoints]:
    """A raster of stops, 23 x 22, four sensors each, with readings kept out beside the plate."""
    us, vs = np.arange(-0.11, 0.1101, step_m), np.arange(-0.005, 0.2101, step_m)
    stops = [(u, v, row) for row, v in enumerate(vs) for u in (us if row % 2 == 0 else us[::-1])]
    u, v = np.array([s[0] for s in stops]), np.array([s[1] for s in stops])
    row = np.array([s[2] for s in stops])
    m, offsets = len(stops), 0.025 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    part = np.concatenate([np.stack([u, v], 1)[:, None] + offsets, np.full((m, 4, 1), 0.43)], axis=2).reshape(-1, 3)
    near = np.fmax(true_height(part[:, 0], part[:, 1]), true_height(part[:, 0], part[:, 1] - 0.03))
    range_m = np.where(np.isnan(near), np.inf, 0.43 - near + 3e-4 * rng.standard_normal(4 * m))
    range_m[rng.random(4 * m) < 0.01] = np.nan
    range_m[4 * 300 : 4 * 306] = np.inf
    gate = np.select([np.isinf(range_m), np.isnan(range_m)], [Gate.NO_ECHO, Gate.FAULT], Gate.PASSED)
    grip = np.array(
        [WORLD_FROM_PART @ pose(np.diag([1.0, -1.0, -1.0]), [a, b, 0.43]) for a, b in zip(u, v, strict=True)]
    )
    good = gate == Gate.PASSED
    dc1, dc2 = np.where(good, 1.0 - 0.6 * rng.random(4 * m) ** 4, 0.0), np.where(good, 0.95, 0.0)
    dc3 = np.where(good, 1.0 / (1.0 + np.exp(-(0.1 - np.abs(part[:, 0])) / 0.008)), 0.0)
    dc = dc1 * dc2 * dc3
    weight, value = dc.reshape(m, 4), np.where(good, range_m, 0.0).reshape(m, 4)
    total = weight.sum(axis=1)
    depth = np.where(total > 0.0, (weight * value).sum(axis=1) / np.where(total > 0.0, total, 1.0), np.nan)
    start = 4 * np.arange(m + 1)
    readings = Readings(
        specs=tuple(SensorSpec(f"us{i}", "ultrasonic", 0.2, 4.0, 0.2, 3e-4) for i in range(4)),
        t_s=np.arange(4 * m) * 0.25,
        sensor=np.tile(np.arange(4), m),
        position_m=part @ WORLD_FROM_PART[:3, :3].T + WORLD_FROM_PART[:3, 3],
        axis=np.tile(-WORLD_FROM_PART[:3, 2], (4 * m, 1)),
        range_m=range_m,
        status=np.select([np.isinf(range_m), np.isnan(range_m)], [1, 3], 0),
        amplitude=np.ones(4 * m),
        sigma_m=np.full(4 * m, 3e-4),
        count=np.full(4 * m, 5),
        start=start,
        stop=np.arange(m),
        row=row,
        world_from_grip=grip,
    )
    points = FusedPoints(
        stop=np.arange(m),
        row=row,
        depth_m=depth,
        sigma_m=np.where(np.isfinite(depth), 2e-4, np.nan),
        point_m=np.column_stack(
            [np.where(np.isfinite(depth), u, np.nan), np.where(np.isfinite(depth), v, np.nan), 0.43 - depth]
        ),
        gap=np.where(np.isfinite(depth), Gap.NONE, Gap.NO_VALID_READING),
        reset=np.diff(np.concatenate([[0.3], np.nan_to_num(depth, nan=0.43)])) > 0.05,
        start=start,
        sensor=readings.sensor,
        dc=dc,
        dc1=dc1,
        dc2=dc2,
        dc3=dc3,
        gate=gate,
    )
    return readings, points


def skeleton(readings: Readings) -> FloatArray:
    """Joint positions (M, 5, 3) of a made-up arm that stands at the origin and reaches every stop."""
    wrist = readings.world_from_grip[:, :3, 3]
    m = len(wrist)
    base, shoulder = np.zeros((m, 3)), np.tile([0.0, 0.0, 0.67], (m, 1))
    out = wrist - shoulder
    reach = np.linalg.norm(out, axis=1, keepdims=True)
    bend = np.sqrt(np.maximum(0.43**2 - (0.5 * reach) ** 2, 0.0)) * np.array([0.0, 0.0, 1.0])
    elbow = shoulder + 0.5 * out + bend
    return np.stack([base, shoulder, elbow, wrist - [0.08, 0.0, 0.0], wrist], axis=1)


def found_part(rng: np.random.Generator) -> FoundPartView:
    """A camera image, 500 x 582 non-square pixels, of a bright plate in front of a dark cell."""
    y, x = np.mgrid[0:582, 0:500]
    plate = (x > 150) & (x < 340) & (y > 130) & (y < 440)
    image = (
        60.0
        + 30.0 * (y / 582.0)
        + np.where(plate, 95.0 - 25.0 * (y > 290), 0.0)
        + 5.0 * rng.standard_normal((582, 500))
    )
    pixels = np.clip(image, 0, 255).astype(np.uint8)
    corners = np.array([[150, 130], [340, 130], [340, 440], [150, 440]], dtype=float)
    contour = np.concatenate(
        [np.linspace(a, b, 80, endpoint=False) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )
    histogram = np.bincount(pixels.ravel(), minlength=256)
    return FoundPartView("the part", pixels, contour, corners, pixel_aspect=1.552, threshold=112, histogram=histogram)


def plan(readings: Readings) -> PlanView:
    """The plan that the scan followed, with a few stops left out."""
    outline = np.array([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]])
    enlarged = np.array([[-0.115, -0.01], [0.115, -0.01], [0.115, 0.215], [-0.115, 0.215]])
    stops = np.column_stack([-readings.world_from_grip[:, 1, 3], readings.world_from_grip[:, 2, 3] - 1.0])
    skipped = tuple(SkippedStop(0.01 * k, 0.215, "out of reach: wrist beyond 0.86 m") for k in range(-5, 3))
    return PlanView(outline, stops, enlarged, skipped, step_m=0.01, margin_m=0.015)


def ring_table() -> Scenery:
    """A ring 0.95 to 1.25 m, 1 m high, in 72 steps."""
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inner, outer = (np.column_stack([r * ring, np.full(73, 1.0)]) for r in (0.95, 1.25))
    k = np.arange(72)
    faces = np.concatenate([np.stack([k, k + 73, k + 74], 1), np.stack([k, k + 74, k + 1], 1)])
    return Scenery("ring table", np.concatenate([inner, outer]), faces)


def dense(rmse_m: float, edge_m: float) -> DenseScore:
    """A score of a map with that error and that place of the edge, both in m."""
    return DenseScore(rmse_m, 0.6 * rmse_m, edge_m, 0.9, 0.982, 40000)


def report_content(seed: int = 1) -> ReportContent:
    """A whole run with everything that a report can show."""
    rng = np.random.default_rng(seed)
    readings, points = scan(rng)
    maps = (
        NamedMap("fused (weighted_average)", surface(0.01, 0.05, 3e-4, "weighted_average", rng)),
        NamedMap("spline", surface(0.004, 0.06, 0.0, "spline", rng)),
        NamedMap("beam", surface(0.005, 0.012, 1e-4, "beam", rng)),
    )
    return ReportContent(
        title="Plate with a 9 cm relief",
        scene="relief",
        method="weighted_average",
        made="22 November 2026, 18:20 UTC",
        version="0.1.0",
        summary="Simulated cell, PUMA 560, four 63 kHz sensors with tubes on a square of 5 cm, seed 1.",
        figures=(
            KeyFigure("RMSE", "12.41 mm", "over 441 cells against truth"),
            KeyFigure("95 % of errors below", "38.2 mm"),
            KeyFigure("Coverage", "98.2 %", "of the part's cells have a value"),
            KeyFigure("Stops", "506", "6 without a value"),
            KeyFigure("Robot time", "11 min 46 s"),
            KeyFigure("Wall time", "6.9 s"),
        ),
        parts=(found_part(rng),),
        plan=plan(readings),
        maps=maps,
        truth=NamedMap("truth", surface(0.005, 0.0, 0.0, "truth", rng)),
        points=points,
        readings=readings,
        arm_m=skeleton(readings),
        scenery=(ring_table(),),
        scores=tuple(
            ScoreRow(named.label, Score(rmse, 0.6 * rmse, bias, 2.2 * rmse, 0.982, 441), dense(1.1 * rmse, edge))
            for named, rmse, bias, edge in zip(
                maps, (0.01241, 0.01304, 0.0031), (0.0021, 0.0024, -0.0001), (0.0312, 0.0335, 0.0042), strict=True
            )
        ),
        events=(
            ReportEvent("search: part found at 0.0 degrees after 1 image", t_s=2.1),
            ReportEvent("sensor us2: 9 faulty readings", "warning", 301.4),
            ReportEvent("scan complete", t_s=706.2),
        ),
        configuration_toml=CONFIG,
        rival=NamedMap("sharp", rival(rng)),
    )


def comparison_content(seed: int = 2) -> ComparisonContent:
    """Three scenes, five methods each."""
    rng = np.random.default_rng(seed)
    blurs = (
        ("weighted_average", 0.05, 3e-4),
        ("mean", 0.07, 8e-4),
        ("median", 0.055, 5e-4),
        ("spline", 0.06, 1e-5),
        ("beam", 0.012, 1e-4),
    )
    scenes = []
    for name, expected in (
        ("Flat plate at 0°", "Shape and description well recovered."),
        ("Flat plate at 20°", "Still recovered; 25° is the limit of these sensors."),
        ("Relief of 9 cm", "The fusion minimises the slope: the step comes out rounded."),
    ):
        maps = tuple(NamedMap(label, surface(0.01, blur, noise, label, rng)) for label, blur, noise in blurs)
        scores = tuple(
            ScoreRow(m.label, Score(0.2 * b, 0.1 * b, 0.01 * b, 0.4 * b, 0.98, 441), dense(0.22 * b, b / 2))
            for m, (_, b, _) in zip(maps, blurs, strict=True)
        )
        scenes.append(
            SceneComparison(
                name=name,
                maps=maps,
                truth=NamedMap("truth", surface(0.01, 0.0, 0.0, "truth", rng)),
                scores=scores,
                cut_along="v",
                cut_at_m=0.0,
                expected=expected,
                found="weighted_average: RMSE 10.0 mm, edge 25 mm out; beam: 2.4 mm, edge 6 mm out.",
            )
        )
    return ComparisonContent(
        title="The experiments of the 1998 paper, reproduced",
        scenes=tuple(scenes),
        introduction="Three scenes, one scan each, all methods on the same readings.",
        made="22 November 2026",
        version="0.1.0",
        figures=(KeyFigure("Scenes", "3"), KeyFigure("Methods", "5"), KeyFigure("Readings a scene", "2024")),
        configuration_toml=CONFIG,
    )
