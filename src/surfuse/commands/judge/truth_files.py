"""Truth from files: meshes and maps, in the frame of the world or of the part."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path

from surfuse.commands.maps.map_files import MESH_SUFFIXES, read_map
from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import transform_points
from surfuse.map_files.placement import placement_of
from surfuse.records import FloatArray, IntArray, MapGrid, SurfaceMap
from surfuse.surface.dense_score import dense_truth_of_map, dense_truth_of_mesh
from surfuse.surface.truth import read_truth_mesh, truth_around


class TruthFrame(StrEnum):
    """The frame of a truth file's coordinates.

    `WORLD`: that of the readings. `PART`: the part frame of the map. `AUTO`: what the file says, as those that surfuse
    exports do; the world for meshes of anyone else.
    """

    AUTO = "auto"
    WORLD = "world"
    PART = "part"


def read_truth(path: Path, grid: MapGrid, scale: float = 1.0, frame: TruthFrame = TruthFrame.AUTO) -> SurfaceMap:
    """Truth from a file: a mesh, or a map in any format that can be read, or a run folder.

    A mesh is seen on the grid, continued over the whole part. A map stays on its own grid.

    Raises
    ------
    DataError : it cannot be read, or is no truth.
    ConfigError : a scale for a map, which is in metres.
    """
    if is_mesh(path):
        vertices, triangles = truth_mesh(path, scale, frame, grid.world_from_part)
        return truth_around(vertices, triangles, grid)
    surface = read_map(path)
    if scale != 1.0:
        raise ConfigError(
            f"--scale {scale:g} for a map, which is in metres",
            cure="leave it out; it is for the numbers of a mesh",
            where=str(path),
        )
    if frame is not TruthFrame.PART:
        return surface
    return replace(surface, grid=replace(surface.grid, world_from_part=grid.world_from_part))


def dense_truth(path: Path, grid: MapGrid, scale: float = 1.0, frame: TruthFrame = TruthFrame.AUTO) -> SurfaceMap:
    """The same truth, sampled every millimetre in the part frame of the map.

    Raises
    ------
    DataError : it cannot be read, or is no truth.
    ConfigError : a scale for a map, which is in metres.
    """
    if is_mesh(path):
        return dense_truth_of_mesh(*truth_mesh(path, scale, frame, grid.world_from_part), grid)
    return dense_truth_of_map(read_truth(path, grid, scale, frame), grid)


def is_mesh(path: Path) -> bool:
    """Whether a truth file is a mesh, by its name."""
    return path.is_file() and path.suffix.lower() in MESH_SUFFIXES


def truth_mesh(
    path: Path,
    scale: float = 1.0,
    frame: TruthFrame = TruthFrame.AUTO,
    world_from_part: FloatArray | None = None,
) -> tuple[FloatArray, IntArray]:
    """Vertices (V, 3) in the world in m, triangles (F, 3), of a mesh file whose numbers are `scale` m.

    `world_from_part` (4, 4): the part frame of the map, for files in it that do not say where it lies.
    """
    vertices, triangles = read_truth_mesh(path)
    vertices = scale * vertices
    placed = world_from_part if frame is TruthFrame.PART else None
    if frame is TruthFrame.AUTO and (own := placement_of(path)) is not None:
        placed = world_from_part if own.world_from_part is None else own.world_from_part
    return (vertices if placed is None else transform_points(placed, vertices)), triangles


def frame_assumed(path: Path, frame: TruthFrame) -> str:
    """The frame in which a truth was taken, in words."""
    if frame is TruthFrame.PART:
        return "in the part frame of the map"
    says = frame is TruthFrame.AUTO and (not is_mesh(path) or placement_of(path) is not None)
    return "in the part frame that the file names" if says else "in the world, the frame of the readings"


def nothing_in_common(path: Path, frame: TruthFrame) -> DataError:
    """The error of a truth that lies elsewhere than the map."""
    other = TruthFrame.WORLD if frame is TruthFrame.PART else TruthFrame.PART
    unit = ", --scale 0.001 if it is in millimetres" if is_mesh(path) else ""
    return DataError(
        f"map and truth have no cell in common; the truth was taken {frame_assumed(path, frame)}",
        where=str(path),
        cure=f"try --truth-frame {other.value}{unit}",
    )
