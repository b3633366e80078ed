"""What single map formats promise beyond the contract: CF layout, points, mesh geometry, scales."""

from __future__ import annotations

import dataclasses
import json
import struct
import zlib

import cv2
import h5netcdf
import numpy as np
import pytest
import trimesh

from surfuse.errors import DataError
from surfuse.exporters import csv, glb, nc, obj, ply, png, stl
from surfuse.geometry.poses import pose, rotation_about
from surfuse.map_files.heights import equal_step
from surfuse.map_files.triangles import mesh_of
from surfuse.records import FusedPoints, MapGrid, Regime, SurfaceMap


def surface(rows: int = 6, columns: int = 8, holes: tuple[tuple[int, int], ...] = ((2, 3),)) -> SurfaceMap:
    rng = np.random.default_rng(1)
    mask = np.ones((rows, columns), dtype=bool)
    for r, c in holes:
        mask[r, c] = False
    height = rng.normal(size=(rows, columns))
    two = mask & (rng.uniform(size=mask.shape) < 0.3)
    return SurfaceMap(
        grid=MapGrid(
            u_m=0.1 + 0.01 * np.arange(columns),
            v_m=-0.05 + 0.02 * np.arange(rows),
            world_from_part=pose(rotation_about([1, 2, 3], 1.0), [1, 2, 3]),
        ),
        height_m=np.where(mask, height, np.nan),
        sigma_m=np.where(mask, np.abs(height) + 1e-4, np.nan),
        confidence=np.where(mask, rng.uniform(size=mask.shape), 0.0),
        count=np.where(mask, 4, 0),
        mask=mask,
        regime=np.where(mask, rng.integers(1, 5, mask.shape), 0),
        method="beam",
        alternative_height_m=np.where(two, height + 0.1, np.nan),
        alternative_weight=np.where(two, 0.25, 0.0),
    )


def with_prior(at: tuple[int, int] = (4, 5)) -> SurfaceMap:
    """The same map with one cell that no reading holds."""
    full = surface()
    regime = full.regime.copy()
    regime[at] = Regime.PRIOR
    return dataclasses.replace(full, regime=regime)


LAYERS = (
    "height_m",
    "sigma_m",
    "confidence",
    "count",
    "mask",
    "regime",
    "alternative_height_m",
    "alternative_weight",
)


def points(m: int = 5) -> FusedPoints:
    rng = np.random.default_rng(2)
    start = np.concatenate([[0], np.cumsum(rng.integers(0, 5, m))])
    n = int(start[-1])
    return FusedPoints(
        stop=np.arange(m),
        row=np.arange(m) // 2,
        depth_m=np.where(np.arange(m) == 2, np.nan, rng.uniform(size=m)),
        sigma_m=rng.uniform(size=m),
        point_m=rng.normal(size=(m, 3)),
        gap=np.arange(m) % 4,
        reset=rng.uniform(size=m) < 0.5,
        start=start,
        sensor=rng.integers(0, 4, n),
        dc=rng.uniform(size=n),
        dc1=rng.uniform(size=n),
        dc2=rng.uniform(size=n),
        dc3=rng.uniform(size=n),
        gate=rng.integers(0, 7, n),
    )


def test_fused_points_read_back_bit_by_bit_and_are_optional(tmp_path):
    original = points()
    nc.write(tmp_path / "with.nc", surface(), points=original)
    nc.write(tmp_path / "without.nc", surface())
    back = nc.read_points(tmp_path / "with.nc")
    for name in original.__dataclass_fields__:
        a, b = getattr(original, name), getattr(back, name)
        assert a.dtype == b.dtype
        assert a.tobytes() == b.tobytes()
    assert nc.read_points(tmp_path / "without.nc") is None
    assert np.array_equal(nc.read(tmp_path / "with.nc").mask, surface().mask)


def test_a_scan_without_a_single_reading_can_be_stored(tmp_path):
    nothing = FusedPoints(
        **{name: np.zeros(0) for name in points().__dataclass_fields__}
        | {"point_m": np.zeros((0, 3)), "start": np.zeros(1)}
    )
    nc.write(tmp_path / "a.nc", surface(), points=nothing)
    assert len(nc.read_points(tmp_path / "a.nc")) == 0


