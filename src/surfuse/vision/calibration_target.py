"""Finding a calibration target in a picture: its corners, which ones they are, and how sharp they look."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np
import numpy.typing as npt

from surfuse.errors import ConfigError, DataError, nearest
from surfuse.geometry.poses import pose
from surfuse.records import ByteArray, CameraModel, FloatArray, IntArray

Pattern = Literal["checkerboard", "charuco"]
PATTERNS: tuple[Pattern, ...] = get_args(Pattern)
DICTIONARY = cv2.aruco.DICT_4X4_250
MARKER_SHARE = 0.75
_CORNERS_MIN = 6
_ACROSS = np.linspace(-0.4, 0.4, 41)
_ALONG = np.linspace(-0.2, 0.2, 5)


@dataclass(frozen=True)
class Target:
    """A flat board of `columns` x `rows` squares (not inner corners), each `square_m` wide.

    A `charuco` board has markers of OpenCV's dictionary 4X4_250 in its bright squares, three quarters of a square wide.
    """

    pattern: Pattern
    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        if self.pattern not in PATTERNS:
            raise ConfigError(f"unknown pattern '{self.pattern}'", cure=nearest(self.pattern, PATTERNS))
        if not (min(self.columns, self.rows) >= 4 and max(self.columns, self.rows) <= 100):
            raise ConfigError(
                f"a board of {self.columns} x {self.rows} squares", cure="give 4 to 100 squares in each direction"
            )
        if self.pattern == "charuco" and self.columns * self.rows // 2 > 250:
            raise ConfigError(
                f"a charuco board of {self.columns} x {self.rows} squares has more than 250 markers",
                cure="give at most 500 squares",
            )
        if not (self.square_m > 0.0 and math.isfinite(self.square_m)):
            raise ConfigError(f"square of {1e3 * self.square_m:g} mm", cure="give a length > 0")

    @property
    def inner(self) -> tuple[int, int]:
        """Inner corners in a row, and in a column."""
        return self.columns - 1, self.rows - 1

    def points(self) -> FloatArray:
        """Inner corners (K, 3), row after row, in the frame of the board: x right, y down, z into it, m."""
        y, x = np.mgrid[1 : self.rows, 1 : self.columns]
        return self.square_m * np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(np.float64)


@dataclass(frozen=True)
class TargetView:
    """A target seen: inner corners (K, 2) px with their numbers (K,), and the width of its edges in pixels.

    `name` is that of the picture. Corners are x, y; a corner's number says which of the target's it
    is.
    """

    name: str
    corners_px: FloatArray
    numbers: IntArray
    edge_px: float


@dataclass(frozen=True)
class NotSeen:
    """A picture without a usable target, and why.

    `name` is that of the picture; the reason is a sentence for a person.
    """

    name: str
    reason: str


def look_for(target: Target, image: ByteArray, name: str) -> TargetView | NotSeen:
    """Find the target in a picture (H, W)."""
    found = _corners(target, image)
    if found is None:
        if target.pattern == "charuco" and _corners(target, np.ascontiguousarray(image[:, ::-1])) is not None:
            return NotSeen(name, "mirrored: the markers can only be read in a mirror")
        return NotSeen(name, f"no {target.pattern} of {target.columns} x {target.rows} squares found")
    corners, numbers = found
    return TargetView(name, corners, numbers, _edge_width(image, target, corners, numbers))


def camera_from_target(camera: CameraModel, target: Target, view: TargetView) -> FloatArray:
    """Pose (4, 4) of a target in the camera that sees it.

    Raises
    ------
    DataError : no pose puts the target's corners where they were seen.
    """
    points = target.points()[view.numbers]
    done, turn, place = cv2.solvePnP(points, view.corners_px, camera.matrix, np.array(camera.distortion))
    if not done:
        raise DataError("the target's pose cannot be found", cure="remove the picture", where=view.name)
    return pose(cv2.Rodrigues(turn)[0], np.ravel(place))


def _corners(target: Target, image: ByteArray) -> tuple[FloatArray, IntArray] | None:
    if target.pattern == "checkerboard":
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        seen, corners = cv2.findChessboardCornersSB(image, target.inner, flags=flags)
        if not seen:
            return None
        placed = _upright(_refined(image, np.asarray(corners, dtype=np.float32)))
        return placed, np.arange(len(placed))
    size = target.columns, target.rows
    words = cv2.aruco.getPredefinedDictionary(DICTIONARY)
    board = cv2.aruco.CharucoBoard(size, target.square_m, MARKER_SHARE * target.square_m, words)
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
    if numbers is None or len(numbers) < _CORNERS_MIN:
        return None
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2), np.asarray(numbers, dtype=np.int64).ravel()


def _refined(image: ByteArray, corners: npt.NDArray[np.float32]) -> FloatArray:
    """Corners (N, 2) where the gradients around them meet: the detector alone is biased on pixels that are not square.

    The window stays inside the squares around a corner.
    """
    flat = np.ascontiguousarray(corners).reshape(-1, 1, 2)
    nearest_px = float(np.linalg.norm(np.diff(flat[:, 0], axis=0), axis=1).min())
    half = max(int(0.35 * nearest_px), 2)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    refined = cv2.cornerSubPix(image, flat.copy(), (min(half, 11), min(half, 11)), (-1, -1), stop)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def _upright(corners: FloatArray) -> FloatArray:
    """A checkerboard looks the same upside down: the first corner is the one further up (or left) in the picture."""
    down = corners[-1] - corners[0]
    return corners if down[1] > 0.0 or (down[1] == 0.0 and down[0] > 0.0) else corners[::-1].copy()


def _edge_width(image: ByteArray, target: Target, corners: FloatArray, numbers: IntArray) -> float:
    """Median width in pixels of the edges between neighbouring corners: step height by steepest slope.

    A blur of standard deviation s makes an edge 2.5 s wide.
    """
    place = dict(zip(numbers.tolist(), corners, strict=True))
    columns, _ = target.inner
    pairs = [
        (place[a], place[b])
        for a in place
        for b, neighbours in ((a + 1, (a + 1) % columns != 0), (a + columns, True))
        if neighbours and b in place
    ]
    if not pairs:
        return math.inf
    widths = [_width_between(image, a, b) for a, b in pairs]
    return float(np.median(widths))


def _width_between(image: ByteArray, a: FloatArray, b: FloatArray) -> float:
    along = b - a
    across = np.array([-along[1], along[0]])
    points = 0.5 * (a + b) + _ALONG[:, None, None] * along + _ACROSS[None, :, None] * across
    x, y = points[..., 0].astype(np.float32), points[..., 1].astype(np.float32)
    profile = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64).mean(axis=0)
    step_px = float(np.linalg.norm(across)) * float(_ACROSS[1] - _ACROSS[0])
    slope = float(np.abs(np.diff(profile)).max()) / step_px
    return float(np.ptp(profile)) / slope if slope > 0.0 else math.inf
