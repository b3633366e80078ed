"""GLB (binary glTF): the map as a mesh in the part frame, metres.

The vertices carry `_confidence`, `_stderr` and `_measured` (0: only the prior gives the height).
"""

from __future__ import annotations

from pathlib import Path

from surfuse.map_files.mesh_files import MESH_NOT_READ, write_mesh
from surfuse.records import SurfaceMap

SUFFIXES = (".glb",)
SUMMARY = "GLB: for web viewers and 3-D programs; layers as vertex attributes"
NOT_READ = MESH_NOT_READ
MARKS_PRIOR = True


def write(path: Path, surface: SurfaceMap, overwrite: bool = False) -> None:
    """Write the mesh; see `write_mesh`.

    Raises
    ------
    DataError : there is no cell to write.
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    write_mesh(path, surface, "glb", overwrite, with_prior=True)
