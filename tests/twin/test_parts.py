import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from surfuse.errors import ConfigError, DataError
from surfuse.geometry import mesh_files
from surfuse.twin.parts import SCENES, PartPose, make_part
from surfuse.twin.scene import TableParameters


def bounds(name: str | Path, **pose: float) -> np.ndarray:
    vertices, _ = make_part(name, replace(PartPose(), **pose)).mesh()
    return np.array([vertices.min(axis=0), vertices.max(axis=0)])


@pytest.mark.parametrize("name", SCENES)
def test_the_papers_parts_are_closed_and_stand_on_the_table(name: str) -> None:
    vertices, triangles = make_part(name).mesh()
    mesh = trimesh.Trimesh(vertices, triangles)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx({"relief": 2.0e-3}.get(name, 0.2e-3))
    assert mesh.bounds[0] == pytest.approx([1.10, mesh.bounds[0][1], 1.0])
    assert mesh.bounds[1][2] == pytest.approx(1.20)


def test_the_tilted_plate_is_the_flat_one_turned_by_twenty_degrees() -> None:
    extent = np.ptp(bounds("tilted"), axis=0)
    a = np.radians(20.0)
    assert extent == pytest.approx([0.2 * np.sin(a) + 0.005 * np.cos(a), 0.2 * np.cos(a) + 0.005 * np.sin(a), 0.2])


def test_azimuth_turns_the_part_about_the_arm_and_x_is_to_the_right() -> None:
    part = make_part("flat", PartPose(azimuth_rad=np.pi / 2))
    low, high = part.body.world_vertices().min(axis=0), part.body.world_vertices().max(axis=0)
    assert low == pytest.approx([-0.1, 1.10, 1.0])
    assert high == pytest.approx([0.1, 1.105, 1.2])
    # Looking along +y with z up, the right is +x.
    assert part.body.world_from_body[:3, 0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)


def test_tilt_leans_the_top_away_from_the_arm() -> None:
    vertices, _ = make_part("flat", PartPose(tilt_rad=np.radians(30.0))).mesh()
    top = vertices[vertices[:, 2] > vertices[:, 2].max() - 1e-9]
    foot = vertices[vertices[:, 2] < 1.0 + 1e-9]
    assert top[:, 0].mean() > foot[:, 0].mean() + 0.05


@pytest.mark.parametrize(("up", "height"), [("x", 0.03), ("y", 0.02), ("z", 0.01)])
def test_the_up_axis_of_a_mesh_file_points_up(tmp_path: Path, up: str, height: float) -> None:
    file = tmp_path / "box.stl"
    trimesh.creation.box([0.03, 0.02, 0.01]).export(file)
    part = make_part(file, PartPose(up=up))
    assert np.ptp(part.mesh()[0][:, 2]) == pytest.approx(height, rel=1e-6)
    assert part.warnings == ()


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj"])
def test_mesh_files_of_every_format_stand_on_the_table(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"ball{suffix}"
    trimesh.creation.icosphere(radius=50.0).export(file)
    part = make_part(file, PartPose(scale=0.001))
    vertices, triangles = part.mesh()
    assert vertices.min(axis=0) == pytest.approx([1.10, -0.05, 1.0], abs=1e-6)
    assert trimesh.Trimesh(vertices, triangles).volume == pytest.approx(4 / 3 * np.pi * 0.05**3, rel=0.03)


def test_a_sheet_is_accepted_with_a_warning(tmp_path: Path) -> None:
    file = tmp_path / "sheet.ply"
    corners = [[0, 0, 0], [0.1, 0, 0], [0.1, 0, 0.1], [0, 0, 0.1]]
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False).export(file)
    assert "not watertight" in make_part(file).warnings[0]


def test_unknown_scenes_name_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="did you mean 'relief'"):
        make_part("releif")


def test_millimetres_taken_for_metres_are_named_with_their_cure(tmp_path: Path) -> None:
    file = tmp_path / "mm.stl"
    trimesh.creation.box([100.0, 80.0, 60.0]).export(file)
    with pytest.raises(ConfigError, match=r"scene\.scale = 0\.001"):
        make_part(file)
    with pytest.raises(ConfigError, match="only"):
        make_part(file, PartPose(scale=1e-5))


