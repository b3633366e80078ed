"""MAP arguments and outcomes: what a path means, and how results become JSON."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse import registry
from surfuse.commands.maps.map_files import format_of, map_path
from surfuse.commands.outcome import SilentWatcher, finite
from surfuse.errors import ConfigError, DataError, StorageError, UsageError


def test_a_run_folder_means_its_native_map(tmp_path):
    with pytest.raises(DataError, match=r"no surface\.nc"):
        map_path(tmp_path)
    (tmp_path / "surface.nc").write_text("")
    assert map_path(tmp_path) == tmp_path / "surface.nc"
    assert map_path(tmp_path / "surface.nc") == tmp_path / "surface.nc"


def test_nothing_there_is_a_storage_error(tmp_path):
    with pytest.raises(StorageError, match="no such file or folder"):
        map_path(tmp_path / "none.nc")


@pytest.mark.parametrize("name", ["nc", "ply", "stl", "obj", "glb", "csv", "png"])
def test_the_suffix_chooses_the_format_in_any_case(tmp_path, name):
    for file in (tmp_path / f"a.{name}", tmp_path / f"a.b.{name.upper()}"):
        assert format_of(file) is registry.load("exporters", name)


@pytest.mark.parametrize("name", ["map", "map.", "map.step", ".nc"])
def test_no_format_for_other_names(tmp_path, name):
    with pytest.raises(UsageError, match="no map format"):
        format_of(tmp_path / name)


def test_a_format_whose_package_is_missing_breaks_only_itself(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "surfuse.exporters.sdf", None)
    with pytest.raises(ConfigError, match="needs the package"):
        format_of(tmp_path / "map.sdf")
    assert format_of(tmp_path / "map.ply").SUFFIXES


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.integers() | st.text(), inner, max_size=3),
    max_leaves=10,
)


@given(JUNK)
def test_every_result_is_strict_json(value):
    json.loads(json.dumps(finite(value), allow_nan=False))


def test_numbers_that_json_lacks_become_null_and_others_stay():
    assert finite({"a": float("nan"), "b": [np.inf, -np.inf, 1.5], 3: (1, True, None, "x")}) == {
        "a": None,
        "b": [None, None, 1.5],
        "3": [1, True, None, "x"],
    }


def test_the_silent_watcher_never_stops():
    watcher = SilentWatcher()
    watcher.stage("search", 3)
    watcher.advance()
    watcher.warn("nothing")
    assert watcher.stop_requested() is False
