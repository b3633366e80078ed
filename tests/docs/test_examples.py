"""The examples and the Python of the pages run as they stand, in a folder of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PAGES = {"README.md": 1, "docs/how-to/python.md": 9}


def run(script: Path, folder: Path) -> str:
    """What a script prints in that folder; it must end well and complain of nothing."""
    environment = os.environ | {"MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, str(script)], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_there_are_five_short_examples_and_the_page_lists_them():
    assert len(EXAMPLES) == 5
    page = (ROOT / "examples" / "README.md").read_text("utf-8")
    for script in EXAMPLES:
        assert len(script.read_text("utf-8").splitlines()) < 40, script.name
        assert f"[{script.name}]({script.name})" in page


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda script: script.stem)
def test_an_example_runs_in_an_empty_folder(script, tmp_path):
    assert run(script, tmp_path)


def test_the_examples_show_what_they_say(tmp_path):
    told = run(ROOT / "examples" / "compare_methods.py", tmp_path)
    error_mm = {line.split()[0]: float(line.split()[1]) for line in told.splitlines()[1:6]}
    assert error_mm["beam"] < error_mm["weighted_average"] < error_mm["mean"]
    assert "trust: good" in run(ROOT / "examples" / "own_csv.py", tmp_path)
    assert {"surface.nc", "surface.ply"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.parametrize("page", sorted(PAGES))
def test_the_python_of_a_page_runs(page, tmp_path):
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text("utf-8"), re.DOTALL | re.MULTILINE)
    assert len(blocks) == PAGES[page]
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "page.py").write_text("\n".join(blocks), "utf-8")
    run(tmp_path / "page.py", tmp_path)
