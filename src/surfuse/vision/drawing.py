"""Pictures for people: divided images side by side, and outlines drawn over the picture they were found in."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from surfuse.errors import DataError
from surfuse.records import BoolArray, ByteArray, FloatArray, IntArray

_PANEL_PX = 360
_OVERLAY_MAX_PX = 2000
_TITLE_PX = 26
_ORANGE, _GREEN, _WHITE, _GREY, _DARK = (0, 94, 213), (115, 158, 0), (255, 255, 255), (150, 150, 150), (40, 40, 40)
Colour = tuple[int, int, int]


@dataclass(frozen=True)
class DividedPicture:
    """One method's division of a picture: its name, level and foreground (H, W)."""

    name: str
    level: int
    foreground: BoolArray


def side_by_side(
    image: ByteArray, counts: IntArray, divided: tuple[DividedPicture, ...], truth: BoolArray | None = None
) -> ByteArray:
    """The picture (H, W), its histogram (256,) with the levels, and every foreground: (h, w, 3) blue first.

    With `truth` (H, W), wrong pixels are orange.
    """
    scale = _PANEL_PX / max(image.shape)
    size = max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1)
    panels = [
        _titled(_resized(_coloured(image), size), "picture"),
        _titled(_histogram(counts, divided, size), "levels"),
    ]
    for item in divided:
        shown = _coloured(np.where(item.foreground, 255, 0).astype(np.uint8))
        if truth is not None:
            shown[item.foreground != truth] = _ORANGE
        panels.append(_titled(_resized(shown, size), f"{item.name} {item.level}"))
    gap = np.full((panels[0].shape[0], 8, 3), 255, np.uint8)
    return np.hstack([piece for panel in panels for piece in (panel, gap)][:-1])


def outline_overlay(
    image: ByteArray, contours_px: tuple[FloatArray, ...], corners_px: tuple[FloatArray, ...]
) -> ByteArray:
    """Contours (N, 2) and polygons through dominant points (K, 2) over a picture (H, W): (h, w, 3) blue first."""
    side = max(image.shape)
    scale = min(1.0, _OVERLAY_MAX_PX / side) if side >= 400 else float(np.ceil(400 / side))
    size = round(image.shape[1] * scale), round(image.shape[0] * scale)
    canvas = _resized(_coloured(image), size)
    for contour in contours_px:
        _polygon(canvas, contour, scale, _GREEN, 1)
    for corners in corners_px:
        _polygon(canvas, corners, scale, _ORANGE, 1)
        for x, y in _fixed(corners, scale, 0):
            cv2.circle(canvas, (int(x), int(y)), 3, _ORANGE, -1, cv2.LINE_AA)
    return canvas


def encoded_png(picture: ByteArray) -> bytes:
    """A picture (H, W) or (H, W, 3), blue first, as the content of a PNG file.

    Raises
    ------
    DataError : the picture is not one of bytes, or has another shape.
    """
    done, content = cv2.imencode(".png", picture)
    if not done:
        raise DataError(f"a picture of shape {picture.shape} cannot be written as PNG", cure="give bytes")
    return bytes(content)


def _coloured(image: ByteArray) -> ByteArray:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _resized(image: ByteArray, size: tuple[int, int]) -> ByteArray:
    method = cv2.INTER_AREA if size[0] < image.shape[1] else cv2.INTER_NEAREST
    return np.ascontiguousarray(cv2.resize(image, size, interpolation=method), dtype=np.uint8)


def _titled(panel: ByteArray, title: str) -> ByteArray:
    head = np.full((_TITLE_PX, panel.shape[1], 3), 255, np.uint8)
    cv2.putText(head, title, (2, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, _DARK, 1, cv2.LINE_AA)
    return np.vstack([head, panel])


def _histogram(counts: IntArray, divided: tuple[DividedPicture, ...], size: tuple[int, int]) -> ByteArray:
    """Root of the counts, so that a small class shows beside a large one."""
    width, height = size
    canvas = np.full((height, width, 3), _WHITE, np.uint8)
    tall = np.sqrt(counts / max(int(counts.max()), 1)) * (height - 4)
    x = np.linspace(0, width - 1, len(counts)).astype(int)
    for column, bar in zip(x.tolist(), tall.tolist(), strict=True):
        cv2.line(canvas, (column, height - 1), (column, height - 1 - round(bar)), _GREY, 2)
    for item in divided:
        cv2.line(canvas, (int(x[item.level]), 0), (int(x[item.level]), height - 1), _ORANGE, 1)
    return canvas


def _fixed(points: FloatArray, scale: float, bits: int) -> IntArray:
    """Points in pixels of the scaled picture, as whole numbers of 1 / 2^bits pixel."""
    return np.rint(((points + 0.5) * scale - 0.5) * (1 << bits)).astype(np.int64)


def _polygon(canvas: ByteArray, points: FloatArray, scale: float, colour: Colour, width: int) -> None:
    fixed = _fixed(points, scale, 3).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(canvas, [fixed], True, colour, width, cv2.LINE_AA, 3)
