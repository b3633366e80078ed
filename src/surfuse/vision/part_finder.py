"""Find the parts in a picture: threshold, boundary, and the reasons why something is not a part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np

from surfuse.errors import ConfigError, nearest
from surfuse.records import BoolArray, ByteArray, CameraFrame, Detection
from surfuse.vision.boundary import Boundary, refine, trace
from surfuse.vision.dim_foot import with_dim_foot
from surfuse.vision.flatten import flattened
from surfuse.vision.polarity import POLARITIES, Polarity, parts_are_bright
from surfuse.vision.standing_parts import StandingParameters, ends_on_table, on_table, runs_through
from surfuse.vision.table import TableRing
from surfuse.vision.threshold import METHODS, Threshold, otsu, threshold

_MIDDLE = 128.0
_DIVISIONS = 4
_SPECK = 4.0


@dataclass(frozen=True)
class FindParameters:
    """What counts as a part in a picture.

    Parameters
    ----------
    method : threshold method, one of `surfuse.vision.threshold.METHODS`.
    polarity : parts brighter or darker than what is behind them; `auto`: unlike most of the picture's rim.
    separability_min : a histogram with a shallower valley has no part (0 to 1).
    contrast_min : least step of the grey level across a part's boundary.
    edge_share_min : least share of a boundary that must have that step.
    area_min_px : least number of pixels.
    blur_px : standard deviation of the smoothing before the threshold.
    noise_ratio : how many standard deviations a part stands out when the picture is not bimodal as a whole.
    standing : where the foot of a part may be.
    """

    method: str = "otsu"
    polarity: Polarity = "auto"
    separability_min: float = 0.3
    contrast_min: float = 12.0
    edge_share_min: float = 0.75
    area_min_px: float = 64.0
    blur_px: float = 1.0
    noise_ratio: float = 6.0
    standing: StandingParameters = field(default_factory=StandingParameters)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(f"unknown threshold method '{self.method}'", cure=nearest(self.method, METHODS))
        if self.polarity not in POLARITIES:
            raise ConfigError(f"polarity = '{self.polarity}'", cure=nearest(self.polarity, POLARITIES))
        for name in ("separability_min", "edge_share_min"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give a share between 0 and 1")
        for name in ("contrast_min", "area_min_px", "blur_px", "noise_ratio"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give a finite number >= 0")


def find_parts(
    frame: CameraFrame, parameters: FindParameters | None = None, table: TableRing | None = None
) -> tuple[Detection, ...]:
    """Parts in a frame of the cell's camera, the largest first; none is an answer.

    A region that runs through from the left to the right side is the table or the room. With `table`, a region whose
    lowest pixel is not on the table top is no part either; the dim foot of a round part is looked for first.
    """
    chosen = parameters or FindParameters()
    smooth = _smoothed(frame.image, chosen.blur_px)

    def part(detection: Detection) -> Detection | None:
        if runs_through(detection, frame.camera.width_px):
            return None
        if table is None or on_table(detection, frame, smooth, table, chosen.standing):
            return detection
        longer = _with_dim_foot(detection, smooth, chosen)
        return longer if longer is not None and ends_on_table(longer, frame, table, chosen.standing) else None

    return _find(smooth, chosen, part)


def find_regions(image: ByteArray, parameters: FindParameters | None = None) -> tuple[Detection, ...]:
    """Regions of any grey picture (H, W) uint8 that stand out from what is behind them, the largest first."""
    chosen = parameters or FindParameters()
    return _find(_smoothed(image, chosen.blur_px), chosen, lambda detection: detection)


def _smoothed(image: ByteArray, blur_px: float) -> ByteArray:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), np.uint8) if blur_px > 0.0 else image


def _find(
    smooth: ByteArray, chosen: FindParameters, accept: Callable[[Detection], Detection | None]
) -> tuple[Detection, ...]:
    """The picture as a whole first; when nothing there is a part, the picture without its slow changes of light."""
    return _divided(smooth, smooth, chosen, accept) or _evenly_lit(smooth, chosen, accept)


def _evenly_lit(
    smooth: ByteArray, chosen: FindParameters, accept: Callable[[Detection], Detection | None]
) -> tuple[Detection, ...]:
    """The same with the illumination taken out; then whatever differs from it by much more than noise does."""
    residual, noise = flattened(smooth)
    even = np.clip(np.rint(residual + _MIDDLE), 0.0, 255.0).astype(np.uint8)
    found = _divided(smooth, even, chosen, accept)
    if found:
        return found
    least = max(chosen.noise_ratio * noise, chosen.contrast_min)
    outliers: list[Detection] = []
    for bright in (True, False):
        if chosen.polarity in ("auto", "bright" if bright else "dark"):
            mask = _without_threads(residual > least if bright else residual < -least)
            level = int(np.clip(_MIDDLE + (least if bright else -least), 0, 255))
            outliers += _detections(smooth, mask, bright, Threshold(level, 0.0, chosen.method), chosen)
    kept = map(accept, sorted(outliers, key=lambda detection: -detection.area_px))
    return tuple(detection for detection in kept if detection is not None)


def _without_threads(mask: BoolArray) -> BoolArray:
    """The mask without what is thinner than three pixels: noise near the limit grows threads that reach the table."""
    opened = cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.asarray(opened, dtype=np.uint8).view(np.bool_)


def _divided(
    smooth: ByteArray, even: ByteArray, chosen: FindParameters, accept: Callable[[Detection], Detection | None]
) -> tuple[Detection, ...]:
    """Regions of the class that is not behind, when the grey levels of `even` fall into two classes at all.

    A part may be joined with something that is no part (a table between it and a dark room). So unless all regions but
    specks are accepted, their class is divided again, by Otsu's method: the other ones may need a whole picture.
    """
    divided = threshold(even, chosen.method)
    accepted: list[Detection] = []
    bright = parts_are_bright(even > divided.level, chosen.polarity)
    for _ in range(_DIVISIONS):
        mask = even > divided.level if bright else even <= divided.level
        if divided.separability >= chosen.separability_min:
            found = _traced(smooth, mask, bright, divided, chosen)
            good = [accept(one) if one.confidence >= chosen.edge_share_min else None for one in found]
            parts = [part for part in good if part is not None]
            accepted += [part for part in parts if not any(_holds(known, part) for known in accepted)]
            specks = (one.area_px <= _SPECK * chosen.area_min_px for one in found)
            if parts and all(part or speck for part, speck in zip(good, specks, strict=True)):
                break
        if not mask.any():
            break
        divided = threshold(even[mask][None, :], otsu.METHOD)
    return tuple(sorted(accepted, key=lambda detection: -detection.area_px))


def _holds(outer: Detection, inner: Detection) -> bool:
    """Whether the centroid of one region lies inside the boundary of another."""
    contour = outer.contour_px.astype(np.float32).reshape(-1, 1, 2)
    return bool(cv2.pointPolygonTest(contour, tuple(inner.centroid_px.tolist()), False) >= 0)


def _with_dim_foot(detection: Detection, smooth: ByteArray, chosen: FindParameters) -> Detection | None:
    """The same region with the part of it that is too dark for the threshold; None when there is none."""
    found = with_dim_foot(detection, smooth, chosen.contrast_min)
    if found is None:
        return None
    mask, bright = found
    regions = trace(mask, chosen.area_min_px)
    divided = Threshold(detection.level, detection.separability, chosen.method)
    longer = _detection(smooth, regions[0], bright, divided, chosen.contrast_min) if regions else None
    return longer if longer is not None and longer.confidence >= chosen.edge_share_min else None


def _detections(
    smooth: ByteArray, mask: BoolArray, bright: bool, divided: Threshold, chosen: FindParameters
) -> tuple[Detection, ...]:
    """Regions with enough of a real edge to be a part."""
    found = _traced(smooth, mask, bright, divided, chosen)
    return tuple(detection for detection in found if detection.confidence >= chosen.edge_share_min)


def _traced(
    smooth: ByteArray, mask: BoolArray, bright: bool, divided: Threshold, chosen: FindParameters
) -> list[Detection]:
    """All regions of a mask that are not too small."""
    return [
        _detection(smooth, region, bright, divided, chosen.contrast_min)
        for region in trace(mask.view(np.uint8), chosen.area_min_px)
    ]


def _detection(smooth: ByteArray, region: Boundary, bright: bool, divided: Threshold, contrast_min: float) -> Detection:
    contour, edge = refine(smooth, region.contour_px, bright, contrast_min)
    height, width = smooth.shape
    x, y = region.contour_px.T
    inside = (x > 0) & (x < width - 1) & (y > 0) & (y < height - 1)
    return Detection(
        contour_px=contour,
        centroid_px=region.centroid_px,
        area_px=region.area_px,
        touches_border=region.touches_border,
        level=divided.level,
        separability=divided.separability,
        confidence=float(edge[inside].mean()) if np.any(inside) else 0.0,
        holes_px=tuple(refine(smooth, hole, bright, contrast_min)[0] for hole in region.holes_px),
    )
