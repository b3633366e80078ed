"""Binary PLY: the map as a mesh in the part frame, metres; `confidence`, `stderr` and `measured` at the vertices.

Vertices that only the prior gives a height have `measured` 0 and are grey, the others are blue.

Written here and not by trimesh, which keeps positions as float32; PLY has doubles.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surfuse.durable import write_bytes
from surfuse.map_files.mesh_files import MESH_NOT_READ
from surfuse.map_files.placement import placement_text
from surfuse.map_files.triangles import mesh_of
from surfuse.records import SurfaceMap

MEASURED_RGB, PRIOR_RGB = (86, 180, 233), (150, 150, 150)
SUFFIXES = (".ply",)
SUMMARY = "PLY (binary): mesh with confidence, stderr and measured at the vertices"
NOT_READ = MESH_NOT_READ
MARKS_PRIOR = True


def write(path: Path, surface: SurfaceMap, overwrite: bool = False) -> None:
    """Write the mesh with its layers.

    Raises
    ------
    DataError : there is no cell to write.
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    mesh = mesh_of(surface, with_prior=True)
    vertex = np.empty(
        len(mesh.vertices_m),
        dtype=[
            *((name, "<f8") for name in "xyz"),
            ("confidence", "<f4"),
            ("stderr", "<f4"),
            *((name, "u1") for name in ("measured", "red", "green", "blue")),
        ],
    )
    vertex["x"], vertex["y"], vertex["z"] = mesh.vertices_m.T
    vertex["confidence"], vertex["stderr"] = mesh.confidence, mesh.sigma_m
    colour = np.where(mesh.measured[:, None], MEASURED_RGB, PRIOR_RGB)
    vertex["measured"] = mesh.measured
    vertex["red"], vertex["green"], vertex["blue"] = colour.T
    face = np.empty(len(mesh.triangles), dtype=[("n", "u1"), ("corner", "<i4", 3)])
    face["n"], face["corner"] = 3, mesh.triangles
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment surfuse map, part frame, metres\n"
        f"comment {placement_text(surface.grid)}\n"
        f"element vertex {len(vertex)}\nproperty double x\nproperty double y\nproperty double z\n"
        "property float confidence\nproperty float stderr\nproperty uchar measured\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        f"element face {len(face)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    write_bytes(path, header.encode("ascii") + vertex.tobytes() + face.tobytes(), overwrite=overwrite)
