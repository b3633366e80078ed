"""What the package imports is what it declares."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
# Where the distribution has another name than its module.
DISTRIBUTION = {
    "can": "python-can",
    "cv2": "opencv-python-headless",
    "mcap_ros2": "mcap-ros2-support",
    "rtde_control": "ur-rtde",
    "rtde_receive": "ur-rtde",
    "serial": "pyserial",
}


def distribution_of(module: str) -> str:
    return DISTRIBUTION.get(module, module)


def names_of(requirements: list[str]) -> set[str]:
    return {re.match(r"[\w.-]+", text)[0] for text in requirements}


NEEDED = names_of(PROJECT["dependencies"])
EXTRAS = set().union(*(names_of(texts) for name, texts in PROJECT["optional-dependencies"].items() if name != "test"))


def third_party(path: Path) -> set[str]:
    """Top-level names of the foreign modules that a file imports, anywhere in it."""
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.append(str(node.module))
    return {name.partition(".")[0] for name in names} - set(sys.stdlib_module_names) - {"surfuse"}


IMPORTS = {path.relative_to(ROOT): third_party(path) for path in sorted((ROOT / "src" / "surfuse").rglob("*.py"))}
MODULES = sorted(set().union(*IMPORTS.values()))


@pytest.mark.parametrize("module", MODULES)
def test_an_imported_package_is_declared(module):
    files = [str(path) for path, modules in IMPORTS.items() if module in modules]
    assert distribution_of(module) in NEEDED | EXTRAS, f"{module} is imported by {files[:3]}, and not in pyproject.toml"


def test_a_needed_package_is_imported():
    assert NEEDED - {distribution_of(module) for module in MODULES} == set()


def test_every_declared_package_has_a_tested_version():
    pinned = {
        re.sub(r"[-_.]+", "-", name).lower()
        for name in names_of((ROOT / "constraints.txt").read_text().split("\n")[1:-1])
    }
    assert {name.lower() for name in NEEDED} - pinned == set()
