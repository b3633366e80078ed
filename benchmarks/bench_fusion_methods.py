"""Every fusion method on equal readings: the table and the pictures of docs/explanations/fusion_methods.md.

    OMP_NUM_THREADS=1 python benchmarks/bench_fusion_methods.py [--foreign FOLDER] [--write]

The project's own scenes are scanned by its twin (seed 1, tube, low noise). FOLDER holds scans by another simulator,
one folder each with readings.csv, truth.ply and the files beside them; names end in _BEAM_NOISE. With `--write` the
tables between the marks of the page and the pictures in docs/images are replaced.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from surfuse import registry
from surfuse.commands.acquire.acquisition import acquire
from surfuse.commands.fuse.map_of_log import grid_of
from surfuse.commands.judge.method_comparison import Against, MethodResult, result_of
from surfuse.commands.judge.truth_files import dense_truth, read_truth
from surfuse.commands.outcome import SilentWatcher
from surfuse.records import FloatArray, SurfaceMap
from surfuse.report.axes import drawing
from surfuse.report.colours import CATEGORIES, colourise
from surfuse.report.deviation import deviation
from surfuse.report.markup import Markup, element
from surfuse.runs.scan_source import load_scan
from surfuse.settings import FusionSettings, load

DOCS = Path(__file__).parents[1] / "docs"
PAGE, MARKS = DOCS / "explanations" / "fusion_methods.md", ("<!-- table: {} -->", "<!-- end of table: {} -->")
OWN = ("flat", "tilted", "relief")
SIZE, GAP, LEVELS, ERROR_MM = 118.0, 14.0, 24, 20.0


@dataclass(frozen=True)
class Case:
    """One scan with the results of all methods."""

    name: str
    truth: SurfaceMap
    results: tuple[MethodResult, ...]


def case_of(name: str, log: Path) -> Case:
    """All methods on one log with its truth beside it."""
    scan = load_scan(log)
    grid = grid_of(scan)
    against = Against(read_truth(log / "truth.ply", grid), dense_truth(log / "truth.ply", grid))
    methods = registry.names("fusion")
    results = tuple(result_of(scan, FusionSettings(), method, grid, against) for method in methods)
    return Case(name, against.surface, results)


def own_cases() -> list[Case]:
    """The twin's scenes; their readings do not depend on the method."""
    cases = []
    with tempfile.TemporaryDirectory() as folder:
        for scene in OWN:
            run = Path(folder) / scene
            acquire(load(None, [f"scene.name={scene}", "fusion.method=weighted_average"]), run, SilentWatcher())
            cases.append(case_of(scene, run))
    return cases


def cell(one: MethodResult, edges: bool) -> str:
    """RMSE at the nodes and dense in mm, and at a step the share within 3 mm and the error of the edge."""
    if one.found is None:
        return "-"
    text = f"{one.found.rmse_mm:.2f}, {one.found.dense_rmse_mm:.2f}"
    if not edges:
        return text
    edge = f"{one.found.edge_mm:+.0f}" if np.isfinite(one.found.edge_mm) else "none"
    return f"{text}, {100.0 * one.found.within_3_mm:.0f} %, {edge}"


