"""The Python of the pages on serial devices runs against their stand-ins."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")


def blocks(page):
    text = (ROOT / "docs" / "how-to" / page).read_text("utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch):
    pytest.importorskip("serial")
    monkeypatch.setattr(sys, "path", [str(ROOT / "tests" / "stand_ins"), *sys.path])


@pytest.mark.parametrize("dialect", ["grbl", "marlin"])
def test_the_page_on_gantries_runs(dialect, capsys):
    from gcode_boards import Grbl, Marlin

    with {"grbl": Grbl, "marlin": Marlin}[dialect]() as board:
        board.part_mm = 0.0
        names = {}
        for block in blocks("gantry.md"):
            exec(block.replace("/dev/ttyUSB0", board.port).replace('"grbl"', f'"{dialect}"'), names)
    moved, touched = capsys.readouterr().out.splitlines()
    assert moved == "[ True] [0.01 0.   0.02]"
    assert touched.startswith("0.02 ")


def test_the_page_on_the_kit_runs(capsys):
    from kit_terminal import KitTerminal

    with KitTerminal() as kit:
        (block,) = blocks("ranging_kit.md")
        exec(block.replace("/dev/ttyUSB1", kit.port), {})
    range_m, spread_m, amplitude = map(float, capsys.readouterr().out.split())
    assert range_m == pytest.approx(0.43, abs=1e-3)
    assert 0.0 < spread_m < 1e-3
    assert amplitude > 0.0
