"""One suite over every file format of maps: what each of them promises, found through the registry."""

from __future__ import annotations

import importlib.util
import inspect

import numpy as np
import pytest

from surfuse import registry
from surfuse.errors import DataError, StorageError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.map_files.placement import placement_of
from surfuse.records import MapGrid, SurfaceMap

_NEEDS = {"sdf": "sdfio", "x3p": "x3pio"}
NAMES = registry.names("exporters")
WRITTEN_ONLY = ("ply", "glb", "stl", "obj", "png")
READABLE = [name for name in NAMES if name not in WRITTEN_ONLY]


def plug_in(name: str):
    if name in _NEEDS and importlib.util.find_spec(_NEEDS[name]) is None:
        pytest.skip(f"{_NEEDS[name]} is not installed")
    return registry.load("exporters", name)


def surface(rows: int = 7, columns: int = 9, seed: int = 3) -> SurfaceMap:
    rng = np.random.default_rng(seed)
    u, v = -0.1 + 0.01 * np.arange(columns), 0.005 * np.arange(rows)
    height = 0.02 * np.sin(20 * u)[None, :] + 0.01 * np.cos(30 * v)[:, None]
    mask = np.ones((rows, columns), dtype=bool)
    mask[0, 0] = mask[3, 4] = False
    return SurfaceMap(
        grid=MapGrid(u_m=u, v_m=v, world_from_part=pose(rotation_about([1, 2, 3], 0.7), [0.1, 1.0, 1.2])),
        height_m=np.where(mask, height, np.nan),
        sigma_m=np.where(mask, rng.uniform(1e-4, 1e-2, (rows, columns)), np.nan),
        confidence=np.where(mask, rng.uniform(size=(rows, columns)), 0.0),
        count=np.where(mask, rng.integers(1, 99, (rows, columns)), 0),
        mask=mask,
        regime=mask.astype(np.uint8),
        method="weighted_average",
    )


@pytest.mark.parametrize("name", NAMES)
def test_the_plug_in_says_what_it_is(name):
    module = plug_in(name)
    assert module.SUFFIXES
    assert all(suffix.startswith(".") and suffix == suffix.lower() for suffix in module.SUFFIXES)
    assert isinstance(module.SUMMARY, str)
    assert isinstance(module.MARKS_PRIOR, bool)
    assert len(module.SUMMARY) < 90
    assert list(inspect.signature(module.write).parameters)[:3] == ["path", "surface", "overwrite"]


@pytest.mark.parametrize("name", NAMES)
def test_it_reads_its_files_or_says_why_not(name):
    offered = vars(plug_in(name))
    assert ("read" in offered) != ("NOT_READ" in offered)
    assert ("read" in offered) == (name not in WRITTEN_ONLY)
    if "read" in offered:
        assert list(inspect.signature(offered["read"]).parameters) == ["path"]
    else:
        assert 10 < len(offered["NOT_READ"]) < 90


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("csv", "nc", "png")])
def test_it_says_where_its_part_frame_lies(name, tmp_path):
    module, original = plug_in(name), surface()
    path = tmp_path / f"map{module.SUFFIXES[0]}"
    module.write(path, original)
    if name in READABLE:
        grid = module.read(path).grid
        assert np.allclose(grid.world_from_part, original.grid.world_from_part, rtol=0, atol=1e-12)
        assert np.allclose(grid.u_m, original.grid.u_m, rtol=0, atol=1e-12)
        assert np.allclose(grid.v_m, original.grid.v_m, rtol=0, atol=1e-12)
    else:
        found = placement_of(path)
        assert found is not None
        assert np.allclose(found.world_from_part, original.grid.world_from_part, rtol=0, atol=1e-6)


def test_no_suffix_belongs_to_two_formats():
    suffixes = [suffix for name in NAMES if name not in _NEEDS for suffix in plug_in(name).SUFFIXES]
    assert len(suffixes) == len(set(suffixes))


@pytest.mark.parametrize("name", NAMES)
def test_an_existing_file_is_not_overwritten_unless_asked(name, tmp_path):
    module = plug_in(name)
    path = tmp_path / f"map{module.SUFFIXES[0]}"
    path.write_bytes(b"precious")
    with pytest.raises(StorageError, match="exists"):
        module.write(path, surface())
    assert path.read_bytes() == b"precious"
    module.write(path, surface(), overwrite=True)
    assert path.read_bytes() != b"precious"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("name", NAMES)
