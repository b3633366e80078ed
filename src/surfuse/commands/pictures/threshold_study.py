"""The comparative study of thresholds: four methods over simulated pictures of the cell, against the true mask."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from surfuse.commands.outcome import Outcome
from surfuse.commands.pictures.threshold_comparison import Division, compare
from surfuse.durable import refuse_existing, write_text
from surfuse.errors import UsageError
from surfuse.rig.simulated.study_pictures import CONDITIONS, photographed
from surfuse.vision.threshold import METHODS

_FAILED = 0.05


@dataclass(frozen=True)
class StudyRow:
    """One method under one condition: medians over the scenes, and the share of scenes that it failed.

    A scene is failed when more than 5 % of its pixels are in the wrong class.
    """

    condition: str
    method: str
    scenes: int
    misclassification_error: float
    foreground_area_error: float
    region_non_uniformity: float
    failed_share: float
    separability: float
    ms: float


def study(scenes: int, seed: int) -> tuple[StudyRow, ...]:
    """Every method on so many pictures of every condition."""
    rows = []
    for index, (name, chosen) in enumerate(CONDITIONS.items()):
        per_method: dict[str, list[Division]] = {method: [] for method in METHODS}
        for scene in range(scenes):
            generator = np.random.default_rng([seed, index, scene])
            picture, truth = photographed(chosen(generator), generator)
            for division in compare(picture, tuple(METHODS), "bright", truth)[0]:
                per_method[division.method].append(division)
        rows += [_row(name, method, divisions) for method, divisions in per_method.items()]
    return tuple(rows)


def threshold_study(scenes: int = 30, seed: int = 1, out: Path | None = None, force: bool = False) -> Outcome:
    """Run the study, write its table where `out` says (CSV), and name the method that does best.

    Raises
    ------
    UsageError : no scenes, or `out` is not a CSV file.
    StorageError : `out` exists and `force` is not given.
    """
    if scenes < 1:
        raise UsageError(f"{scenes} scenes a condition", cure="give at least 1")
    if out is not None:
        if out.suffix.lower() != ".csv":
            raise UsageError(f"output file '{out}'", cure="give a name that ends in .csv")
        refuse_existing(out, force)
    rows = study(scenes, seed)
    if out is not None:
        write_text(out, _csv(rows), overwrite=force)
    failed = {method: float(np.mean([r.failed_share for r in rows if r.method == method])) for method in METHODS}
    wrong = {
        method: float(np.mean([r.misclassification_error for r in rows if r.method == method])) for method in METHODS
    }
    best = min(METHODS, key=lambda method: (failed[method], wrong[method]))
    closest = {condition: _closest(rows, condition) for condition in CONDITIONS}
    summary: dict[str, object] = {
        "scenes": scenes,
        "seed": seed,
        "best": best,
        "failed_share": failed,
        "misclassification_error": wrong,
        "closest": closest,
        "rows": [asdict(row) for row in rows],
        "table": None if out is None else str(out),
    }
    verdict = ", ".join(f"{method} {100.0 * failed[method]:.0f} %" for method in METHODS)
    table = [("condition, method", "misclassified  area error  non-uniform  failed  separable  ms")]
    table += [(f"{row.condition}, {row.method}", _text(row)) for row in rows]
    table += [("scenes failed", verdict), ("fewest failures", best)]
    table += [(f"closest, {condition}", method) for condition, method in closest.items()]
    return Outcome(summary, table + ([("table", str(out))] if out is not None else []))


def _closest(rows: tuple[StudyRow, ...], condition: str) -> str:
    """The method with the fewest wrong pixels under a condition."""
    return min((row for row in rows if row.condition == condition), key=lambda row: row.misclassification_error).method


def _row(condition: str, method: str, divisions: list[Division]) -> StudyRow:
    wrong = np.array([division.misclassification_error or 0.0 for division in divisions])
    return StudyRow(
        condition=condition,
        method=method,
        scenes=len(divisions),
        misclassification_error=float(np.median(wrong)),
        foreground_area_error=float(np.median([division.foreground_area_error or 0.0 for division in divisions])),
        region_non_uniformity=float(np.median([division.region_non_uniformity for division in divisions])),
        failed_share=float(np.mean(wrong > _FAILED)),
        separability=float(np.median([division.separability for division in divisions])),
        ms=float(np.median([division.ms for division in divisions])),
    )


def _csv(rows: tuple[StudyRow, ...]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(asdict(rows[0])), lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    return text.getvalue()


def _text(row: StudyRow) -> str:
    return (
        f"{row.misclassification_error:13.4f}  {row.foreground_area_error:10.4f}  {row.region_non_uniformity:11.4f}  "
        f"{100.0 * row.failed_share:4.0f} %  {row.separability:9.2f}  {row.ms:.2f}"
    )
