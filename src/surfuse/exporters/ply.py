"""Binary PLY: the measured cells as a mesh in the part frame, metres; `confidence` and `stderr` at the vertices.

Written here and not by trimesh, which keeps positions as float32; PLY has doubles.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surfuse.durable import write_bytes
from surfuse.exporters.map_layers.triangles import mesh_of
from surfuse.records import SurfaceMap

SUFFIXES = (".ply",)
SUMMARY = "PLY (binary): mesh with confidence and stderr at the vertices"


def write(path: Path, surface: SurfaceMap, overwrite: bool = False) -> None:
    """Write the mesh with its layers.

    Raises
    ------
    DataError : there is no cell to write.
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    mesh = mesh_of(surface)
    vertex = np.empty(
        len(mesh.vertices_m),
        dtype=[("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("confidence", "<f4"), ("stderr", "<f4")],
    )
    vertex["x"], vertex["y"], vertex["z"] = mesh.vertices_m.T
    vertex["confidence"], vertex["stderr"] = mesh.confidence, mesh.sigma_m
    face = np.empty(len(mesh.triangles), dtype=[("n", "u1"), ("corner", "<i4", 3)])
    face["n"], face["corner"] = 3, mesh.triangles
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment surfuse map, part frame, metres\n"
        f"element vertex {len(vertex)}\nproperty double x\nproperty double y\nproperty double z\n"
        "property float confidence\nproperty float stderr\n"
        f"element face {len(face)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    write_bytes(path, header.encode("ascii") + vertex.tobytes() + face.tobytes(), overwrite=overwrite)