def table(cases: list[Case]) -> str:
    """The cases as columns, the methods as rows; the best RMSE of each column is bold."""
    found = [[one.found for one in case.results if one.found is not None] for case in cases]
    stepped = [any(np.isfinite(one.edge_mm) for one in scores) for scores in found]
    heads = [
        case.name + (" (RMSE, dense, in 3 mm, edge)" if edges else " (RMSE, dense)")
        for case, edges in zip(cases, stepped, strict=True)
    ]
    lines = ["| method | " + " | ".join(heads) + " |", "|---" * (len(cases) + 1) + "|"]
    best = [min(one.rmse_mm for one in scores) for scores in found]
    for k, one in enumerate(cases[0].results):
        cells = []
        for case, edges, least in zip(cases, stepped, best, strict=True):
            mine = case.results[k]
            text = cell(mine, edges)
            cells.append(f"**{text}**" if mine.found is not None and mine.found.rmse_mm == least else text)
        lines.append(f"| {one.name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def ratios(cases: list[Case]) -> str:
    """Geometric mean and worst of each method's RMSE over the paper's."""
    lines = ["| method | geometric mean of RMSE over the paper's method | worst |", "|---|---|---|"]
    paper = [next(one for one in case.results if one.name == "weighted_average") for case in cases]
    for k, one in enumerate(cases[0].results):
        over = [
            case.results[k].found.rmse_m / base.found.rmse_m
            for case, base in zip(cases, paper, strict=True)
            if case.results[k].found is not None and base.found is not None
        ]
        lines.append(f"| {one.name} | {float(np.exp(np.mean(np.log(over)))):.2f} | {max(over):.2f} |")
    return "\n".join(lines)


def tiles(
    values_mm: FloatArray, prior: FloatArray, low: float, high: float, palette: str, x: float, y: float
) -> list[Markup]:
    """A map as coloured bars, up is up; cells of one colour beside each other share a bar, what only the prior says is
    drawn at half height.
    """
    share = np.clip((values_mm - low) / (high - low), 0.0, 1.0)
    level = np.where(np.isfinite(share), np.round(share * (LEVELS - 1)), -1).astype(np.int64)
    colours = colourise(np.arange(LEVELS) / (LEVELS - 1), 0.0, 1.0, palette)
    rows, cols = level.shape
    side = SIZE / max(rows, cols)
    outline: dict[int, str] = {}
    for j in range(rows):
        cuts = [0, *(np.flatnonzero(np.diff(2 * level[j] + prior[j])) + 1).tolist(), cols]
        for a, b in pairwise(cuts):
            if level[j, a] >= 0:
                wide, tall = (b - a) * side + 0.2, side * (0.5 if prior[j, a] else 1.04)
                corner = f"M{x + a * side:.1f} {y + (rows - 1 - j) * side:.1f}"
                bar = f"{corner}h{wide:.1f}v{tall:.1f}h{-wide:.1f}z"
                outline[int(level[j, a])] = outline.get(int(level[j, a]), "") + bar
    made = []
    for number, path in sorted(outline.items()):
        red, green, blue = (int(c) for c in colours[number])
        made.append(element("path", {"d": path, "fill": f"#{red:02x}{green:02x}{blue:02x}"}))
    return made


def picture(case: Case) -> str:
    """Heights and errors of all methods in the same colours, one pair a method, truth first."""
    heights = case.truth.height_m[case.truth.mask] * 1e3
    low, high = float(heights.min()) - 2.0, float(heights.max()) + 2.0
    shown = [("truth", case.truth, None)]
    shown += [(one.name, one.surface, one) for one in case.results if one.surface is not None]
    columns = 5
    wide, tall = 2 * SIZE + GAP + 8.0, SIZE + 46.0
    width, height = columns * wide + GAP, -(-len(shown) // columns) * tall + 62.0
    head = (
        f"{case.name}: height ({low:.0f} to {high:.0f} mm) and error (blue −{ERROR_MM:.0f} mm, red +{ERROR_MM:.0f} mm)"
    )
    parts = [element("text", {"x": GAP, "y": 26, "font-size": 17, "font-weight": "bold"}, head)]
    note = "Half-height bars: only the prior speaks. White: no value. RMSE below each name."
    parts.append(element("text", {"x": GAP, "y": 45, "font-size": 12}, note))
    for k, (name, surface, one) in enumerate(shown):
        x, y = GAP + (k % columns) * wide, 62.0 + (k // columns) * tall
        known = np.where(surface.mask, surface.height_m, np.nan) * 1e3
        guessed = (surface.mask & ~surface.measured).astype(np.int64)
        parts += tiles(known, guessed, low, high, "viridis", x, y)
        if one is not None:
            error = deviation(surface, case.truth) * 1e3
            parts += tiles(error, guessed, -ERROR_MM, ERROR_MM, "diverging", x + SIZE + 6.0, y)
        text = name if one is None or one.found is None else f"{name}: {1e3 * one.found.rmse_m:.2f} mm"
        style = {
            "x": x,
            "y": y + SIZE + 16.0,
            "font-size": 12,
            "fill": f"#{CATEGORIES[0]}" if name == "beam" else "#16202b",
        }
        parts.append(element("text", style, text))
    body = [element("rect", {"width": width, "height": height, "fill": "#ffffff"}), *parts]
    svg = str(drawing(width, height, head, body, "picture"))
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" ', 1) + "\n"


def replaced(page: str, name: str, text: str) -> str:
    """The page with what stands between two marks replaced."""
    first, last = (mark.format(name) for mark in MARKS)
    before, rest = page.split(first, 1)
    return f"{before}{first}\n\n{text}\n\n{last}{rest.split(last, 1)[1]}"


def main() -> None:
    """Print the tables; with --write, put them and the pictures into the docs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--foreign", type=Path)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    groups = {"own": own_cases()}
    if given.foreign is not None:
        scans = sorted(path for path in given.foreign.iterdir() if (path / "truth.ply").is_file())
        found = [case_of(path.name.replace("_", " "), path) for path in scans]
        for beam in ("tube low", "tube high", "wide low"):
            groups[beam] = [case for case in found if case.name.endswith(beam)]
        groups["ratios"] = [case for cases in groups.values() for case in cases]
    texts = {name: ratios(cases) if name == "ratios" else table(cases) for name, cases in groups.items() if cases}
    for name, text in texts.items():
        print(f"\n{name}\n{text}")
    if given.write:
        page = PAGE.read_text("utf-8")
        for name, text in texts.items():
            page = replaced(page, name, text)
        PAGE.write_text(page, "utf-8")
        for case in groups["own"]:
            (DOCS / "images" / f"methods_{case.name}.svg").write_text(picture(case), "utf-8")


if __name__ == "__main__":
    main()
