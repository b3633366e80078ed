"""The comparative study of thresholds: four methods over simulated pictures of the cell, against the true mask."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from surfuse.cameras import REFERENCE_MODEL
from surfuse.commands.outcome import Outcome
from surfuse.commands.pictures.threshold_comparison import Division, compare
from surfuse.durable import refuse_existing, write_text
from surfuse.errors import UsageError
from surfuse.interfaces import Generator
from surfuse.records import BoolArray, ByteArray
from surfuse.rig.devices import looking_outwards, world_from_shoulder
from surfuse.twin.materials import Material
from surfuse.twin.optics import OpticsParameters, render, visible
from surfuse.twin.scene import Scene, SceneBody, TableParameters, table_bodies
from surfuse.twin.shapes import box, cylinder, standing
from surfuse.vision.threshold import METHODS

_CAMERA_M = (0.10, 1.30)
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


@dataclass(frozen=True)
class _Shot:
    """What makes one condition: the part, and the light it is seen in."""

    part: SceneBody
    optics: OpticsParameters


def _even(g: Generator) -> OpticsParameters:
    return OpticsParameters(background=g.uniform(8.0, 30.0))


def _part(g: Generator, material: Material = Material.PART, low: float = 0.10, high: float = 0.25) -> SceneBody:
    """A block or a cylinder on the table, in view."""
    azimuth, radius = g.uniform(-0.12, 0.12), g.uniform(1.0, 1.1)
    width, height = g.uniform(low, high, 2)
    if g.random() < 0.5:
        solid = box(width, min(width, 0.08), height)
    else:
        solid = cylinder(min(0.5 * width, 0.07), height)
    return standing(solid, material, azimuth, radius, TableParameters().table_height_m, g.uniform(-0.5, 0.5))


def _plain(g: Generator) -> _Shot:
    return _Shot(_part(g), _even(g))


def _gradient(g: Generator) -> _Shot:
    x, y = g.uniform(0.5, 1.0, 2) * g.choice([-1.0, 1.0], 2)
    return _Shot(_part(g), OpticsParameters(background=g.uniform(20.0, 45.0), gradient_x=x, gradient_y=y))


def _low_contrast(g: Generator) -> _Shot:
    return _Shot(_part(g, Material.CLUTTER), OpticsParameters(background=g.uniform(35.0, 55.0), exposure=260.0))


def _noise(g: Generator) -> _Shot:
    return _Shot(_part(g), OpticsParameters(background=g.uniform(20.0, 40.0), noise_levels=g.uniform(15.0, 30.0)))


def _small(g: Generator) -> _Shot:
    return _Shot(_part(g, low=0.025, high=0.045), _even(g))


def _shiny(g: Generator) -> _Shot:
    """The lamp hangs low enough for its highlight to be seen on an upright surface."""
    part = _part(g, Material.PART_SMOOTH)
    lamp = (0.0, g.uniform(-0.5, 0.5), g.uniform(1.4, 1.8))
    gloss = g.uniform(150.0, 400.0)
    return _Shot(part, OpticsParameters(lamp, ambient=0.1, exposure=150.0, gloss=gloss, background=20.0))


CONDITIONS: dict[str, Callable[[Generator], _Shot]] = {
    "plain": _plain,
    "illumination gradient": _gradient,
    "low contrast": _low_contrast,
    "noise": _noise,
    "small part": _small,
    "shiny part": _shiny,
}


def study(scenes: int, seed: int) -> tuple[StudyRow, ...]:
    """Every method on so many pictures of every condition."""
    rows = []
    for index, (name, shot) in enumerate(CONDITIONS.items()):
        per_method: dict[str, list[Division]] = {method: [] for method in METHODS}
        for scene in range(scenes):
            generator = np.random.default_rng([seed, index, scene])
            picture, truth = _photographed(shot(generator), generator)
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


def _photographed(shot: _Shot, generator: Generator) -> tuple[ByteArray, BoolArray]:
    """The picture (H, W) of the cell with the part, and the pixels (H, W) that show the part."""
    scene = Scene((*table_bodies(), shot.part))
    place = world_from_shoulder(0.0) @ looking_outwards(*_CAMERA_M)
    picture = render(scene, REFERENCE_MODEL, place, generator, shot.optics)
    return picture, visible(scene, REFERENCE_MODEL, place, len(scene.bodies) - 1)


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
