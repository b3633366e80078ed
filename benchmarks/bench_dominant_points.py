"""The classic comparison of dominant-point methods on chromosome, leaf and semicircles.

Run: python benchmarks/bench_dominant_points.py. For every method: number of points n_d, compression ratio CR, integral
square error ISE, largest deviation Linf, figure of merit FOM = CR / ISE, weighted error WE = ISE / CR, and ISE by the
exact optimum at the same n_d. Rows marked * are published figures; optimum, curves and what scikit-image's
approximate_polygon keeps of them (version 0.26, started at the first point) are in tests/data.
Then the speed on a contour of 600 points, next to cv2.approxPolyDP on the same contour.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from surfuse.vision.dominant_points import DominantPointParameters, dominant_points

DATA = Path(__file__).parents[1] / "tests" / "data" / "dominant_point_curves.json"
Points = npt.NDArray[np.float64]


def measures(contour: Points, indices: Sequence[int]) -> tuple[float, float]:
    """ISE and Linf of the polygon through the vertices, distances to the chord lines."""
    n, square, largest = len(contour), 0.0, 0.0
    ring = sorted(int(i) for i in indices)
    for i, j in zip(ring, [*ring[1:], ring[0] + n], strict=True):
        p, d = contour[i], contour[j % n] - contour[i]
        length = math.hypot(*d)
        for k in range(i + 1, j):
            r = contour[k % n] - p
            e = abs(d[0] * r[1] - d[1] * r[0]) / length if length else math.hypot(*r)
            square, largest = square + e * e, max(largest, e)
    return square, largest


def teh_chin(contour: Points) -> list[int]:
    """C.-H. Teh, R. T. Chin, On the detection of dominant points on digital curves, IEEE Trans. PAMI-11, 1989.

    Region of support by their rules, 1-curvature as measure of significance, non-maximum suppression in their order.
    """
    n = len(contour)
    step = np.roll(contour, -1, axis=0) - contour
    code = np.round(np.arctan2(step[:, 1], step[:, 0]) / (np.pi / 4)).astype(int)
    weight = np.abs((code - np.roll(code, 1) + 4) % 8 - 4)
    reach = [_support(contour, i) for i in range(n)]
    keep = [
        weight[i] > 0 and all(weight[i] >= weight[(i + j) % n] for j in range(-(reach[i] // 2), reach[i] // 2 + 1))
        for i in range(n)
    ]
    for i in range(n):
        beaten = any(keep[j % n] and weight[i] <= weight[j % n] for j in (i - 1, i + 1))
        if keep[i] and reach[i] == 1 and beaten:
            keep[i] = False
    for start in [i for i in range(n) if keep[i] and not keep[i - 1]]:
        group = [start]
        while keep[(group[-1] + 1) % n] and len(group) < n:
            group.append((group[-1] + 1) % n)
        for i in group[1:-1]:
            keep[i] = False
        if len(group) == 2:
            first, second = group
            stronger = (weight[first], reach[first]) > (weight[second], reach[second])
            keep[second if stronger else first] = False
    return [i for i in range(n) if keep[i]]


def _support(contour: Points, i: int) -> int:
    """Region of support of point i: grow while chord and relative deviation grow."""
    n = len(contour)

    def chord(k: int) -> tuple[float, float]:
        a, b = contour[(i - k) % n], contour[(i + k) % n]
        length = math.hypot(*(b - a))
        across = (b[0] - a[0]) * (contour[i][1] - a[1]) - (b[1] - a[1]) * (contour[i][0] - a[0])
        return length, across / length if length else 0.0

    k = 1
    while k < n // 2 - 1:
        (length, deviation), (longer, further) = chord(k), chord(k + 1)
        if length >= longer:
            break
        here, there = deviation / length if length else 0.0, further / longer
        if (deviation > 0 and here >= there) or (deviation < 0 and here <= there):
            break
        k += 1
    return k


def polygon_of_opencv(contour: Points, tolerance: float) -> list[int]:
    """Indices that cv2.approxPolyDP keeps."""
    kept = cv2.approxPolyDP(contour.astype(np.int32).reshape(-1, 1, 2), tolerance, True).reshape(-1, 2)
    where = {tuple(point): i for i, point in enumerate(contour.astype(int).tolist())}
    return [where[tuple(point)] for point in kept.tolist()]


def row(name: str, contour_size: int, count: int, ise: float, largest: float, optimum: float | None) -> str:
    ratio = contour_size / count
    merit = ratio / ise if ise else math.inf
    by_optimum = f"{ise / optimum:8.3f}" if optimum else "       -"
    return f"| {name:28s} | {count:3d} | {ratio:6.2f} | {ise:7.2f} | {largest:5.2f} | {merit:6.3f} | {ise / ratio:6.2f} | {by_optimum} |"  # noqa: E501


def compare() -> None:
    reference = json.loads(DATA.read_text())
    worst = 0.0
    for name, curve in reference["curves"].items():
        contour = np.array(curve["points"], dtype=float)[: curve["n"]]
        n = len(contour)
        optimum = {int(count): ise for count, ise in curve["optimal_ISE_by_n_d"].items()}
        print(f"\n### {name} ({n} points)\n")
        print("| method                       | n_d |     CR |     ISE |  Linf |    FOM |     WE |  ISE/opt |")
        print("|---|---|---|---|---|---|---|---|")
        for published, figures in reference["published_table_from_memory"][name].items():
            count = int(figures[0])
            print(row(f"{published} *", n, count, figures[1], figures[2], optimum.get(count)))
            ours = dominant_points(contour, n_points=count).indices.tolist()
            print(row("surfuse", n, count, *measures(contour, ours), optimum.get(count)))
        indices = teh_chin(contour)
        print(row("Teh-Chin (here)", n, len(indices), *measures(contour, indices), optimum.get(len(indices))))
        for tolerance in (0.7, 1.0, 1.5, 2.0):
            indices = polygon_of_opencv(contour, tolerance)
            label = f"approxPolyDP, {tolerance} px"
            print(row(label, n, len(indices), *measures(contour, indices), optimum.get(len(indices))))
            indices = curve["rdp_oracles"][str(tolerance)]["skimage_approximate_polygon_from_point0"]["indices"]
            label = f"scikit-image, {tolerance} px"
            print(row(label, n, len(indices), *measures(contour, indices), optimum.get(len(indices))))
            found = dominant_points(contour, DominantPointParameters(tolerance_px=tolerance)).indices.tolist()
            label = f"surfuse, {tolerance} px"
            print(row(label, n, len(found), *measures(contour, found), optimum.get(len(found))))
        for count in range(10, 31):
            ours = dominant_points(contour, n_points=count).indices.tolist()
            worst = max(worst, measures(contour, ours)[0] / optimum[count])
    print(f"\nlargest ISE by the exact optimum, n_d 10 to 30, all curves: {worst:.4f} (goal: at most 1.25)")


def best_ms(call: Callable[[], object], repeats: int = 30) -> float:
    call()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def speed() -> None:
    angle = 2 * np.pi * np.arange(4000) / 4000
    radius = 75 * (1 + 0.2 * np.cos(3 * angle))
    exact = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    digital = np.round(exact)
    digital = digital[np.any(digital != np.roll(digital, 1, axis=0), axis=1)][:600]
    smooth = exact[:: len(exact) // 600][:600]
    print("\n| contour | points | surfuse ms | approxPolyDP ms |")
    print("|---|---|---|---|")
    for name, contour in (("digital", digital), ("between pixels", smooth)):
        single = contour.astype(np.float32).reshape(-1, 1, 2)
        ours = best_ms(lambda contour=contour: dominant_points(contour))
        theirs = best_ms(lambda single=single: cv2.approxPolyDP(single, 1.0, True))
        print(f"| {name} | {len(contour)} | {ours:.2f} | {theirs:.3f} |")


if __name__ == "__main__":
    compare()
    speed()
