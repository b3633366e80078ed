"""How far outlines must be enlarged, and how far the margin that follows from their uncertainty enlarges them.

Run: python benchmarks/bench_margin.py [--scenes 200] [--seed 1] [--rows FILE.csv] [--plot FILE.svg]. Every scene has
one random part (block, cylinder, wedge, L-shaped plate, pyramid stump) of random size, place, turn and lean on the
table of the reference cell. The camera centres it, the ranger of the twin measures its distance, vision outlines it.
The needed margin is the largest distance by which the true outline (the part seen along w) leaves the outline found.
"""

from __future__ import annotations

import argparse
import csv
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from surfuse.commands.acquire.locating import finder
from surfuse.errors import SurfuseError
from surfuse.geometry.mesh_files import TriangleSoup
from surfuse.geometry.polygons import signed_distance
from surfuse.geometry.poses import inverse, transform_points
from surfuse.plan.front_view import front_view
from surfuse.plan.margin import margin_for, scan_area
from surfuse.records import CameraFrame, FloatArray, Outline
from surfuse.report.line_charts import Chart, Series, picture
from surfuse.rig.description import camera_model, camera_mount, ranger_mount, shoulder_spec
from surfuse.rig.mounts import world_from_shoulder
from surfuse.settings import from_tree
from surfuse.twin.materials import Material
from surfuse.twin.scene import Scene, SceneBody, table_bodies
from surfuse.twin.shapes import box, cylinder, extrusion, standing
from surfuse.twin.world import Twin
from surfuse.vision.distance import ShoulderRange
from surfuse.vision.dominant_points import DominantPointParameters
from surfuse.vision.outline import outline_part

SETTINGS = from_tree({})
CAMERA, FIND = camera_model(SETTINGS), finder(SETTINGS)


@dataclass(frozen=True)
class Row:
    """One scene: what was needed and what was stated, in metres."""

    seed: int
    shape: str
    width: float
    depth: float
    height: float
    yaw: float
    lean: float
    ranged: bool
    needed_as_seen: float
    needed: float
    margin: float
    planned: float
    sigma_max: float
    sigma_mean: float


def solid(shape: str, width: float, depth: float, height: float) -> TriangleSoup:
    half = 0.5 * width
    if shape == "cylinder":
        return cylinder(half, height)
    if shape == "wedge":
        return extrusion(np.array([[-half, 0.0], [half, 0.0], [half, 0.4 * height], [-half, height]]), depth)
    if shape == "L":
        corners = [[-half, 0], [half, 0], [half, 0.45 * height], [0, 0.45 * height], [0, height], [-half, height]]
        return extrusion(np.array(corners), depth)
    block = box(width, depth, height)
    if shape == "stump":
        # The top is smaller than the foot, in width and in depth.
        middle = np.array([0.5 * depth, 0.0])
        high = block.vertices_m[:, 2] > 0.5 * height
        block.vertices_m[high, :2] = middle + 0.5 * (block.vertices_m[high, :2] - middle)
    return block


def scene_of(seed: int) -> tuple[SceneBody, Row]:
    """The first of the random parts of this seed whose foot is all on the table."""
    g = np.random.default_rng([7, seed])
    while True:
        part, row = _random_part(g, seed)
        foot = part.world_vertices()
        radius = np.hypot(*foot[foot[:, 2] < 1.002, :2].T)
        if radius.min() >= 0.95 and radius.max() <= 1.25:
            return part, row