def test_parts_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "beam.stl"
    trimesh.creation.box([1.8, 0.1, 0.1]).export(file)
    with pytest.raises(ConfigError, match="wide"):
        make_part(file)
    for radius in (0.90, 1.246, 3.0):
        with pytest.raises(ConfigError, match="off the table"):
            make_part("flat", PartPose(radius_m=radius))
    make_part("flat", PartPose(radius_m=3.0), TableParameters(inner_radius_m=2.0, outer_radius_m=3.5))


@pytest.mark.parametrize("wrong", [{"scale": 0.0}, {"scale": float("nan")}, {"radius_m": float("inf")}, {"up": "w"}])
def test_impossible_poses_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError):
        PartPose(**wrong)


def _binary_stl(count: int, triangles: np.ndarray) -> bytes:
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *triangle.ravel(), 0) for triangle in triangles)
    return b"\0" * 80 + struct.pack("<I", count) + body


GOOD = np.array([[[0, 0, 0], [0.1, 0, 0], [0, 0, 0.1]]], dtype=np.float64)
PLY = "ply\nformat ascii 1.0\nelement vertex {v}\nproperty float x\nproperty float y\nproperty float z\n"
FACES = "element face {f}\nproperty list uchar int vertex_indices\nend_header\n"
HOSTILE: dict[str, bytes] = {
    "empty.stl": b"",
    "garbage.stl": b"this is no mesh at all\n" * 20,
    "garbage.ply": b"\x00\xff\x13 nothing" * 50,
    "garbage.obj": b"\x00\xff\x13 nothing" * 50,
    "lying.stl": _binary_stl(2**32 - 1, GOOD),
    "none.stl": _binary_stl(0, GOOD[:0]),
    "cut.stl": _binary_stl(1, GOOD)[:-20],
    "nan.stl": _binary_stl(1, GOOD * np.nan),
    "inf.stl": _binary_stl(1, GOOD + np.inf),
    "huge.ply": (PLY.format(v=10**12) + FACES.format(f=1) + "0 0 0\n").encode(),
    "faces.ply": (PLY.format(v=3) + FACES.format(f=10**12) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").encode(),
    "index.ply": (PLY.format(v=3) + FACES.format(f=1) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n").encode(),
    "points.ply": (PLY.format(v=3) + "end_header\n0 0 0\n1 0 0\n0 1 0\n").encode(),
    "index.obj": b"v 0 0 0\nv 0.1 0 0\nv 0 0 0.1\nf 1 2 9\n",
    "negative.obj": b"v 0 0 0\nv 0.1 0 0\nv 0 0 0.1\nf 1 2 -9\n",
    "text.obj": b"v a b c\nv 0.1 0 0\nv 0 0 0.1\nf 1 2 3\n",
    "nan.obj": b"v nan 0 0\nv 0.1 0 0\nv 0 0 0.1\nf 1 2 3\n",
}


@pytest.mark.parametrize("name", sorted(HOSTILE))
def test_hostile_files_end_in_one_clear_error(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.write_bytes(HOSTILE[name])
    with pytest.raises(DataError) as caught:
        make_part(file)
    assert name in str(caught.value)
    assert caught.value.cure


def test_missing_files_and_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot open"):
        make_part(tmp_path / "nowhere.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(DataError, match="not a file"):
        make_part(tmp_path / "folder.stl")


def test_huge_meshes_are_refused_with_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "ball.stl"
    trimesh.creation.icosphere(radius=0.05).export(file)
    monkeypatch.setattr(mesh_files, "MOST_TRIANGLES", 1000)
    with pytest.raises(DataError, match="1280 triangles, the limit is 1000"):
        make_part(file)
    monkeypatch.setattr(mesh_files, "MOST_BYTES", 1024)
    with pytest.raises(DataError, match="MiB"):
        make_part(file)
