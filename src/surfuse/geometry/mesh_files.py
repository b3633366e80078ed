"""Reading a mesh file of unknown origin: bounded, checked, never trusted."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh

from surfuse.errors import DataError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SUFFIXES = (".stl", ".ply", ".obj")
MOST_TRIANGLES = 2_000_000
MOST_BYTES = 512 * 1024 * 1024
_PLY_HEADER_BYTES = 64 * 1024
_STL_HEADER_BYTES = 84
_STL_TRIANGLE_BYTES = 50


@dataclass(frozen=True)
class TriangleSoup:
    """Vertices (V, 3) in the file's units, triangles (F, 3), and warnings that a user should see.

    `vertices_m` are in metres only if the file was: the caller scales them.
    """

    vertices_m: FloatArray
    triangles: IntArray
    warnings: tuple[str, ...]


def read_mesh(path: Path) -> TriangleSoup:
    """Triangles of an STL, PLY or OBJ file; equal vertices are merged.

    A mesh that is not watertight is accepted with a warning, because a sheet is a legal surface.

    Raises
    ------
    DataError : unreadable, empty, too large, vertices not finite, or indices out of range.
    """
    _check_size(path)
    _check_header(path)
    try:
        with path.open("rb") as stream:
            loaded = trimesh.load_mesh(stream, file_type=path.suffix.lower()[1:], process=False)
    # A foreign parser fed with foreign bytes may raise anything.
    except Exception as error:
        raise _unreadable(path, f"{type(error).__name__}: {error}") from error
    if not isinstance(loaded, trimesh.Trimesh):
        raise _unreadable(path, "no single triangle mesh in it")
    return _checked(path, loaded)


def _check_size(path: Path) -> None:
    try:
        size = path.stat().st_size
    except OSError as error:
        raise DataError(f"cannot open mesh file '{path}': {error.strerror}", cure="check the path") from error
    if not path.is_file():
        raise DataError(f"mesh file '{path}' is not a file", cure="give an STL, PLY or OBJ file")
    if size == 0:
        raise DataError(f"mesh file '{path}' is empty (0 bytes)", cure="export the mesh again")
    if size > MOST_BYTES:
        raise DataError(
            f"mesh file '{path}' has {size / 2**20:.0f} MiB, the limit is {MOST_BYTES / 2**20:.0f} MiB",
            cure=f"reduce the mesh to at most {MOST_TRIANGLES} triangles",
        )


def _check_header(path: Path) -> None:
    """Refuse counts that the file's size cannot hold, before anything is allocated for them."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(_PLY_HEADER_BYTES)
    if path.suffix.lower() == ".ply":
        for element, digits in re.findall(rb"element\s+(\w+)\s+(\d+)", head.split(b"end_header")[0]):
            count = int(digits)
            if count > size:
                raise _unreadable(path, f"it claims {count} of '{element.decode()}' in {size} bytes")
    is_ascii = head.lstrip().startswith(b"solid") and b"facet" in head
    if path.suffix.lower() == ".stl" and not is_ascii:
        count = int.from_bytes(head[80:84], "little") if len(head) >= _STL_HEADER_BYTES else -1
        if count < 0 or size < _STL_HEADER_BYTES + count * _STL_TRIANGLE_BYTES:
            raise _unreadable(path, f"its header claims {max(count, 0)} triangles in {size} bytes")


def _checked(path: Path, loaded: trimesh.Trimesh) -> TriangleSoup:
    vertices = np.asarray(loaded.vertices, dtype=np.float64)
    triangles = np.asarray(loaded.faces, dtype=np.int64)
    if len(triangles) == 0 or len(vertices) == 0:
        raise DataError(f"mesh file '{path}' has no triangles", cure="export a surface mesh, not points or lines")
    if len(triangles) > MOST_TRIANGLES:
        raise DataError(
            f"mesh file '{path}' has {len(triangles)} triangles, the limit is {MOST_TRIANGLES}",
            cure="reduce the mesh (quadric decimation)",
        )
    if not (triangles.min() >= 0 and triangles.max() < len(vertices)):
        raise _unreadable(path, f"a triangle names vertex {int(triangles.max())} of {len(vertices)}")
    used = vertices[triangles]
    if not np.all(np.isfinite(used)):
        raise DataError(
            f"mesh file '{path}' has {int(np.sum(~np.isfinite(used).all(axis=(1, 2))))} triangles with coordinates "
            "that are not finite",
            cure="repair or export the mesh again",
        )
    merged = trimesh.Trimesh(vertices, triangles, process=False)
    merged.merge_vertices()
    merged.remove_unreferenced_vertices()
    warnings: tuple[str, ...] = ()
    if not merged.is_watertight:
        warnings = (f"mesh file '{path}' is not watertight: taken as a sheet, seen alike from both sides",)
    return TriangleSoup(
        np.asarray(merged.vertices, dtype=np.float64), np.asarray(merged.faces, dtype=np.int64), warnings
    )


def _unreadable(path: Path, why: str) -> DataError:
    return DataError(
        f"mesh file '{path}' cannot be read: {why}", cure="export it again as STL, PLY or OBJ with triangles"
    )