def test_xarray_reads_the_native_map_with_its_conventions(tmp_path):
    xarray = pytest.importorskip("xarray")
    nc.write(tmp_path / "map.nc", surface(), points=points())
    with xarray.open_dataset(tmp_path / "map.nc", engine="h5netcdf") as data:
        assert data.height.dims == ("v", "u")
        assert np.array_equal(data.height.values, surface().height_m, equal_nan=True)
        assert np.array_equal(data.u.values, surface().grid.u_m)
        assert data.attrs["Conventions"] == "CF-1.11"
        assert data.attrs["title"]
        assert data.attrs["method"] == "beam"
        assert data.u.attrs["units"] == data.height.attrs["units"] == "m"
        assert "axis" not in data.u.attrs
        assert "_FillValue" not in data.u.encoding
        for name in data.height.attrs["ancillary_variables"].split():
            assert name in data
        meanings = data.regime.attrs["flag_meanings"].split()
        assert len(meanings) == len(data.regime.attrs["flag_values"])
        assert all("long_name" in data[name].attrs for name in data.variables)
    with xarray.open_dataset(tmp_path / "map.nc", engine="h5netcdf", group="points") as group:
        assert group.sizes["stops"] == 5


def test_the_pose_of_the_part_frame_is_in_the_file(tmp_path):
    nc.write(tmp_path / "map.nc", surface())
    with h5netcdf.File(tmp_path / "map.nc") as file:
        assert np.array_equal(file["world_from_part"][...], surface().grid.world_from_part)
        assert file.attrs["surfuse_version"]


def test_foreign_newer_and_incomplete_netcdf_files_are_refused(tmp_path):
    path = tmp_path / "map.nc"
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"x": 3}
        file.create_variable("temperature", ("x",), data=np.zeros(3))
    with pytest.raises(DataError, match=r"another kind.*temperature"):
        nc.read(path)
    nc.write(path, surface(), overwrite=True)
    with h5netcdf.File(path, "a") as file:
        file.attrs["format_version"] = np.int32(9)
    with pytest.raises(DataError, match=r"version 9.*up to 1"):
        nc.read(path)
    with h5netcdf.File(path, "w") as file:
        file.attrs.update({"format": "surfuse map", "format_version": np.int32(1)})
    with pytest.raises(DataError, match="damaged"):
        nc.read(path)


