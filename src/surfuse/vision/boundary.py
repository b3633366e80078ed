"""From a mask to boundaries: outer contours and holes, small blobs left out, then placed between pixels on the edge."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from surfuse.records import BoolArray, ByteArray, FloatArray

_REACH_PX = 3.0
_STEP_PX = 0.5
_PLATEAU_PX = 2.0
_PASSES = 2
_CHUNK = 8192
_OFFSETS = np.arange(-_REACH_PX, _REACH_PX + 0.5 * _STEP_PX, _STEP_PX)

Picture = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Boundary:
    """One connected region of a mask: `contour_px` (N, 2) x, y of its outermost pixels in order, holes likewise.

    A hole's contour runs over the pixels of the region around it. `area_px` counts pixels without those of holes;
    `touches_border` says that the region reaches the edge of the picture.

    `centroid_px` (2,) is that of the region's pixels, x and y.
    """

    contour_px: FloatArray
    holes_px: tuple[FloatArray, ...]
    area_px: float
    centroid_px: FloatArray
    touches_border: bool


def trace(mask: ByteArray, area_min_px: float) -> tuple[Boundary, ...]:
    """Boundaries of the 8-connected regions of a mask (H, W), non-zero inside, the largest first.

    Regions and holes of less than `area_min_px` pixels are left out.
    """
    contours, hierarchy = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if len(contours) == 0:
        return ()
    parent = np.asarray(hierarchy).reshape(-1, 4)[:, 3]
    # A region of A pixels has a contour of at least about sqrt(A) of them: most specks go without a closer look.
    long_enough = math.sqrt(area_min_px)
    holes: dict[int, list[FloatArray]] = {}
    for index in np.flatnonzero(parent >= 0).tolist():
        if len(contours[index]) >= long_enough:
            holes.setdefault(int(parent[index]), []).append(_points(contours[index]))
    regions = (
        _region(_points(contours[index]), holes.get(index, []), mask.shape, area_min_px)
        for index in np.flatnonzero(parent < 0).tolist()
        if len(contours[index]) >= max(long_enough, 3)
    )
    kept = [region for region in regions if region.area_px >= area_min_px and len(region.contour_px) >= 3]
    return tuple(sorted(kept, key=lambda region: (-region.area_px, *region.centroid_px)))


def refine(image: ByteArray, contour_px: FloatArray, bright: bool, contrast_min: float) -> tuple[FloatArray, BoolArray]:
    """Move contour points (N, 2) along the grey-level gradient to the edge, and say which have one (N,).

    The edge is where the profile across it crosses the mean of its two plateaus, which neither blur nor a badly chosen
    threshold moves. A point without a step of `contrast_min` levels goes half a pixel outwards, to the pixel's side.
    """
    low = np.maximum(np.floor(contour_px.min(axis=0)).astype(int) - 8, 0)
    high = np.ceil(contour_px.max(axis=0)).astype(int) + 9
    window = image[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    points = contour_px - low
    outward = _outward(window, points, bright)
    shift, found = np.zeros(len(points)), np.ones(len(points), dtype=np.bool_)
    # The plateaus are only read fairly from a profile around the edge: the first pass finds it, the second measures.
    for _ in range(_PASSES):
        profile = _profiles(window, points + shift[:, None] * outward, outward) * (1.0 if bright else -1.0)
        inner = profile[:, _OFFSETS <= -_PLATEAU_PX].mean(axis=1)
        outer = profile[:, _OFFSETS >= _PLATEAU_PX].mean(axis=1)
        further, crossed = _crossing(profile, 0.5 * (inner + outer))
        found &= crossed & (inner - outer >= contrast_min)
        shift = np.where(found, shift + further, 0.5)
    return contour_px + shift[:, None] * outward, found


def _points(contour: object) -> FloatArray:
    return np.asarray(contour, dtype=np.float64).reshape(-1, 2)


def _region(contour: FloatArray, holes: list[FloatArray], shape: tuple[int, ...], area_min_px: float) -> Boundary:
    """Pixel counts by Pick's theorem: area + contour / 2 + 1 inside and on a contour, area - contour / 2 + 1 inside."""
    moments = _moments(contour) + len(contour) / 2.0 * np.array([1.0, *contour.mean(axis=0)])
    moments += np.array([1.0, *contour.mean(axis=0)])
    kept = []
    for hole in holes:
        inside = _moments(hole)
        inside -= (len(hole) / 2.0 - 1.0) * np.array([1.0, *hole.mean(axis=0)])
        if inside[0] >= area_min_px:
            kept.append(hole)
            moments -= inside
    low, high = contour.min(axis=0), contour.max(axis=0)
    touches = bool(low.min() <= 0 or high[0] >= shape[1] - 1 or high[1] >= shape[0] - 1)
    area = float(moments[0])
    return Boundary(contour, tuple(kept), area, moments[1:] / max(area, 1.0), touches)


def _moments(contour: FloatArray) -> FloatArray:
    """Area and first moments (3,) of a polygon, positive for either direction (shoelace formula)."""
    x, y = contour[:, 0], contour[:, 1]
    x1, y1 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y1 - x1 * y
    moments = np.array([cross.sum() / 2.0, ((x + x1) * cross).sum() / 6.0, ((y + y1) * cross).sum() / 6.0])
    return moments if moments[0] >= 0.0 else -moments


def _outward(window: Picture, points: FloatArray, bright: bool) -> FloatArray:
    """Unit vectors (N, 2) down the gradient of a bright region, up that of a dark one; zero where it is flat."""
    column, row = np.rint(points).astype(int).T
    gradient = np.column_stack(
        [np.asarray(cv2.Scharr(window, cv2.CV_32F, *order))[row, column] for order in ((1, 0), (0, 1))]
    ).astype(np.float64)
    length = np.hypot(gradient[:, 0], gradient[:, 1])
    direction = gradient / np.where(length > 0.0, length, 1.0)[:, None]
    return -direction if bright else direction


def _profiles(window: Picture, points: FloatArray, outward: FloatArray) -> FloatArray:
    """Grey levels (N, S) along the outward direction, between pixels by linear interpolation."""
    parts = []
    for start in range(0, len(points), _CHUNK):
        rows = slice(start, start + _CHUNK)
        x = points[rows, :1] + _OFFSETS * outward[rows, :1]
        y = points[rows, 1:] + _OFFSETS * outward[rows, 1:]
        sampled = cv2.remap(
            window, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        parts.append(np.asarray(sampled, dtype=np.float64))
    return np.concatenate(parts)


def _crossing(profile: FloatArray, level: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Offset (N,) at which each profile falls through its level, the smallest one, and whether it does at all (N,)."""
    above = profile >= level[:, None]
    falls = above[:, :-1] & ~above[:, 1:]
    where = np.argmin(np.where(falls, np.abs(_OFFSETS[:-1] + 0.5 * _STEP_PX), np.inf), axis=1)
    rows = np.arange(len(profile))
    before, after = profile[rows, where], profile[rows, where + 1]
    drop = np.where(before > after, before - after, 1.0)
    return _OFFSETS[where] + _STEP_PX * (before - level) / drop, np.asarray(falls.any(axis=1))
