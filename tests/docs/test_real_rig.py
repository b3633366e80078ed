"""The page from a box of parts to a map: its commands run, its cell file loads, its pictures and messages are true."""

from __future__ import annotations

import importlib.util
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from surfuse import settings
from surfuse.cli import acquire as acquire_command
from surfuse.cli import doctor as doctor_command
from surfuse.commands.acquire.acquisition import acquire
from surfuse.commands.machine.starter import shipped
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import SurfuseError
from surfuse.exporters import nc
from surfuse.rig.assembled import assembled

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "real_rig.md").read_text("utf-8")
CELL = ROOT / "docs" / "how-to" / "real_rig_cell.toml"
OPTIONS = {
    "surfuse acquire": set(inspect.signature(acquire_command.acquire).parameters),
    "surfuse doctor": set(inspect.signature(doctor_command.doctor).parameters),
}


def block_after(mark: str) -> str:
    return re.search(rf"<!-- {mark} -->\n```\w+\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)[1]


def runnable(line: str) -> str | None:
    """The line with the options that this version has; None where without them it would be another command."""
    known = next((options for command, options in OPTIONS.items() if line.startswith(command)), None)
    if known is not None and "yes" not in known:
        line = line.replace(" --yes", "")
    words = [word.removeprefix("--").replace("-", "_") for word in line.split() if word.startswith("--")]
    return None if known is not None and not set(words) <= known else line


def script() -> str:
    blocks = re.findall(r"^```sh\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    lines = [runnable(line) for block in blocks for line in block.splitlines()]
    return "\n".join(
        ["set -e", f'surfuse() {{ "{sys.executable}" -m surfuse "$@" </dev/null; }}', *filter(None, lines)]
    )


@pytest.mark.skipif(os.name != "posix", reason="a POSIX shell")
def test_the_commands_of_the_page_run_in_their_order(tmp_path):
    done = subprocess.run(["sh", "-c", script()], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    surface = nc.read(tmp_path / "my_rig" / "scan" / "surface.nc")
    assert surface.mask.sum() >= 77  # one a stop, and more where the estimate is finer
    assert np.nanmax(np.abs(surface.height_m - 0.1 * (surface.grid.u_m - 0.05))) < 1e-3
    assert {"sample", "first", "scan", "by_hand", "surface.stl"} <= {p.name for p in (tmp_path / "my_rig").iterdir()}


def test_the_cell_file_of_the_page_is_the_one_of_its_pictures():
    assert block_after("cell") == CELL.read_text("utf-8")
    found = settings.load(CELL)
    assert [sensor.name for sensor in found.sensor] == ["front", "back", "spot"]


def test_the_camera_of_the_page_loads_in_place_of_the_area(tmp_path):
    text = re.sub(r"\[area\].*?(?=\[scan\])", "", CELL.read_text("utf-8"), flags=re.DOTALL)
    (tmp_path / "rig.toml").write_text(f"{text}\n{block_after('camera')}", "utf-8")
    found = settings.load(tmp_path / "rig.toml")
    assert found.area is None
    assert (found.camera.mounted, len(found.search.views), found.search.tallest_m) == ("tool", 1, 0.1)
    lookout = assembled(found).lookout
    assert len(lookout.moves) == 1


def test_the_pictures_are_not_stale():
    spec = importlib.util.spec_from_file_location("make_rig_pictures", ROOT / "docs" / "make_rig_pictures.py")
    maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(maker)
    for path, text in maker.pictures().items():
        assert (path.read_text("utf-8") == text) is True, f"{path.name} is stale: run 'python docs/{spec.name}.py'"
        assert f"../images/{path.name}" in PAGE


def test_a_picture_shows_every_sensor_and_every_stop():
    tool = (ROOT / "docs" / "images" / "rig_tool.svg").read_text("utf-8")
    assert all(f">{name}</text>" in tool for name in ("front", "back", "spot", "grip axis"))
    assert tool.count('class="beam"') == 3
    area = (ROOT / "docs" / "images" / "rig_area.svg").read_text("utf-8")
    assert "117 stops over the outline, 0 left out" in area


BROKEN = {
    "the bridge cannot be started": ('"python3", "bridge.py"', '"no_such_program"'),
    "axis = [0.0, 0.0, 90.0] has the length 90, wanted 1": ("axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.0, 90.0]"),
    "position_m = [25.0, 0.0, 0.0] is 25 m from the tool": ("position_m = [0.0, 0.0, 0.0]", "position_m = [25, 0, 0]"),
    "looks back at the tool": ("axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.0, -1.0]"),
    "hears nothing nearer than 0.200 m": ("range_min_m = 0.05", "range_min_m = 0.2\n# "),
    "the arm refused all 77 stops": ("origin_m = [-0.05, -0.05, 0.0]", "origin_m = [5.0, 5.0, 0.0]"),
    "[area] jog = true asks for corners shown by hand, and there is no terminal": ("width_m = 0.10", "jog = true"),
}


@pytest.mark.parametrize("message", BROKEN)
def test_a_message_of_the_page_comes_when_it_says(message, tmp_path):
    assert f"`{message}`" in PAGE
    old, new = BROKEN[message]
    text = shipped("rig.toml")
    assert old in text
    if new == "jog = true":
        text = text.replace("height_m = 0.06", "")
    if "hears" in message:
        text = text.replace("standoff_m = 0.43", "standoff_m = 0.15")
    (tmp_path / "bridge.py").write_text(shipped("bridge.py"), "utf-8")
    text = (
        text.replace(old, new)
        .replace('"python3"', f'"{sys.executable}"')
        .replace("bridge.py", str(tmp_path / "bridge.py"))
    )
    (tmp_path / "rig.toml").write_text(text, "utf-8")
    with pytest.raises(SurfuseError, match=re.escape(message)):
        acquire(settings.load(tmp_path / "rig.toml"), tmp_path / "run", SilentWatcher(), yes=True)
