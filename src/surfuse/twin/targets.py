"""Calibration targets as geometry: every dark or bright tile is a flat piece of the board, no texture is needed.

Frame of a target: origin in its upper left outer corner (border not counted), x to the right, y down, z into the board.
"""

from __future__ import annotations

import cv2
import numpy as np

from surfuse.errors import ConfigError
from surfuse.records import BoolArray, FloatArray
from surfuse.twin.materials import Material
from surfuse.twin.scene import SceneBody

MARKER_CELLS = 6
SQUARE_CELLS = 8


def checkerboard(columns: int, rows: int) -> BoolArray:
    """Dark squares (rows, columns) of a checkerboard; the upper left one is dark."""
    y, x = np.mgrid[:rows, :columns]
    return np.asarray((x + y) % 2 == 0)


def charuco(columns: int, rows: int, dictionary: int) -> BoolArray:
    """Dark cells (8 rows, 8 columns) of a ChArUco board, its markers three quarters of a square (OpenCV's layout).

    `dictionary` is one of OpenCV's with 4 x 4 bits.
    """
    board = np.kron(checkerboard(columns, rows), np.ones((SQUARE_CELLS, SQUARE_CELLS), dtype=bool))
    words = cv2.aruco.getPredefinedDictionary(dictionary)
    edge = (SQUARE_CELLS - MARKER_CELLS) // 2
    for number, (row, column) in enumerate(np.argwhere(~checkerboard(columns, rows)).tolist()):
        bits = np.asarray(cv2.aruco.generateImageMarker(words, number, MARKER_CELLS)) < 128
        top, left = SQUARE_CELLS * row + edge, SQUARE_CELLS * column + edge
        board[top : top + MARKER_CELLS, left : left + MARKER_CELLS] = bits
    return board


def target_bodies(
    dark: BoolArray, cell_m: float, world_from_target: FloatArray, border_m: float = 0.0
) -> tuple[SceneBody, ...]:
    """The board of dark and bright cells (R, C) with a bright border around it, as one body for each colour.

    Raises
    ------
    ConfigError : the cells have no size.
    """
    if not (cell_m > 0.0 and border_m >= 0.0):
        raise ConfigError(f"target with cells of {cell_m} m, border {border_m} m", cure="give cells > 0, border >= 0")
    rows, columns = dark.shape
    dim = [(x * cell_m, y * cell_m, cell_m, cell_m) for y, x in np.argwhere(dark).tolist()]
    bright = [(x * cell_m, y * cell_m, cell_m, cell_m) for y, x in np.argwhere(~dark).tolist()]
    if border_m > 0.0:
        width, height = columns * cell_m, rows * cell_m
        bright += [
            (-border_m, -border_m, width + 2.0 * border_m, border_m),
            (-border_m, height, width + 2.0 * border_m, border_m),
            (-border_m, 0.0, border_m, height),
            (width, 0.0, border_m, height),
        ]
    tiles = [_quads(*np.array(part, dtype=np.float64).reshape(-1, 4).T) for part in (dim, bright)]
    materials = (Material.FLOOR, Material.PART)
    return tuple(
        SceneBody(vertices, np.arange(len(vertices)).reshape(-1, 3), material, world_from_target)
        for vertices, material in zip(tiles, materials, strict=True)
    )


def _quads(x: FloatArray, y: FloatArray, width: FloatArray, height: FloatArray) -> FloatArray:
    """Corners (6 N, 3) of two triangles for each of N rectangles in the plane z = 0."""
    corner = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    flat = np.stack([np.column_stack([*corner[i], np.zeros(len(x))]) for i in (0, 2, 1, 0, 3, 2)], axis=1)
    return np.asarray(flat.reshape(-1, 3))