def _random_part(g: np.random.Generator, seed: int) -> tuple[SceneBody, Row]:
    shape = ("block", "cylinder", "wedge", "L", "stump")[int(g.integers(5))]
    width, height = g.uniform(0.04, 0.25, 2)
    depth = g.uniform(0.005, 0.10)
    if shape == "cylinder":
        width = min(width, 0.16)
        depth = width
    yaw = g.uniform(-0.6, 0.6)
    lean = g.uniform(-0.05, 0.25) if shape in ("block", "L", "wedge") and depth < 0.05 else 0.0
    radius = g.uniform(0.98, 1.12)
    part = standing(solid(shape, width, depth, height), Material.PART, g.uniform(-2.5, 2.5), radius, 1.0, yaw, lean)
    return part, Row(seed, shape, width, depth, height, yaw, lean, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def outlined(part: SceneBody, seed: int) -> tuple[Outline, bool] | None:
    """The outline of the part once it is centred; None when it is not found or off the table."""
    twin = Twin(Scene((*table_bodies(), part)), seed=seed)
    middle = part.world_vertices().mean(axis=0)
    angle = math.atan2(middle[1], middle[0])
    for step in range(3):
        place = world_from_shoulder(angle)
        twin.begin("search", step)
        camera_pose = place @ camera_mount(SETTINGS).shoulder_from_device
        frame = CameraFrame(twin.image(CAMERA, camera_pose), 0.0, CAMERA, camera_pose)
        found = FIND(frame)
        if not found:
            return None
        offset = float(found[0].centroid_px[0]) - CAMERA.cx_px
        if abs(offset) <= 2.0:
            break
        angle -= math.atan2(offset, CAMERA.fx_px)
    spec = shoulder_spec(SETTINGS)
    ranger = place @ ranger_mount(SETTINGS).shoulder_from_device
    heard, _ = twin.ping(ranger, spec, SETTINGS.array.pings, 0.0)
    usable = heard[np.isfinite(heard)]
    ranged = ShoulderRange(ranger[:3, 3], ranger[:3, 2], float(usable.mean()), spec.sigma_m) if len(usable) else None
    tolerance = DominantPointParameters(tolerance_px=SETTINGS.search.tolerance_px)
    return outline_part(frame, found[0], 1.0, ranged, tolerance).outline, ranged is not None


def needed_margin(outline: Outline, vertices: FloatArray, part: SceneBody) -> float:
    """Largest distance of the part's points outside a polygon, all seen along w of the outline's frame."""
    corner = transform_points(inverse(outline.world_from_part), part.world_vertices())[part.triangles][..., :2]
    share = np.linspace(0.0, 1.0, 20)[:, None, None, None]
    edges = corner * (1.0 - share) + np.roll(corner, -1, axis=1) * share
    return max(0.0, float(-signed_distance(edges.reshape(-1, 2), vertices).min()))


def measured(seed: int) -> Row | None:
    part, row = scene_of(seed)
    try:
        result = outlined(part, seed)
    except SurfuseError as error:
        print(f"scene {seed}: {error}")
        return None
    if result is None:
        return None
    outline, ranged = result
    fields = asdict(row) | {
        "ranged": ranged,
        "needed_as_seen": needed_margin(outline, outline.vertices_m, part),
        "needed": needed_margin(outline, front_view(outline).vertices_m, part),
        "margin": margin_for(outline),
        "planned": scan_area(outline, SETTINGS.step_m).margin_m,
        "sigma_max": float(outline.sigma_m.max()),
        "sigma_mean": float(outline.sigma_m.mean()),
    }
    return Row(**fields)


def percentiles(values: FloatArray) -> str:
    shares = (1, 50, 90, 95, 99, 100)
    return ", ".join(f"{share} %: {1e3 * np.percentile(values, share):.1f}" for share in shares)


def plot(rows: list[Row]) -> str:
    """Cumulative distributions, as SVG: what was needed, what was given, and the difference."""

    def shares(name: str, values: list[float]) -> Series:
        ordered = sorted(1e3 * value for value in values)
        return Series(name, tuple((value, 100.0 * (k + 1) / len(ordered)) for k, value in enumerate(ordered)))

    needs = (
        shares("needed, as the camera saw it", [row.needed_as_seen for row in rows]),
        shares("needed, along w", [row.needed for row in rows]),
        shares("given", [row.margin for row in rows]),
    )
    spare = (shares("given minus needed", [row.margin - row.needed for row in rows]),)
    charts = [
        Chart("How far the outline must grow, and grows", "margin (mm)", "share of scenes (%)", needs, (0.0, 100.0)),
        Chart("Beyond the need", "margin beyond the need (mm)", "share of scenes (%)", spare, (0.0, 100.0)),
    ]
    return picture(charts, f"Margin over {len(rows)} random scenes")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="CSV file for every scene")
    parser.add_argument("--plot", type=Path, help="SVG file of the distributions")
    chosen = parser.parse_args()
    rows = [measured(1000 * chosen.seed + number) for number in range(chosen.scenes)]
    seen = [row for row in rows if row is not None]
    if chosen.rows:
        with chosen.rows.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(asdict(seen[0])))
            writer.writeheader()
            writer.writerows(asdict(row) for row in seen)
    if chosen.plot:
        chosen.plot.write_text(plot(seen))
    needed, margin = np.array([r.needed for r in seen]), np.array([r.margin for r in seen])
    print(f"scenes {len(rows)}, not outlined {len(rows) - len(seen)}, without range {sum(not r.ranged for r in seen)}")
    print(
        f"needed around the outline as the camera saw it, mm: {percentiles(np.array([r.needed_as_seen for r in seen]))}"
    )
    print(f"needed around the outline as seen along w, mm: {percentiles(needed)}")
    print(f"margin, mm: {percentiles(margin)}")
    print(f"margin beyond the need, mm: {percentiles(margin - needed)}")
    print(f"true outline inside the enlarged one: {100.0 * np.mean(needed <= margin):.1f} %")
    planned = np.array([r.planned for r in seen])
    print(f"margin of the plan at a step of {1e3 * SETTINGS.step_m:g} mm, with its run-in, mm: {percentiles(planned)}")
    print(f"true outline inside the plan's outline: {100.0 * np.mean(needed <= planned):.1f} %")
    flat = float(np.quantile(needed, 0.99))
    print(f"one margin that holds 99 %: {1e3 * flat:.1f} mm; mean of the margins {1e3 * margin.mean():.1f} mm")


if __name__ == "__main__":
    main()
