"""Writing a map's mesh through trimesh, atomically."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from surfuse.durable import write_bytes
from surfuse.map_files.placement import STL_HEADER_BYTES, placement_text, stl_header
from surfuse.map_files.triangles import MapMesh, mesh_of
from surfuse.records import SurfaceMap

MESH_NOT_READ = "a mesh keeps neither the nodes of the map nor its sigma"


def trimesh_of(mesh: MapMesh) -> trimesh.Trimesh:
    """The mesh as trimesh has it, vertices in the order of the map, with the layers as float32 vertex attributes."""
    return trimesh.Trimesh(
        vertices=mesh.vertices_m,
        faces=mesh.triangles,
        vertex_attributes={
            "confidence": mesh.confidence.astype(np.float32),
            "stderr": mesh.sigma_m.astype(np.float32),
            "measured": mesh.measured.astype(np.float32),
        },
        process=False,
    )


def write_mesh(path: Path, surface: SurfaceMap, file_type: str, overwrite: bool, with_prior: bool = False) -> None:
    """Write the measured cells of a map as a mesh file of trimesh's type `file_type`.

    A format that holds the layers may have the cells that only the prior fills, too: their vertices say so.

    Raises
    ------
    DataError : there is no cell to write.
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    mesh = trimesh_of(mesh_of(surface, with_prior))
    where = placement_text(surface.grid)
    if file_type == "glb":
        mesh.metadata["surfuse"] = where
    exported = mesh.export(file_type=file_type)
    content = exported.encode("utf-8") if isinstance(exported, str) else bytes(exported)
    if file_type == "obj":
        content = f"# {where}\n".encode() + content
    elif file_type == "stl":
        content = stl_header(surface.grid) + content[STL_HEADER_BYTES:]
    write_bytes(path, content, overwrite=overwrite)
