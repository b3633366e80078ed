"""Wavefront OBJ: the measured cells as a mesh in the part frame, in metres; geometry only.

Cells that only the prior fills are left out: the format cannot mark them.
"""

from __future__ import annotations

from pathlib import Path

from surfuse.map_files.mesh_files import MESH_NOT_READ, write_mesh
from surfuse.records import SurfaceMap

SUFFIXES = (".obj",)
SUMMARY = "OBJ: for 3-D programs; geometry only"
NOT_READ = MESH_NOT_READ
MARKS_PRIOR = False


def write(path: Path, surface: SurfaceMap, overwrite: bool = False) -> None:
    """Write the mesh; see `write_mesh`.

    Raises
    ------
    DataError : there is no cell to write.
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    write_mesh(path, surface, "obj", overwrite)
