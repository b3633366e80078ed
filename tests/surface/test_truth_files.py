from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from surfuse.errors import DataError
from surfuse.surface.truth import read_truth_mesh

SQUARE = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.02], [0.0, 0.1, 0.02]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj", "off"])
def test_meshes_are_read_in_the_files_own_unit(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"part.{suffix}"
    trimesh.Trimesh(SQUARE, FACES, process=False).export(path)
    vertices, faces = read_truth_mesh(path)
    np.testing.assert_allclose(vertices[faces], SQUARE[FACES], atol=1e-7)


@pytest.mark.parametrize(
    "name", ["missing.ply", "garbage.ply", "garbage.stl", "empty.obj", "text.xyz123", "folder.ply"]
)
def test_what_is_no_mesh_is_refused_with_its_path(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name.startswith("garbage"):
        path.write_bytes(b"\x00\x01garbage" * 40)
    elif name.startswith(("empty", "text")):
        path.write_text("")
    elif name.startswith("folder"):
        path.mkdir()
    with pytest.raises(DataError, match=name):
        read_truth_mesh(path)


def test_a_mesh_of_nan_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "part.ply"
    trimesh.Trimesh(np.where(SQUARE > 0.05, np.nan, SQUARE), FACES, process=False).export(path)
    with pytest.raises(DataError, match="finite"):
        read_truth_mesh(path)