def test_writing_twice_gives_the_same_bytes(name, tmp_path):
    module = plug_in(name)
    first, second = (tmp_path / f"{i}{module.SUFFIXES[0]}" for i in "ab")
    module.write(first, surface())
    module.write(second, surface())
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("name", NAMES)
def test_a_missing_or_vanished_folder_is_a_storage_error(name, tmp_path):
    module = plug_in(name)
    with pytest.raises(StorageError, match="folder"):
        module.write(tmp_path / "nowhere" / f"map{module.SUFFIXES[0]}", surface())


@pytest.mark.parametrize("name", NAMES)
def test_a_path_with_spaces_and_umlauts_works(name, tmp_path):
    module = plug_in(name)
    path = tmp_path / f"Fläche 測定 1{module.SUFFIXES[0]}"
    module.write(path, surface())
    assert path.stat().st_size > 0


@pytest.mark.parametrize("name", READABLE)
def test_heights_and_gaps_read_back(name, tmp_path):
    module, original = plug_in(name), surface()
    path = tmp_path / f"map{module.SUFFIXES[0]}"
    module.write(path, original)
    back = module.read(path)
    assert np.array_equal(back.mask, original.mask)
    assert np.allclose(back.height_m, original.height_m, rtol=0, atol=1e-10, equal_nan=True)
    assert np.allclose(np.diff(back.grid.u_m), 0.01)
    assert np.allclose(np.diff(back.grid.v_m), 0.005)


@pytest.mark.parametrize("name", ["nc", "csv"])
def test_every_layer_reads_back_to_the_last_bit(name, tmp_path):
    module, original = plug_in(name), surface()
    path = tmp_path / f"map{module.SUFFIXES[0]}"
    module.write(path, original)
    back = module.read(path)
    for layer in ("height_m", "sigma_m", "confidence", "count", "mask", "regime"):
        assert np.array_equal(getattr(back, layer), getattr(original, layer), equal_nan=layer.endswith("_m")), layer
    for axis in ("u_m", "v_m", "world_from_part"):
        assert np.array_equal(getattr(back.grid, axis), getattr(original.grid, axis)), axis
    assert back.method == original.method


@pytest.mark.parametrize("name", READABLE)
def test_damaged_and_foreign_files_are_refused(name, tmp_path):
    module = plug_in(name)
    path = tmp_path / f"map{module.SUFFIXES[0]}"
    with pytest.raises(DataError, match="no such"):
        module.read(path)
    for content in (b"", b"hello world\n", bytes(range(256)) * 8, b"PK\x03\x04" + bytes(60), b"\x89HDF\r\n\x1a\n"):
        path.write_bytes(content)
        with pytest.raises(DataError, match="map"):
            module.read(path)


@pytest.mark.parametrize("name", READABLE)
def test_a_truncated_file_is_an_error_or_the_same_map(name, tmp_path):
    module, original = plug_in(name), surface()
    path = tmp_path / f"map{module.SUFFIXES[0]}"
    module.write(path, original)
    whole = path.read_bytes()
    for share in np.linspace(0.02, 0.98, 25):
        path.write_bytes(whole[: int(share * len(whole))])
        try:
            back = module.read(path)
        except DataError:
            continue
        shown = np.nan_to_num(back.height_m[original.mask & back.mask])
        kept = original.height_m[original.mask & back.mask]
        assert np.allclose(shown, kept, atol=1e-9), "a wrong height without a word"


@pytest.mark.parametrize("name", NAMES)
def test_an_empty_map_is_written_or_refused_with_a_reason(name, tmp_path):
    module, full = plug_in(name), surface()
    nothing = np.zeros_like(full.mask)
    empty = SurfaceMap(
        grid=full.grid,
        height_m=np.full(full.mask.shape, np.nan),
        sigma_m=np.full(full.mask.shape, np.nan),
        confidence=np.zeros(full.mask.shape),
        count=nothing.astype(np.int64),
        mask=nothing,
        regime=nothing.astype(np.uint8),
        method="mean",
    )
    path = tmp_path / f"map{module.SUFFIXES[0]}"
    refusal = ""
    try:
        module.write(path, empty)
    except DataError as error:
        refusal = str(error)
    assert path.exists() == (refusal == "")
    assert "measured" in refusal or not refusal
