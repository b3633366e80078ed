"""What goes into a report: plain records, everything but the title optional.

A report of a foreign log has no camera, no plan, no truth and no arm; a section without content is left out.
Lengths are metres, part frame unless a name says otherwise; the page turns them into millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError
from surfuse.records import (
    ByteArray,
    DenseScore,
    FloatArray,
    FusedPoints,
    IntArray,
    Outline,
    Readings,
    ScanPlan,
    Score,
    SkippedStop,
    SurfaceMap,
)

SAFETY = "surfuse has no safety function; stops belong to the robot's controller."

Level = Literal["info", "warning", "error"]
Axis = Literal["u", "v"]


def _no_points() -> FloatArray:
    return np.zeros((0, 2))


def _freeze(record: object, name: str, dtype: npt.DTypeLike, tail: tuple[int, ...]) -> None:
    """Replace a field by a read-only copy of shape (any, *tail)."""
    array = np.array(getattr(record, name), dtype=dtype)
    if array.ndim != 1 + len(tail) or array.shape[1:] != tail:
        wanted = "(" + ", ".join(["any", *map(str, tail)]) + ")"
        raise DataError(f"{type(record).__name__}.{name} has shape {array.shape}, wanted {wanted}")
    array.setflags(write=False)
    object.__setattr__(record, name, array)


@dataclass(frozen=True)
class KeyFigure:
    """One figure of the headline: its name, its value as text with unit, and what it means.

    `label` and `value` stand in the headline, `hint` in small type below them (empty: none).
    """

    label: str
    value: str
    hint: str = ""


@dataclass(frozen=True)
class MarkedLevel:
    """The threshold of one method, the last grey level of the dark class, and how separate the classes are (0 to 1)."""

    method: str
    level: int
    separability: float


@dataclass(frozen=True)
class FoundPartView:
    """A part as the camera saw it: grey image (H, W), contour and dominant points (N, 2) as x, y in pixels.

    `pixel_aspect` is the width of a pixel over its height; `histogram` counts the 256 grey levels (empty: none).
    `threshold` is the level that the part was found with, `levels` what the methods make of the whole picture.
    `outline` is the part in metres with its standard deviations, `facts` what else is known, each a few words.

    Raises
    ------
    DataError : the picture is not grey bytes, the histogram has not 256 levels, or points are not (any, 2).
    """

    label: str
    image: ByteArray
    contour_px: FloatArray = field(default_factory=_no_points)
    dominant_px: FloatArray = field(default_factory=_no_points)
    pixel_aspect: float = 1.0
    threshold: int | None = None
    histogram: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    levels: tuple[MarkedLevel, ...] = ()
    outline: Outline | None = None
    facts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        image = np.array(self.image)
        if image.dtype != np.uint8 or image.ndim != 2 or image.size == 0:
            raise DataError(f"FoundPart.image is {image.dtype} {image.shape}", cure="give a grey uint8 image (H, W)")
        if not self.pixel_aspect > 0.0:
            raise DataError(f"FoundPart.pixel_aspect = {self.pixel_aspect}", cure="give width over height, > 0")
        _freeze(self, "image", np.uint8, image.shape[1:])
        _freeze(self, "contour_px", np.float64, (2,))
        _freeze(self, "dominant_px", np.float64, (2,))
        _freeze(self, "histogram", np.int64, ())
        if len(self.histogram) not in (0, 256):
            raise DataError(f"FoundPart.histogram has {len(self.histogram)} levels", cure="give 256, or none")


@dataclass(frozen=True)
class PlanView:
    """The plan over the outline: polygons (N, 2) and stops (M, 2) in visiting order, as u, v.

    `outline_m` is the outline as the camera saw it and `enlarged_m` what was scanned, both in m in the part frame;
    `step_m` and `margin_m` are nan where unknown, `margin_text` says why the margin is so wide.

    Raises
    ------
    DataError : a polygon or the stops are not (any, 2).
    """

    outline_m: FloatArray
    stops_m: FloatArray
    enlarged_m: FloatArray = field(default_factory=_no_points)
    skipped: tuple[SkippedStop, ...] = ()
    step_m: float = float("nan")
    margin_m: float = float("nan")
    margin_text: str = ""

    def __post_init__(self) -> None:
        for name in ("outline_m", "stops_m", "enlarged_m"):
            _freeze(self, name, np.float64, (2,))


def plan_view(plan: ScanPlan, outline_m: FloatArray, margin_text: str = "") -> PlanView:
    """The drawing of a scan plan over the outline (N, 2) that the camera saw; the text says why the margin is so."""
    return PlanView(
        outline_m=outline_m,
        stops_m=plan.uv_m,
        enlarged_m=plan.outline.vertices_m,
        skipped=plan.skipped,
        step_m=plan.step_m,
        margin_m=plan.outline.margin_m,
        margin_text=margin_text,
    )


@dataclass(frozen=True)
class NamedMap:
    """A surface and the words that name it on the page (a method, "spline", "truth")."""

    label: str
    surface: SurfaceMap


@dataclass(frozen=True)
class ScoreRow:
    """Errors of one method against truth, in m: at the nodes of the map, and against truth sampled every millimetre."""

    method: str
    score: Score
    dense: DenseScore

    @property
    def edge_m(self) -> float:
        """How far the edges of steps are misplaced; nan where there is no step."""
        return self.dense.edge_m


@dataclass(frozen=True)
class ReportEvent:
    """Something that happened during the run, with its time of the run (nan: unknown).

    `text` is one line for a person; `level` is info, warning or error, `t_s` in s.
    """

    text: str
    level: Level = "info"
    t_s: float = float("nan")


@dataclass(frozen=True)
class Scenery:
    """A mesh of the cell that is shown around the scan: vertices (N, 3) in the world frame, triangles (F, 3).

    `vertices_m` in m, `faces` are the triangles; `name` is what the page calls it.
    """

    name: str
    vertices_m: FloatArray
    faces: IntArray

    def __post_init__(self) -> None:
        _freeze(self, "vertices_m", np.float64, (3,))
        _freeze(self, "faces", np.int64, (3,))


@dataclass(frozen=True)
class ReportContent:
    """The report of one run. Only the title is needed.

    `made` is the date as text. The first of `maps` is the one that the run is about, `rival` another
    method's on the same readings, shown beside it. `points` and `readings`, where
    both are given, describe the same sweeps. `arm_m` (M, K, 3) holds the joint positions (world frame) at each sweep.

    `scene`, `version` and `summary` are texts of the head, `figures` its numbers; `truth` is shown beside the maps
    where it is known. `configuration_toml` is shown as it is.
    """

    title: str
    scene: str = ""
    method: str = ""
    made: str = ""
    version: str = ""
    summary: str = ""
    figures: tuple[KeyFigure, ...] = ()
    parts: tuple[FoundPartView, ...] = ()
    plan: PlanView | None = None
    maps: tuple[NamedMap, ...] = ()
    truth: NamedMap | None = None
    points: FusedPoints | None = None
    readings: Readings | None = None
    arm_m: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 3)))
    scenery: tuple[Scenery, ...] = ()
    scores: tuple[ScoreRow, ...] = ()
    events: tuple[ReportEvent, ...] = ()
    configuration_toml: str = ""
    safety: str = SAFETY
    rival: NamedMap | None = None

    def __post_init__(self) -> None:
        if not self.title.strip():
            raise DataError("a report needs a title", cure="give ReportContent.title")
        if self.rival is not None and not self.maps:
            raise DataError("a rival map stands beside no map", cure="give ReportContent.maps too")
        arm = np.array(self.arm_m, dtype=np.float64)
        if arm.ndim != 3 or arm.shape[2] != 3:
            raise DataError(f"ReportContent.arm_m has shape {arm.shape}, wanted (sweeps, joints, 3)")
        arm.setflags(write=False)
        object.__setattr__(self, "arm_m", arm)
        if self.readings is None:
            return
        for name, length in (("points", len(self.points) if self.points else None), ("arm_m", len(arm) or None)):
            if length not in (None, self.readings.n_sweeps):
                raise DataError(
                    f"ReportContent.{name} has {length} stops, readings have {self.readings.n_sweeps} sweeps",
                    cure="give the points and the arm of the same sweeps",
                )


@dataclass(frozen=True)
class SceneComparison:
    """Several methods on the readings of one scene.

    The profile is cut along `cut_along` where the other coordinate is `cut_at_m`: across the step, or along the tilt.
    `expected` says what was reported for such a scene, `found` what is seen here, with numbers.
    """

    name: str
    maps: tuple[NamedMap, ...]
    truth: NamedMap | None = None
    scores: tuple[ScoreRow, ...] = ()
    cut_along: Axis = "u"
    cut_at_m: float = 0.0
    expected: str = ""
    found: str = ""
    figures: tuple[KeyFigure, ...] = ()


@dataclass(frozen=True)
class PageTable:
    """A table of texts: its title, the heads of its columns, its rows (as long as the head), and what it says."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    text: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.head):
                raise DataError(
                    f"table '{self.title}': a row of {len(row)} cells under {len(self.head)} heads",
                    cure="give a cell a column",
                )


@dataclass(frozen=True)
class ComparisonContent:
    """The page that compares methods on several scenes; `tables` stand behind the scenes."""

    title: str
    scenes: tuple[SceneComparison, ...]
    introduction: str = ""
    made: str = ""
    version: str = ""
    figures: tuple[KeyFigure, ...] = ()
    tables: tuple[PageTable, ...] = ()
    events: tuple[ReportEvent, ...] = ()
    configuration_toml: str = ""
    safety: str = SAFETY

    def __post_init__(self) -> None:
        if not self.title.strip():
            raise DataError("a comparison needs a title", cure="give ComparisonContent.title")