def test_no_flipped_bit_changes_a_native_map_silently(tmp_path):
    path, original = tmp_path / "map.nc", surface()
    nc.write(path, surface())
    whole = path.read_bytes()
    rng = np.random.default_rng(4)
    refused = 0
    for bit in rng.integers(0, 8 * len(whole), 150).tolist():
        data = bytearray(whole)
        data[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(data)
        try:
            back = nc.read(path)
        except DataError:
            refused += 1
            continue
        for name in LAYERS:
            assert getattr(back, name).tobytes() == getattr(original, name).tobytes(), (bit, name)
        assert np.array_equal(back.grid.u_m, original.grid.u_m)
        assert back.method == original.method
    assert refused > 5


def test_the_mesh_covers_exactly_the_cells_with_four_measured_corners(tmp_path):
    mesh = mesh_of(surface())
    a, b, c = (mesh.vertices_m[mesh.triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    assert np.all(normal[:, 2] > 0.0)
    cells = (6 - 1) * (8 - 1) - 4
    assert 0.5 * normal[:, 2].sum() == pytest.approx(cells * 0.01 * 0.02)
    assert np.all(np.isfinite(mesh.vertices_m))
    with pytest.raises(DataError, match="no four of them"):
        mesh_of(surface(2, 2, ((0, 0),)))


@pytest.mark.parametrize(("module", "tolerance"), [(ply, 1e-12), (glb, 1e-6), (stl, 1e-6), (obj, 1e-7)])
def test_mesh_files_hold_the_measured_nodes_in_metres(tmp_path, module, tolerance):
    path = tmp_path / f"map{module.SUFFIXES[0]}"
    module.write(path, surface())
    loaded = trimesh.load_mesh(path, process=False)
    expected = mesh_of(surface())
    assert len(loaded.faces) == len(expected.triangles)
    found = loaded.vertices[loaded.faces]
    assert np.allclose(found, expected.vertices_m[expected.triangles], atol=tolerance)


def test_ply_and_glb_carry_confidence_and_stderr(tmp_path):
    expected = mesh_of(surface())
    ply.write(tmp_path / "m.ply", surface())
    vertex = trimesh.load_mesh(tmp_path / "m.ply", process=False).metadata["_ply_raw"]["vertex"]["data"]
    assert np.array_equal(vertex["confidence"].ravel(), expected.confidence.astype(np.float32))
    assert np.array_equal(vertex["stderr"].ravel(), expected.sigma_m.astype(np.float32))
    glb.write(tmp_path / "m.glb", surface())
    content = (tmp_path / "m.glb").read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    tree = json.loads(content[20 : 20 + length])
    names = tree["meshes"][0]["primitives"][0]["attributes"]
    assert {"_confidence", "_stderr"} <= {name.lower() for name in names}


def test_csv_rows_are_the_measured_nodes(tmp_path):
    csv.write(tmp_path / "m.csv", surface())
    table = np.loadtxt(tmp_path / "m.csv", delimiter=",", skiprows=2)
    assert table.shape == (47, 10)
    assert np.array_equal(table[:, 2], surface().height_m[surface().mask])


@pytest.mark.parametrize(
    ("line", "text", "words"),
    [
        (2, "0.1,0.2\n", "not a row of 10"),
        (2, "0.1,-0.05,x,1,1,1,1,1,nan,0\n", ":3"),
        (2, "0.1005,-0.05,0,1,1,1,1,1,nan,0\n", "no node"),
        (2, "0.1,-0.05,0,1,1,1.5,1,1,nan,0\n", "whole numbers"),
        (2, "0.1,-0.05,nan,1,1,1,1,1,nan,0\n", "finite"),
        (0, '# surfuse map {"version": 1}\n', "first line is damaged"),
        (0, "u,v\n", "not a map exported"),
    ],
)
def test_damaged_csv_maps_are_refused(tmp_path, line, text, words):
    path = tmp_path / "m.csv"
    csv.write(path, surface())
    lines = path.read_text().splitlines(keepends=True)
    lines[line] = text
    path.write_text("".join(lines))
    with pytest.raises(DataError, match=words) as caught:
        csv.read(path)
    assert "m.csv" in str(caught.value)


def test_the_png_heights_are_within_half_a_grey_level(tmp_path):
    png.write(tmp_path / "m.png", surface())
    grey = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_UNCHANGED)
    assert grey.dtype == np.uint16
    content = (tmp_path / "m.png").read_bytes()
    text = content[content.index(b"surfuse\0") + 8 :]
    scale = json.loads(text[: text.index(b"}") + 1])
    w = scale["w_min_m"] + (grey.astype(float) - 1) * scale["w_step_m"]
    flipped = np.flipud(surface().height_m)
    assert np.array_equal(grey == 0, ~np.flipud(surface().mask))
    assert np.nanmax(np.abs(np.where(grey == 0, np.nan, w) - flipped)) <= 0.5001 * scale["w_step_m"]
    at = 8
    while at < len(content):
        (length,) = struct.unpack_from(">I", content, at)
        assert zlib.crc32(content[at + 4 : at + 8 + length]) == struct.unpack_from(">I", content, at + 8 + length)[0]
        at += 12 + length


@pytest.mark.parametrize("off_m", [1e-9, -1e-9, 1e-7, -1e-7, 2e-3])
def test_steps_are_equal_to_a_millionth(off_m):
    nodes = 0.1 + 0.01 * np.arange(8)
    nodes[3] += off_m
    if abs(off_m) < 1e-8:
        assert equal_step(nodes, "u") == pytest.approx(0.01)
    else:
        with pytest.raises(DataError, match="steps along u differ"):
            equal_step(nodes, "u")


WRONG = [*((5, text) for text in ("-1", "1.5", "inf")), *((6, text) for text in ("-1", "256", "0.5", "nan"))]


@pytest.mark.parametrize(("column", "value"), WRONG)
def test_counts_and_regimes_of_a_csv_map_are_whole_and_no_others(tmp_path, column, value):
    csv.write(tmp_path / "m.csv", surface())
    head, names, first, *rest = (tmp_path / "m.csv").read_text().splitlines()
    cells = first.split(",")
    cells[column] = value
    (tmp_path / "m.csv").write_text("\n".join([head, names, ",".join(cells), *rest]) + "\n")
    with pytest.raises(DataError):
        csv.read(tmp_path / "m.csv")


def test_formats_with_one_step_refuse_unequal_steps(tmp_path):
    even = surface()
    grid = MapGrid(
        u_m=np.array([0, 1, 2, 3, 4, 5, 6, 8]) * 0.01, v_m=even.grid.v_m, world_from_part=even.grid.world_from_part
    )
    uneven = SurfaceMap(grid=grid, **{n: getattr(even, n) for n in even.__dataclass_fields__ if n != "grid"})
    with pytest.raises(DataError, match=r"steps along u differ.*\.nc"):
        png.write(tmp_path / "m.png", uneven)


@pytest.mark.parametrize("name", ["sdf", "x3p"])
def test_metrology_files_have_the_dialect_that_others_read(tmp_path, name):
    library = pytest.importorskip({"sdf": "sdfio", "x3p": "x3pio"}[name])
    from surfuse import registry

    module = registry.load("exporters", name)
    module.write(tmp_path / f"m.{name}", surface())
    file = library.read(tmp_path / f"m.{name}")
    if name == "sdf":
        assert (tmp_path / "m.sdf").read_bytes().startswith(b"bISO-1.0")
        assert file.header.data_type == library.DataType.INT32
        assert np.allclose(file.data, surface().height_m, atol=2e-9, equal_nan=True)
    else:
        assert file.revision == library.Revision.ISO5436_2000
        assert np.array_equal(file.layers[0].z, surface().height_m, equal_nan=True)


@pytest.mark.parametrize("module", [nc, csv])
def test_second_surfaces_read_back_to_the_last_bit_and_are_optional(tmp_path, module):
    first, second = (tmp_path / f"{name}{module.SUFFIXES[0]}" for name in "ab")
    module.write(first, surface())
    back = module.read(first)
    for name in ("alternative_height_m", "alternative_weight"):
        assert np.array_equal(getattr(back, name), getattr(surface(), name), equal_nan=True)
    module.write(second, dataclasses.replace(surface(), alternative_height_m=None, alternative_weight=None))
    back = module.read(second)
    assert back.alternative_height_m is None
    assert back.alternative_weight is None


def test_second_surfaces_have_cf_attributes(tmp_path):
    nc.write(tmp_path / "m.nc", surface())
    with h5netcdf.File(tmp_path / "m.nc") as file:
        assert file["alternative_height"].attrs["units"] == "m"
        assert file["alternative_weight"].attrs["units"] == "1"
        assert file["alternative_height"].attrs["ancillary_variables"] == "alternative_weight"


def test_a_map_of_the_first_csv_layout_still_reads(tmp_path):
    csv.write(tmp_path / "m.csv", dataclasses.replace(surface(), alternative_height_m=None, alternative_weight=None))
    head, names, *rows = (tmp_path / "m.csv").read_text().splitlines()
    old = [head, names.removesuffix(",measured"), *(row.rsplit(",", 1)[0] for row in rows)]
    (tmp_path / "old.csv").write_text("\n".join(old) + "\n")
    assert np.array_equal(csv.read(tmp_path / "old.csv").height_m, surface().height_m, equal_nan=True)


@pytest.mark.parametrize("module", [png, stl, obj])
def test_formats_that_cannot_mark_the_prior_leave_it_out(tmp_path, module):
    prior, holed = with_prior(), surface(holes=((2, 3), (4, 5)))
    assert not module.MARKS_PRIOR
    module.write(tmp_path / f"a{module.SUFFIXES[0]}", prior)
    if module is png:
        grey = cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(np.flipud(grey) > 0, holed.mask)
    else:
        loaded = trimesh.load_mesh(tmp_path / f"a{module.SUFFIXES[0]}", process=False)
        assert len(loaded.faces) == len(mesh_of(holed).triangles)


def test_formats_with_layers_mark_the_prior(tmp_path):
    prior = with_prior()
    ply.write(tmp_path / "m.ply", prior)
    vertex = trimesh.load_mesh(tmp_path / "m.ply", process=False).metadata["_ply_raw"]["vertex"]["data"]
    inside = mesh_of(prior, with_prior=True)
    assert np.count_nonzero(~inside.measured) == 1
    assert np.array_equal(vertex["measured"].ravel(), inside.measured)
    assert tuple(vertex[name].ravel()[~inside.measured][0] for name in ("red", "green", "blue")) == ply.PRIOR_RGB
    csv.write(tmp_path / "m.csv", prior)
    table = np.loadtxt(tmp_path / "m.csv", delimiter=",", skiprows=2)
    assert np.array_equal(table[:, 7] == 0, table[:, 6] == Regime.PRIOR)
    assert np.count_nonzero(table[:, 7] == 0) == 1
