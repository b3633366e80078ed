"""Pictures from files and arrays as grey bytes, or one clear error."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError
from surfuse.records import ByteArray, FloatArray

SIDE_MIN_PX = 8
PIXELS_MAX = 100_000_000
_PNG, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND"
_JPEG, _JPEG_END = b"\xff\xd8", b"\xff\xd9"


def read_picture(path: Path) -> ByteArray:
    """Read an image file as grey bytes (H, W); colour, transparency, 16 bit and float are converted by `grey`.

    Raises
    ------
    DataError : no such file, not an image, cut short, smaller than 8 pixels on a side, larger than 100 Mpx, or with
        values that are not finite.
    """
    where = str(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DataError(
            f"cannot read the picture ({error.strerror})", cure="give the path of an image file", where=where
        ) from error
    _check_ends(content, where)
    try:
        decoded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED) if content else None
    except cv2.error as error:
        raise DataError(
            f"the picture cannot be decoded ({str(error.err).strip()})", cure="save it again", where=where
        ) from error
    if decoded is None:
        raise DataError(
            f"not a picture that can be read ({len(content)} bytes)", cure="give a PNG, JPEG, TIFF or BMP", where=where
        )
    try:
        return grey(np.asarray(decoded))
    except DataError as error:
        raise DataError(error.what, cure=error.cure, where=where) from error


def grey(picture: npt.NDArray[np.generic]) -> ByteArray:
    """Grey bytes (H, W) of an array (H, W) or (H, W, 1 | 3 | 4), blue first, of bool, integers or floats.

    Bytes keep their values; anything else is stretched from its smallest to its largest value. Colour becomes luma.
    Transparent places show black or white, whichever is farther from the mean of what is visible.

    Raises
    ------
    DataError : the array has another shape, or is smaller or larger than a picture may be.
    """
    if picture.ndim == 3 and picture.shape[2] == 1:
        picture = picture[:, :, 0]
    if picture.ndim not in (2, 3) or (picture.ndim == 3 and picture.shape[2] not in (3, 4)):
        raise DataError(f"an array of shape {picture.shape} is not a picture", cure="give (H, W) or (H, W, 3 or 4)")
    height, width = picture.shape[:2]
    _check_size(width, height)
    values = _stretched(picture)
    if values.ndim == 2:
        return values
    luma = np.asarray(cv2.cvtColor(np.ascontiguousarray(values[:, :, :3]), cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    return luma if values.shape[2] == 3 else _on_contrast(luma, values[:, :, 3])


def _check_size(width: int, height: int, where: str = "") -> None:
    if min(width, height) < SIDE_MIN_PX:
        raise DataError(
            f"a picture of {width} x {height} pixels is too small",
            cure=f"give at least {SIDE_MIN_PX} on a side",
            where=where,
        )
    if width * height > PIXELS_MAX:
        raise DataError(
            f"a picture of {width} x {height} pixels is larger than {PIXELS_MAX // 1_000_000} Mpx",
            cure="crop it or scale it down",
            where=where,
        )


def _check_ends(content: bytes, where: str) -> None:
    """Refuse files that are cut short (decoders fill them up with grey), and absurd sizes, before decoding."""
    if content.startswith(_PNG) and len(content) >= 24:
        _check_size(int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big"), where)
    cut = (content.startswith(_PNG) and _PNG_END not in content[-64:]) or (
        content.startswith(_JPEG) and _JPEG_END not in content[-1024:]
    )
    if cut:
        raise DataError(f"the picture ends after {len(content)} bytes, too early", cure="copy it again", where=where)


def _stretched(picture: npt.NDArray[np.generic]) -> ByteArray:
    if picture.dtype == np.uint8:
        return np.ascontiguousarray(picture, dtype=np.uint8)
    if picture.dtype.kind not in "buif":
        raise DataError(f"a picture of {picture.dtype} values cannot be read", cure="give numbers")
    values: FloatArray = picture.astype(np.float64)
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise DataError(f"{bad} values of the picture are not finite", cure="replace them before")
    colour = values[:, :, :3] if values.ndim == 3 else values
    low, high = float(colour.min()), float(colour.max())
    scaled = (values - low) * (255.0 / (high - low)) if high > low else np.zeros_like(values)
    if values.ndim == 3 and values.shape[2] == 4:
        top = float(2 ** (8 * picture.dtype.itemsize) - 1) if picture.dtype.kind in "ui" else 1.0
        scaled[:, :, 3] = values[:, :, 3] * (255.0 / top)
    return np.clip(np.rint(scaled), 0.0, 255.0).astype(np.uint8)


def _on_contrast(luma: ByteArray, alpha: ByteArray) -> ByteArray:
    opacity: FloatArray = alpha.astype(np.float64) / 255.0
    weight = float(opacity.sum())
    mean = float((luma * opacity).sum()) / weight if weight > 0.0 else 255.0
    ground = 0.0 if mean >= 128.0 else 255.0
    return np.rint(luma * opacity + ground * (1.0 - opacity)).astype(np.uint8)
