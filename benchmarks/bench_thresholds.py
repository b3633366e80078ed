"""Times of the four thresholds from frame and histogram, and of the whole comparison of one picture.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_thresholds.py. Best of 50 runs on a picture of the cell, next to OpenCV's
Otsu on the same picture. Goals: 0.3 ms from the histogram, 1 ms from the frame, 50 ms for the comparison. How well the
methods divide is the subject of `surfuse threshold-study`.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np

from surfuse.cameras import REFERENCE_MODEL
from surfuse.commands.pictures.threshold_comparison import compare
from surfuse.rig.mounts import looking_outwards
from surfuse.twin.materials import Material
from surfuse.twin.optics import render, visible
from surfuse.twin.scene import Scene, table_bodies
from surfuse.twin.shapes import box, standing
from surfuse.vision.threshold import METHODS, histogram, maximum_entropy, minimum_error, otsu, threshold, uniform_error
from surfuse.vision.threshold.uniform_error import block_counts


def best_ms(call: Callable[[], object], repeats: int = 50) -> float:
    call()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def main() -> None:
    scene = Scene((*table_bodies(), standing(box(0.2, 0.05, 0.2), Material.PART, 0.05, 1.05, 1.0, 0.2)))
    place = looking_outwards(0.1, 1.3)
    image = render(scene, REFERENCE_MODEL, place, np.random.default_rng(0))
    truth = visible(scene, REFERENCE_MODEL, place, len(scene.bodies) - 1)
    counts, blocks = histogram(image), block_counts(image)
    rows: list[tuple[str, Callable[[], object]]] = [
        ("OpenCV's Otsu, from the frame", lambda: cv2.threshold(image, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)),
        *((f"{method}, from the frame", lambda method=method: threshold(image, method)) for method in METHODS),
        ("otsu, from the histogram", lambda: otsu.from_histogram(counts)),
        ("maximum_entropy, from the histogram", lambda: maximum_entropy.from_histogram(counts)),
        ("uniform_error, from the histograms of blocks", lambda: uniform_error.from_blocks(blocks)),
        ("minimum_error, from the histogram", lambda: minimum_error.from_histogram(counts)),
        ("comparison of all four, with measures", lambda: compare(image, tuple(METHODS), "auto", truth)),
    ]
    print("| step | ms |\n|---|---|")
    for name, call in rows:
        print(f"| {name} | {best_ms(call):.3f} |")


if __name__ == "__main__":
    main()
