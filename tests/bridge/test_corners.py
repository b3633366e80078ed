"""Corners of the area shown by hand: an asker who moves the arm of a bridge between the questions."""

import io
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tilted_plane import Served, TiltedPlane, above

from surfuse import settings
from surfuse.cli._progress import TerminalWatcher
from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import ConfigError
from surfuse.exporters import nc
from surfuse.records import Status
from surfuse.runs.configuration import read_configuration

CELL = """
[arm]
driver = "bridge"
address = "{address}"

[[sensor]]
name = "us0"
driver = "bridge"
kind = "laser"
beam_full_angle_deg = 1.0
range_min_m = 0.05
range_max_m = 1.2
sigma_m = 0.001

[area]
jog = true

[scan]
standoff_m = 0.4
step_m = 0.02
"""
CORNERS = [(0.0, 0.0), (0.1, 0.0), (0.1, 0.06), (0.0, 0.06)]
SCRIPT = [*CORNERS, "done"]


class Guide(SilentWatcher):
    """Moves the arm over the next corner of the script, or answers a word; stops the scan after so many sweeps."""

    attended = True

    def __init__(self, rig, script, sweeps=1000):
        self.rig, self.script, self.sweeps, self.heard = rig, list(script), sweeps, []

    def ask(self, question):
        self.heard.append(question)
        step = self.script.pop(0)
        if step is None or isinstance(step, str):
            return step
        self.rig.pose = above(*step, 0.35)
        return ""

    def advance(self, steps=1):
        self.sweeps -= steps

    def stop_requested(self):
        return self.sweeps <= 0


@pytest.fixture
def rig():
    return TiltedPlane(sensors=("us0",))


@pytest.fixture
def cell(rig, tmp_path):
    with Served(rig) as served:
        (tmp_path / "rig.toml").write_text(CELL.format(address=served.address), "utf-8")
        yield settings.load(tmp_path / "rig.toml")


def corners_of(run):
    return np.array(read_configuration(run / "run.toml")[0]["area"]["corners_m"])


def test_the_shown_corners_lie_on_the_surface_and_are_scanned(rig, cell, tmp_path):
    outcome = acquire(cell, tmp_path / "run", Guide(rig, SCRIPT), yes=True)
    assert outcome.complete
    assert_allclose(corners_of(tmp_path / "run"), [(x, y, 0.1 * x) for x, y in CORNERS], atol=1e-9)
    surface = nc.read(tmp_path / "run" / "surface.nc")
    assert_allclose(surface.height_m[surface.mask], 0.0, atol=5e-4)
    assert_allclose(np.ptp(surface.grid.v_m), 0.06, atol=0.021)


def test_a_run_that_goes_on_does_not_ask_again(rig, cell, tmp_path):
    assert not acquire(cell, tmp_path / "run", Guide(rig, SCRIPT, sweeps=3), yes=True).complete
    nobody = Guide(rig, [])
    assert resume(tmp_path / "run", nobody, yes=True).complete
    assert nobody.heard == []


def test_words_drop_a_corner_and_end(rig, cell, tmp_path):
    script = [(0.3, 0.3), "undo", *CORNERS[:2], "done", "what", (0.2, 0.0), "done", CORNERS[2], "undo", *CORNERS[2:]]
    guide = Guide(rig, [*script, "DONE "])
    acquire(cell, tmp_path / "run", guide, yes=True)
    said = " ".join(guide.heard)
    assert "2 corners enclose no area: show another corner" in said
    assert "'what' is not understood" in said
    assert "3 corners lie on one line: show another corner" in said
    assert len(corners_of(tmp_path / "run")) == 5


def test_without_an_echo_the_corner_is_where_the_tool_is(rig, cell, tmp_path):
    rig.status = Status.NO_ECHO
    acquire_until_planned(rig, cell, tmp_path / "run")
    assert_allclose(corners_of(tmp_path / "run"), [(x, y, 0.35) for x, y in CORNERS], atol=1e-9)


def acquire_until_planned(rig, cell, run):
    """Only the corners count: the scan is stopped before its first sweep."""
    assert not acquire(cell, run, Guide(rig, SCRIPT, sweeps=0), yes=True).complete


@pytest.mark.parametrize("watcher", [SilentWatcher, lambda: Guide(None, [None])])
def test_where_nobody_can_be_asked_one_error_says_what_to_do(cell, tmp_path, watcher):
    with pytest.raises(ConfigError, match=r"no terminal; run it on a terminal, or give corners_m"):
        acquire(cell, tmp_path / "run", watcher(), yes=True)


def test_a_terminal_is_asked_and_a_pipe_is_not(monkeypatch, capsys):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    for stdin, answer in ((Terminal("done\n"), "done"), (Terminal(""), None), (io.StringIO("done\n"), None)):
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
        with TerminalWatcher(quiet=True, checkpoints=False) as watcher:
            assert watcher.ask("Where?") == answer
    assert capsys.readouterr().err.count("Where?\n> ") == 2
