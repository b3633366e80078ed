"""The scan factory as a fixture, because test files are not importable modules."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def scans():
    spec = importlib.util.spec_from_file_location("scan_factory", Path(__file__).with_name("scan_factory.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
