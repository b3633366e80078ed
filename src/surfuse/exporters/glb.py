"""GLB (binary glTF): the measured cells as a mesh in the part frame, metres.

The vertices carry `_confidence` and `_stderr`.
"""

from __future__ import annotations

from pathlib import Path

from surfuse.exporters.map_layers.mesh_files import write_mesh
from surfuse.records import SurfaceMap

SUFFIXES = (".glb",)
SUMMARY = "GLB: for web viewers and 3-D programs; layers as vertex attributes"


def write(path: Path, surface: SurfaceMap, overwrite: bool = False) -> None:
    """Write the mesh; see `write_mesh`.

    Raises
    ------
    DataError : there is no cell to write.
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    write_mesh(path, surface, "glb", overwrite)
