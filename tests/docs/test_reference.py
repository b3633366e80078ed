"""The reference pages are what the code says."""

from __future__ import annotations

import importlib.util
import inspect
from pathlib import Path
from types import ModuleType

import pytest

import surfuse
from surfuse.settings import Settings

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_reference", DOCS / "make_reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", ["api.md", "settings.md"])
def test_the_page_is_not_stale(page, maker):
    wanted = maker.pages()[DOCS / "reference" / page]
    found = (DOCS / "reference" / page).read_text("utf-8")
    # Compared as a truth value, because the difference of two whole pages tells nobody anything.
    assert (found == wanted) is True, f"docs/reference/{page} is stale: run '{maker.COMMAND}'"


def settings_of(model: type, path: str = ""):
    for name, field in model.model_fields.items():
        if inspect.isclass(field.annotation) and hasattr(field.annotation, "model_fields"):
            yield from settings_of(field.annotation, f"{path}{name}.")
        else:
            yield f"{path}{name}", field


@pytest.mark.parametrize(("key", "field"), list(settings_of(Settings)))
def test_every_setting_says_what_it_is_and_in_which_unit(key, field, maker):
    assert field.description, f"{key} has no description"
    unit = maker.unit_of(key.rpartition(".")[2], field.annotation)
    assert unit or not {field.annotation} & {int, float}
    assert f"`{key.rpartition('.')[2]}`" in maker.settings_page()


def test_every_name_of_the_door_is_on_the_page(maker):
    assert {*maker.CALLS, *maker.CLASSES, "__version__"} == set(surfuse.__all__)


def test_every_public_call_says_what_it_raises(maker):
    for name in maker.CALLS:
        if name != "methods":
            assert "Raises\n------\n" in inspect.getdoc(getattr(surfuse, name)), name
