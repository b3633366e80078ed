"""Plug-ins by name: files of their folders, and those of other packages."""

from __future__ import annotations

import sys
import types
from pathlib import Path

import pytest

import surfuse
from surfuse import registry
from surfuse.errors import ConfigError, UsageError

PACKAGE = Path(surfuse.__file__).parent


class Point:
    """An entry point of another package."""

    def __init__(self, name: str, target: object) -> None:
        self.name, self.target = name, target

    def load(self) -> object:
        return self.target


@pytest.fixture
def others(monkeypatch):
    """Pretend that other packages are installed."""

    def install(kind: str, *points: Point) -> None:
        monkeypatch.setattr(
            registry, "entry_points", lambda group: points if group == f"surfuse.{kind}" else (), raising=True
        )
        registry.names.cache_clear()

    yield install
    registry.names.cache_clear()


@pytest.mark.parametrize("kind", registry.KINDS)
def test_every_file_of_the_folder_is_a_plug_in_and_nothing_else(kind):
    files = {path.stem for path in (PACKAGE / kind).glob("*.py")} - {"__init__"}
    assert files <= set(registry.names(kind))
    assert list(registry.names(kind)) == sorted(registry.names(kind))
    assert files


@pytest.mark.parametrize("kind", registry.KINDS)
def test_an_unknown_name_gets_the_nearest(kind):
    name = registry.names(kind)[0]
    with pytest.raises(UsageError, match=f"did you mean '{name}'"):
        registry.load(kind, name + "x")


def test_an_unknown_kind_gets_the_nearest():
    with pytest.raises(UsageError, match="did you mean 'sensors'"):
        registry.names("sensor")


def test_listing_imports_nothing():
    before = set(sys.modules)
    registry.names.cache_clear()
    registry.names("sensors")
    new = {name for name in set(sys.modules) - before if name.startswith("surfuse.sensors.")}
    assert new == set()


def test_another_package_adds_a_plug_in(others):
    module = types.ModuleType("theirs")
    others("fusion", Point("theirs", module))
    assert "theirs" in registry.names("fusion")
    assert registry.load("fusion", "theirs") is module
    assert "theirs" not in registry.names("sensors")


def test_what_is_not_a_module_is_refused(others):
    others("fusion", Point("odd", 42))
    with pytest.raises(ConfigError, match=r"'odd'.*not a module"):
        registry.load("fusion", "odd")


def test_a_missing_package_breaks_only_its_own_plug_in(monkeypatch):
    monkeypatch.setitem(sys.modules, "surfuse.exporters.x3p", None)
    with pytest.raises(ConfigError, match=r"needs the package.*pip install"):
        registry.load("exporters", "x3p")
    assert registry.load("exporters", "nc").SUFFIXES
