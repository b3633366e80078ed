"""A browser for the session, and the pages that it looks at; skipped without an installed Chromium."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest


def _module(path: Path) -> ModuleType:
    if path.stem in sys.modules:
        return sys.modules[path.stem]
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def browser() -> Iterator[object]:
    driver = _module(Path(__file__).with_name("chromium.py"))
    pytest.importorskip("websockets")
    if driver.executable() is None:
        pytest.skip("no Chromium is installed")
    with driver.Chromium() as tab:
        yield tab


@pytest.fixture(scope="session")
def synthetic_run() -> ModuleType:
    return _module(Path(__file__).parents[1] / "report" / "synthetic_run.py")


@pytest.fixture(scope="session")
def report_file(synthetic_run: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from surfuse.report.page import render_report

    path = tmp_path_factory.mktemp("pages") / "report.html"
    path.write_text(render_report(synthetic_run.report_content()), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def comparison_file(synthetic_run: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from surfuse.report.comparison import render_comparison

    path = tmp_path_factory.mktemp("pages") / "comparison.html"
    path.write_text(render_comparison(synthetic_run.comparison_content()), encoding="utf-8")
    return path
