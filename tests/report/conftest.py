"""A made-up run as fixtures, built once."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from surfuse.report.content import ComparisonContent, ReportContent


def _synthetic() -> ModuleType:
    spec = importlib.util.spec_from_file_location("synthetic_run", Path(__file__).with_name("synthetic_run.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def synthetic() -> ModuleType:
    return _synthetic()


@pytest.fixture(scope="session")
def run_content(synthetic: ModuleType) -> ReportContent:
    return synthetic.report_content()


@pytest.fixture(scope="session")
def several_methods(synthetic: ModuleType) -> ComparisonContent:
    return synthetic.comparison_content()
