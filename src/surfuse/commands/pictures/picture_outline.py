"""Parts of any picture outlined by dominant points, written in metres."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse.commands.outcome import Outcome
from surfuse.commands.pictures.picture_output import check_output
from surfuse.durable import write_bytes, write_text
from surfuse.errors import DataError, UsageError
from surfuse.geometry.polygons import counter_clockwise, perimeter, signed_area
from surfuse.geometry.untangling import untangled
from surfuse.records import ByteArray, Detection, FloatArray
from surfuse.vision.dominant_points import DominantPointParameters, dominant_points
from surfuse.vision.drawing import encoded_png, outline_overlay
from surfuse.vision.part_finder import find_regions
from surfuse.vision.picture import read_picture

_LOOPS_MAX = 0.1


@dataclass(frozen=True)
class _Ring:
    """One closed polygon of a part: which part, 0 for its outer boundary and 1, 2, ... for holes; corners (K, 2) px."""

    part: int
    number: int
    corners_px: FloatArray


def outline(
    image: Path,
    scale_mm_per_px: float,
    out: Path,
    tolerance_px: float = 1.5,
    force: bool = False,
    all_parts: bool = False,
    cut: bool = False,
) -> Outcome:
    """Outline the largest part of a picture file, or all parts with their holes, by dominant points.

    `out` has columns u,v in metres, v up, origin in the lower left corner of the bounding box; with `all_parts` also
    part and ring (0 the outer boundary, then holes), and one origin for all. A PNG of the same name shows it. A part
    that the picture's border cuts is refused, or left out of all parts, unless `cut` allows it.

    Raises
    ------
    UsageError : scale or `out` cannot be used.
    DataError : a file that is no usable picture, nothing found, cut by the border, or an outline that crosses itself.
    StorageError : an output file exists and `force` is not given.
    """
    if not (scale_mm_per_px > 0.0 and np.isfinite(scale_mm_per_px)):
        raise UsageError(f"scale {scale_mm_per_px} mm per pixel", cure="give a length > 0")
    overlay = out.with_suffix(".png")
    check_output(out, ".csv", force, image)
    check_output(overlay, ".png", force, image)
    picture = read_picture(image)
    parts, left_out = _parts(picture, image, all_parts, cut)
    rings = [ring for index, part in enumerate(parts) for ring in _rings(part, index, tolerance_px, all_parts)]
    to_m = 1e-3 * scale_mm_per_px
    metres = _in_metres([ring.corners_px for ring in rings], to_m)
    write_text(out, _csv(rings, metres, all_parts), overwrite=force)
    contours = tuple(contour for part in parts for contour in (part.contour_px, *part.holes_px))
    drawn = outline_overlay(picture, contours, tuple(ring.corners_px for ring in rings))
    write_bytes(overlay, encoded_png(drawn), overwrite=force)
    summary: dict[str, object] = {
        "image": str(image),
        "outline": str(out),
        "overlay": str(overlay),
        "scale_mm_per_px": scale_mm_per_px,
        "left_out_at_border": left_out,
        "parts": [_described(part, index, rings, metres) for index, part in enumerate(parts)],
    }
    return Outcome(summary, _outline_table(parts, rings, metres, left_out, out, overlay))


def _parts(picture: ByteArray, where: Path, all_parts: bool, cut: bool) -> tuple[tuple[Detection, ...], int]:
    """The parts to outline, and how many were left out because the border cuts them."""
    found = find_regions(picture)
    if not found:
        raise DataError(
            "nothing stands out from what is behind it",
            cure="give a picture with one bright or dark part on an even background; 'surfuse threshold' shows more",
            where=str(where),
        )
    whole = tuple(part for part in found if cut or not part.touches_border)
    wanted = whole if all_parts else tuple(part for part in whole if part is found[0])
    if not wanted:
        raise DataError(
            "the part touches the border of the picture, so its outline is not complete",
            cure="take the picture from farther away, or allow it with --cut",
            where=str(where),
        )
    return wanted, len(found) - len(whole) if all_parts else 0


def _rings(part: Detection, index: int, tolerance_px: float, with_holes: bool) -> list[_Ring]:
    contours = [part.contour_px, *(part.holes_px if with_holes else ())]
    return [_Ring(index, number, _corners(contour, tolerance_px)) for number, contour in enumerate(contours)]


def _corners(contour_px: FloatArray, tolerance_px: float) -> FloatArray:
    """Dominant points (K, 2) of a closed contour, without the loops that noise ties into narrow notches."""
    corners = dominant_points(contour_px, DominantPointParameters(tolerance_px=tolerance_px)).points_px
    kept = corners[untangled(corners)]
    if len(kept) < 3 or perimeter(kept) < (1.0 - _LOOPS_MAX) * perimeter(corners):
        raise DataError(
            f"the outline of {len(corners)} dominant points crosses itself",
            cure="take a sharper or larger picture of the part, or give another --tolerance",
        )
    return kept


def _in_metres(corners_px: list[FloatArray], to_m: float) -> list[FloatArray]:
    """The same corners with v up, from the lower left corner of their bounding box, counter-clockwise."""
    flat = [corners * [to_m, -to_m] for corners in corners_px]
    low = np.min([corners.min(axis=0) for corners in flat], axis=0)
    return [counter_clockwise(corners - low) for corners in flat]


def _csv(rings: list[_Ring], metres: list[FloatArray], numbered: bool) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["u", "v", "part", "ring"] if numbered else ["u", "v"])
    for ring, corners in zip(rings, metres, strict=True):
        for u, v in corners.tolist():
            place = [f"{u + 0.0:.7f}", f"{v + 0.0:.7f}"]
            writer.writerow([*place, ring.part, ring.number] if numbered else place)
    return text.getvalue()


def _described(part: Detection, index: int, rings: list[_Ring], metres: list[FloatArray]) -> dict[str, object]:
    own = [(ring, corners) for ring, corners in zip(rings, metres, strict=True) if ring.part == index]
    outer = own[0][1]
    width, height = np.ptp(outer, axis=0).tolist()
    return {
        "dominant_points": len(outer),
        "width_m": width,
        "height_m": height,
        "area_m2": signed_area(outer) - sum(signed_area(hole) for _, hole in own[1:]),
        "holes": len(own) - 1 if len(own) > 1 else len(part.holes_px),
        "threshold": part.level,
        "separability": part.separability,
        "confidence": part.confidence,
        "touches_border": part.touches_border,
    }


def _outline_table(
    parts: tuple[Detection, ...],
    rings: list[_Ring],
    metres: list[FloatArray],
    left_out: int,
    out: Path,
    overlay: Path,
) -> list[tuple[str, str]]:
    table = []
    for ring, corners in zip(rings, metres, strict=True):
        width, height = (1e3 * np.ptp(corners, axis=0)).tolist()
        label = f"part {ring.part + 1}" if ring.number == 0 else f"part {ring.part + 1}, hole {ring.number}"
        table.append((label, f"{width:.2f} x {height:.2f} mm, {len(corners)} dominant points"))
    if left_out:
        table.append(("left out", f"{left_out} cut by the border of the picture"))
    if any(part.touches_border for part in parts):
        table.append(("note", "a part touches the border of the picture: its outline is not complete"))
    return [*table, ("outline", str(out)), ("overlay", str(overlay))]
