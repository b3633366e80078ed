"""Thresholds compared on any picture, against a reference mask where there is one."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from surfuse.commands.outcome import Outcome
from surfuse.commands.pictures.picture_output import check_output
from surfuse.durable import write_bytes
from surfuse.errors import DataError, UsageError, nearest
from surfuse.records import BoolArray, ByteArray
from surfuse.vision.drawing import DividedPicture, encoded_png, side_by_side
from surfuse.vision.measures import check_size, foreground_area_error, misclassification_error, region_non_uniformity
from surfuse.vision.part_finder import FindParameters
from surfuse.vision.picture import read_picture
from surfuse.vision.polarity import Polarity, foreground, named_polarity
from surfuse.vision.threshold import METHODS, histogram
from surfuse.vision.threshold import threshold as divide

ALL = "all"
_TIMED_RUNS = 5
_TIMED_S = 0.05


@dataclass(frozen=True)
class Division:
    """What one method made of one picture; the two errors need a reference mask and are None without one."""

    method: str
    threshold: int
    separability: float
    misclassification_error: float | None
    foreground_area_error: float | None
    region_non_uniformity: float
    foreground_share: float
    ms: float


def compare(
    image: ByteArray, methods: tuple[str, ...], polarity: Polarity, truth: BoolArray | None
) -> tuple[tuple[Division, ...], tuple[DividedPicture, ...]]:
    """Divide a picture (H, W) by several methods; times are the best of a few runs on the whole picture."""
    rows, pictures = [], []
    for method in methods:
        divided, ms = divide(image, method), _best_ms(image, method)
        found = foreground(image, divided.level, polarity)
        rows.append(
            Division(
                method=method,
                threshold=divided.level,
                separability=divided.separability,
                misclassification_error=None if truth is None else misclassification_error(found, truth),
                foreground_area_error=None if truth is None else foreground_area_error(found, truth),
                region_non_uniformity=region_non_uniformity(image, found),
                foreground_share=float(found.mean()),
                ms=ms,
            )
        )
        pictures.append(DividedPicture(method, divided.level, found))
    return tuple(rows), tuple(pictures)


def threshold(
    image: Path,
    method: str = ALL,
    mask: Path | None = None,
    out: Path | None = None,
    polarity: str = "auto",
    force: bool = False,
) -> Outcome:
    """Compare the thresholds of a picture file, against a reference mask (non-zero is the part) where there is one.

    With `out` a PNG file shows picture, histogram and foregrounds side by side.

    Raises
    ------
    UsageError : no such method, or `out` is not a PNG file.
    ConfigError : no such polarity.
    DataError : a file that is no usable picture, or a mask of another size.
    StorageError : `out` exists and `force` is not given.
    """
    if method != ALL and method not in METHODS:
        raise UsageError(f"unknown threshold method '{method}'", cure=nearest(method, (*METHODS, ALL)))
    side = named_polarity(polarity)
    check_output(out, ".png", force, image)
    picture = read_picture(image)
    truth = _read_mask(mask, picture) if mask is not None else None
    rows, divided = compare(picture, tuple(METHODS) if method == ALL else (method,), side, truth)
    if out is not None:
        write_bytes(out, encoded_png(side_by_side(picture, histogram(picture), divided, truth)), overwrite=force)
    summary: dict[str, object] = {
        "image": str(image),
        "width_px": picture.shape[1],
        "height_px": picture.shape[0],
        "mask": None if mask is None else str(mask),
        "polarity": polarity,
        "methods": [asdict(row) for row in rows],
        "picture": None if out is None else str(out),
    }
    table = [("method", "level  separable  misclassified  area error  non-uniform  ms")]
    table += [(row.method, _row(row)) for row in rows]
    if all(row.separability < FindParameters().separability_min for row in rows):
        table.append(("note", "the picture has no two classes of grey levels: these thresholds mean nothing"))
    return Outcome(summary, table + ([("picture", str(out))] if out is not None else []))


def _read_mask(mask: Path, picture: ByteArray) -> BoolArray:
    values: BoolArray = np.asarray(read_picture(mask) > 0)
    try:
        check_size(values, picture)
    except DataError as error:
        raise DataError(error.what, cure=error.cure, where=str(mask)) from error
    return values


def _best_ms(image: ByteArray, method: str) -> float:
    times: list[float] = []
    while len(times) < _TIMED_RUNS and sum(times) < _TIMED_S:
        start = time.perf_counter()
        divide(image, method)
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def _row(row: Division) -> str:
    def share(value: float | None, width: int) -> str:
        return f"{'-' if value is None else f'{value:.4f}':>{width}}"

    return (
        f"{row.threshold:5d}  {share(row.separability, 9)}  {share(row.misclassification_error, 13)}  "
        f"{share(row.foreground_area_error, 10)}  {share(row.region_non_uniformity, 11)}  {row.ms:.2f}"
    )
