"""Speed of the vision steps on the twin's pictures, and how often and how well parts are outlined in random scenes.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_vision.py [--scenes 200]. Times are the best of 30 runs, next to the bare
OpenCV chain (blur, Otsu, contours, polygon) on the same picture. Scenes vary size, depth, place and turn of a box from
3 cm, illumination gradient, shadows, noise up to 5 % of the full scale, the room, and clutter off the table.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable

import cv2
import numpy as np

from surfuse.cameras import REFERENCE_MODEL
from surfuse.geometry.poses import inverse, pose, rotation_about, transform_points
from surfuse.records import CameraFrame, Detection, FloatArray
from surfuse.twin.materials import Material
from surfuse.twin.optics import OpticsParameters, render
from surfuse.twin.scene import Scene, SceneBody, table_bodies
from surfuse.vision.dominant_points import DominantPointParameters
from surfuse.vision.outline import outline_part
from surfuse.vision.part_finder import find_parts
from surfuse.vision.rays import pixels_of
from surfuse.vision.table import TableRing
from surfuse.vision.threshold import METHODS, histogram, maximum_entropy, minimum_error, otsu, threshold

TABLE = TableRing()
DOMINANT = DominantPointParameters(tolerance_px=1.5)


def shoulder(azimuth: float) -> FloatArray:
    ahead = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    right = np.array([math.sin(azimuth), -math.cos(azimuth), 0.0])
    return pose(np.column_stack([right, [0.0, 0.0, -1.0], ahead]), 0.1 * ahead + [0.0, 0.0, 1.15])


def box(
    size: tuple[float, float, float], material: Material, azimuth: float, radius: float, yaw: float, foot: float
) -> SceneBody:
    """A box of width, depth and height, its front middle at a radius from the arm's axis."""
    width, depth, height = size
    corner = np.array([[x, y, z] for x in (0, depth) for y in (-width / 2, width / 2) for z in (0, height)])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    triangles = [tri for a, b, c, d in sides for tri in ((a, b, c), (a, c, d))]
    place = [radius * math.cos(azimuth), radius * math.sin(azimuth), foot]
    turn = rotation_about([0.0, 0.0, 1.0], azimuth + yaw)
    return SceneBody(corner, np.array(triangles, dtype=np.int64), material, pose(turn, place))


def best_ms(call: Callable[[], object], repeats: int = 30) -> float:
    call()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def bare_opencv(image: np.ndarray) -> object:
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
    _, mask = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    contours, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    return cv2.approxPolyDP(max(contours, key=len), 1.5, True)


def speed() -> None:
    scene = Scene((*table_bodies(), box((0.2, 0.05, 0.2), Material.PART, 0.0, 1.05, 0.2, 1.0)))
    where = shoulder(0.05)
    generator = np.random.default_rng(0)
    frame = CameraFrame(render(scene, REFERENCE_MODEL, where, generator), 0.0, REFERENCE_MODEL, where)
    empty_pose = shoulder(2.0)
    empty = CameraFrame(render(scene, REFERENCE_MODEL, empty_pose, generator), 0.0, REFERENCE_MODEL, empty_pose)
    counts = histogram(frame.image)

    def whole() -> object:
        (part,) = find_parts(frame, table=TABLE)
        return outline_part(frame, part, TABLE.height_m, dominant=DOMINANT)

    rows: list[tuple[str, Callable[[], object]]] = [
        ("twin: one picture", lambda: render(scene, REFERENCE_MODEL, where, generator)),
        ("frame to outline in metres", whole),
        ("bare OpenCV: blur, Otsu, contours, polygon", lambda: bare_opencv(frame.image)),
        ("picture without a part", lambda: find_parts(empty, table=TABLE)),
        ("four thresholds of one frame", lambda: [threshold(frame.image, method) for method in METHODS]),
        *((f"{method}, from the frame", lambda method=method: threshold(frame.image, method)) for method in METHODS),
        ("otsu, from the histogram", lambda: otsu.from_histogram(counts)),
        ("maximum_entropy, from the histogram", lambda: maximum_entropy.from_histogram(counts)),
        ("minimum_error, from the histogram", lambda: minimum_error.from_histogram(counts)),
    ]
    print("| step | ms |\n|---|---|")
    for name, call in rows:
        print(f"| {name} | {best_ms(call):.2f} |")


def random_scenes(count: int) -> None:
    missed, false, errors, ratios = 0, 0, [], []
    for seed in range(count):
        frame, part, height = _random_scene(seed)
        centre = part.world_vertices().mean(axis=0)[None, :]
        pixel = pixels_of(REFERENCE_MODEL, transform_points(inverse(frame.world_from_camera), centre))[0]
        found = find_parts(frame, table=TABLE)
        right = [seen for seen in found if math.dist(seen.centroid_px, pixel) < 25.0]
        missed += len(right) != 1
        false += len(found) - len(right)
        if len(right) == 1:
            error, sigma = _outline_error(frame, right[0], part, height)
            errors.append(error)
            ratios.append(error / sigma)
    print(f"\nrandom scenes: {count}; parts missed {missed}, false parts {false}")
    middle, high, largest = 1e3 * np.percentile(errors, [50, 95, 100])
    print(f"error of the extent without a ranger, mm: median {middle:.1f}, 95 % {high:.1f}, largest {largest:.1f}")
    print("error by stated sigma: 50 / 95 / 99 %:", np.round(np.percentile(ratios, [50, 95, 99]), 2).tolist())


def _random_scene(seed: int) -> tuple[CameraFrame, SceneBody, float]:
    g = np.random.default_rng(seed)
    azimuth = g.uniform(-np.pi, np.pi)
    size = (g.uniform(0.03, 0.22), g.uniform(0.005, 0.06), g.uniform(0.03, 0.25))
    material = Material.PART if g.random() < 0.7 else Material.PART_SMOOTH
    part = box(size, material, azimuth, g.uniform(1.0, 1.18), g.uniform(-0.4, 0.4), 1.0)
    bodies = [*table_bodies(), part]
    if g.random() < 0.5:
        place = azimuth + g.uniform(-0.25, 0.25)
        bodies.append(box((0.3, 0.05, 0.3), Material.CLUTTER, place, 2.5, 0.0, g.uniform(1.3, 1.6)))
    optics = OpticsParameters(
        gradient_x=g.uniform(-0.8, 0.8),
        gradient_y=g.uniform(-0.8, 0.8),
        shadows=g.random() < 0.5,
        noise_levels=g.uniform(1.0, 13.0),
        background=g.uniform(5.0, 45.0),
    )
    where = shoulder(azimuth + g.uniform(-0.25, 0.25))
    image = render(Scene(bodies), REFERENCE_MODEL, where, g, optics)
    return CameraFrame(image, 0.0, REFERENCE_MODEL, where), part, size[2]


def _outline_error(frame: CameraFrame, seen: Detection, part: SceneBody, height: float) -> tuple[float, float]:
    """Largest error of the four sides of the outline's extent, and the largest stated deviation."""
    outline = outline_part(frame, seen, TABLE.height_m, dominant=DOMINANT).outline
    truth = transform_points(inverse(outline.world_from_part), part.world_vertices())
    found = outline.vertices_m
    sides = [
        found[:, 0].min() - truth[:, 0].min(),
        found[:, 0].max() - truth[:, 0].max(),
        found[:, 1].min(),
        found[:, 1].max() - height,
    ]
    return float(np.abs(sides).max()), float(outline.sigma_m.max())


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--scenes", type=int, default=0, help="number of random scenes")
    chosen = arguments.parse_args()
    speed()
    if chosen.scenes:
        random_scenes(chosen.scenes)
