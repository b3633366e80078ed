"""Maps and truths from files that surfuse wrote, and from those of others: in which frame they are taken."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import trimesh

from surfuse import registry
from surfuse.exporters import nc
from surfuse.geometry.poses import pose, rotation_about, transform_points
from surfuse.map_files.placement import placement_in, placement_of, placement_text
from surfuse.records import MapGrid, SurfaceMap

WORLD_FROM_PART = pose(rotation_about([1, 2, 3], 0.7), [0.8, -0.5, 1.1])
GRID = MapGrid(np.linspace(-0.06, 0.06, 13), np.linspace(0.02, 0.1, 9), WORLD_FROM_PART)
HEIGHT = 0.01 * np.cos(20 * GRID.u_m)[None, :] + 0.05 * GRID.v_m[:, None]
SUFFIXES = sorted(
    suffix for name in registry.names("exporters") for suffix in registry.load("exporters", name).SUFFIXES
)
WRITTEN_ONLY = (".ply", ".stl", ".obj", ".glb", ".png")


@pytest.fixture
def run(tmp_path):
    full = np.ones(GRID.shape)
    nc.write(tmp_path / "map.nc", SurfaceMap(GRID, HEIGHT, 0.001 * full, full, full, full, full, "test"))
    return tmp_path / "map.nc"


def corners(scale: float = 1.0) -> trimesh.Trimesh:
    """The same surface as a mesh in part coordinates, from elsewhere."""
    u, v = np.meshgrid(GRID.u_m, GRID.v_m)
    rows, columns = GRID.shape
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [
            np.column_stack([first, first + 1, first + columns + 1]),
            np.column_stack([first, first + columns + 1, first + columns]),
        ]
    )
    return trimesh.Trimesh(scale * np.column_stack([u.ravel(), v.ravel(), HEIGHT.ravel()]), faces, process=False)


@pytest.mark.parametrize("suffix", [one for one in SUFFIXES if one != ".png"])
def test_what_export_wrote_is_the_truth_of_its_own_map(command, run, suffix):
    exported = run.with_name(f"exported{suffix}")
    command("export", run, exported)
    found = command("evaluate", run, "--truth", exported, "--json").json
    assert found["rmse_mm"] < 1e-3
    assert found["coverage"] == 1.0
    assert found["cells"] == HEIGHT.size


@pytest.mark.parametrize("suffix", [one for one in SUFFIXES if one not in WRITTEN_ONLY])
def test_every_map_that_can_be_read_is_evaluated(command, run, suffix):
    exported = run.with_name(f"exported{suffix}")
    command("export", run, exported)
    assert command("evaluate", exported, "--truth", run, "--json").json["rmse_mm"] < 1e-3


@pytest.mark.parametrize("suffix", [*WRITTEN_ONLY, ".off", ".txt", ""])
@pytest.mark.parametrize(
    "words",
    [
        ("evaluate", "MAP", "--truth", "MAP"),
        ("export", "MAP", "out.nc"),
        ("view", "MAP"),
        ("coverage", "MAP", "--truth", "MAP"),
        ("why", "MAP", "0", "50"),
    ],
)
def test_a_file_without_a_map_is_one_clear_line(command, run, suffix, words):
    if suffix in ("", ".txt") and words[0] == "coverage":
        return  # any other file is taken for a log there
    path = run.with_name(f"exported{suffix}")
    if suffix in (*WRITTEN_ONLY, ".off"):
        corners().export(path) if suffix == ".off" else command("export", run, path)
    else:
        path.write_text("x")
    line = command(*[path if word == "MAP" else word for word in words]).error(3, str(path), "give")
    if words[0] != "why":
        assert "no map that can be read back" in line
        assert ".nc" in line
        assert ("--truth" in line) == (suffix in (".ply", ".stl", ".obj", ".glb", ".off"))


def test_a_mesh_of_someone_else_is_in_the_world_unless_told(command, run):
    path = run.with_name("drawing.stl")
    corners().export(path)
    command("evaluate", run, "--truth", path).error(3, "in the world", "--truth-frame part")
    found = command("evaluate", run, "--truth", path, "--truth-frame", "part", "--json").json
    assert found["rmse_mm"] < 1e-3
    corners(1000.0).export(path)
    found = command("evaluate", run, "--truth", path, "--truth-frame", "part", "--scale", "0.001", "--json").json
    assert found["rmse_mm"] < 1e-3


def test_a_mesh_of_ours_can_be_taken_in_the_world_all_the_same(command, run):
    path = run.with_name("exported.ply")
    command("export", run, path)
    command("evaluate", run, "--truth", path, "--truth-frame", "world").error(3, "in the world", "part")


def test_a_map_of_another_place_shares_nothing(command, run):
    path = run.with_name("far.nc")
    away = MapGrid(GRID.u_m, GRID.v_m, pose(np.eye(3), [9.0, 0.0, 0.0]) @ WORLD_FROM_PART)
    full = np.ones(GRID.shape)
    nc.write(path, SurfaceMap(away, HEIGHT, 0.001 * full, full, full, full, full, "test"))
    command("evaluate", run, "--truth", path).error(3, "--truth-frame part")
    command("coverage", run, "--truth", path).error(3, "--truth-frame part")
    assert command("evaluate", run, "--truth", path, "--truth-frame", "part", "--json").json["rmse_mm"] < 1e-3


def test_a_scale_for_a_map_is_refused(command, run):
    command("evaluate", run, "--truth", run, "--scale", "0.001").error(3, "--scale 0.001", "metres")


def test_coverage_takes_every_map_with_a_sigma(command, run):
    exported = run.with_name("exported.csv")
    command("export", run, exported)
    assert command("coverage", exported, "--truth", run, "--json").json["regimes"]["all"]["cells"] == HEIGHT.size
    heights = run.with_name("exported.x3p")
    command("export", run, heights)
    command("coverage", heights, "--truth", run).error(3, "no sigma")
    command("coverage", run, "--truth", run, "--method", "median").error(2, "--method", "keeps no readings")


def test_a_ply_of_the_first_version_is_in_the_part_frame_of_the_map(command, run):
    path = run.with_name("old.ply")
    command("export", run, path)
    lines = path.read_bytes().split(b"\n", 4)
    assert lines[3].startswith(b"comment surfuse placement")
    path.write_bytes(b"\n".join([*lines[:3], lines[4]]))
    assert placement_of(path).world_from_part is None
    assert command("evaluate", run, "--truth", path, "--json").json["rmse_mm"] < 1e-3


def test_compare_takes_a_truth_in_the_part_frame(command, plate):
    log = plate()
    answer = command("compare", log, "--truth", log.with_name("truth.ply"), "--truth-frame", "part", "--json")
    assert answer.json["methods"]["mean"]["rmse_mm"] < 20.0
    command("compare", log, "--scale", "2").error(2, "--scale", "--truth")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "surfuse placement: world_from_part 1 2 3; first node 0 0",
        placement_text(GRID).replace("-0.5", "--0.5"),
        placement_text(GRID).replace(" 0.", " 7.", 1),
        placement_text(GRID).replace("0.8", "1e999"),
    ],
)
def test_a_damaged_placement_is_none(text):
    assert placement_in(text) is None


def test_a_placement_is_read_as_it_was_written(tmp_path):
    found = placement_in(f"x {placement_text(GRID, from_first_node=True)} y")
    assert np.array_equal(found.world_from_part, WORLD_FROM_PART)
    assert (found.first_u_m, found.first_v_m) == (GRID.u_m[0], GRID.v_m[0])
    (tmp_path / "a.stl").write_bytes(b"surfuse world_from_part " + struct.pack("<12f", *range(12)) + bytes(8))
    assert placement_of(tmp_path / "a.stl") is None


def test_points_go_where_the_placement_says(command, run):
    """An exported mesh, moved by hand to the world, is the same truth."""
    path = run.with_name("moved.obj")
    command("export", run, path)
    mesh = trimesh.load_mesh(path, process=False)
    trimesh.Trimesh(transform_points(WORLD_FROM_PART, mesh.vertices), mesh.faces).export(run.with_name("world.ply"))
    assert command("evaluate", run, "--truth", run.with_name("world.ply"), "--json").json["rmse_mm"] < 1e-3
