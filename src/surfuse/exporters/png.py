"""PNG with 16-bit heights: a picture that programs and people can look at; 0 is a cell that was not measured.

The scale stands in the text chunk `surfuse` (JSON): `w_m = w_min_m + (grey - 1) * w_step_m`, steps and origin of the
grid in metres. The first line of the picture is the highest v, so that up is up. PNG: ISO/IEC 15948.
"""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np

from surfuse.durable import write_bytes
from surfuse.map_files.heights import equal_step, heights_or_nan
from surfuse.records import SurfaceMap

SUFFIXES = (".png",)
SUMMARY = "PNG: 16-bit heights with the scale in a text chunk"
NOT_READ = "a picture of heights keeps neither sigma nor the part frame"
MARKS_PRIOR = False
_LEVELS = 65534


def write(path: Path, surface: SurfaceMap, overwrite: bool = False) -> None:
    """Write the heights, from 1 (lowest) to 65535 (highest).

    Raises
    ------
    DataError : the steps of the map are not equal, or no cell was measured.
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    heights, kept = heights_or_nan(surface), surface.measured
    du, dv = equal_step(surface.grid.u_m, "u"), equal_step(surface.grid.v_m, "v")
    measured = heights[kept]
    low = float(measured.min())
    step = (float(measured.max()) - low) / _LEVELS or 1e-9
    grey = np.zeros(kept.shape, dtype=">u2")
    grey[kept] = np.round((measured - low) / step) + 1
    scale = {
        "w_min_m": low,
        "w_step_m": step,
        "u_min_m": float(surface.grid.u_m[0]),
        "u_step_m": du,
        "v_min_m": float(surface.grid.v_m[0]),
        "v_step_m": dv,
        "method": surface.method,
    }
    write_bytes(path, _png(np.flipud(grey), json.dumps(scale)), overwrite=overwrite)


def _png(grey: np.ndarray[tuple[int, ...], np.dtype[np.uint16]], text: str) -> bytes:
    rows, columns = grey.shape
    lines = b"".join(b"\0" + grey[r].tobytes() for r in range(rows))
    head = struct.pack(">IIBBBBB", columns, rows, 16, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        _chunk(kind, content)
        for kind, content in (
            (b"IHDR", head),
            (b"tEXt", b"surfuse\0" + text.encode("ascii")),
            (b"IDAT", zlib.compress(lines, 9)),
            (b"IEND", b""),
        )
    )


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
