"""The numbers in the tutorial are those that its commands print."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from surfuse.cli import main
from surfuse.commands.fuse.map_of_log import grid_of
from surfuse.commands.judge.method_comparison import Against, line_of, result_of
from surfuse.commands.judge.truth_files import dense_truth, read_truth
from surfuse.runs.scan_source import load_scan
from surfuse.settings import FusionSettings

PAGE = Path(__file__).parents[2] / "docs" / "tutorial.md"
RELATIVE, ABSOLUTE = 0.20, 0.5
NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?!\w)")
TIMES = ("wall time", "written")


def blocks() -> list[tuple[str, list[str]]]:
    """Every command of the page with the lines that it prints."""
    found = re.findall(r"```console\n\$ surfuse ([^\n]*)\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    return [(command, printed.splitlines()) for command, printed in found]


def run(command: str) -> list[str]:
    """A command of the page in this process: its lines on stdout."""
    before, sys.argv = sys.argv, ["surfuse", *command.split()]
    out, errors = io.StringIO(), io.StringIO()
    try:
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(errors),
            pytest.raises(SystemExit) as end,
        ):
            main()
    finally:
        sys.argv = before
    assert not end.value.code, f"{command} ended with {end.value.code}: {errors.getvalue()}"
    return out.getvalue().splitlines()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """An empty folder that the commands run in, one after the other."""
    before, path = Path.cwd(), tmp_path_factory.mktemp("tutorial")
    os.chdir(path)
    yield path
    os.chdir(before)


def assert_alike(printed: list[str], wanted: list[str]) -> None:
    assert len(printed) == len(wanted), "\n".join(printed)
    for got, line in zip(printed, wanted, strict=True):
        if line.startswith(TIMES):
            continue
        assert " ".join(NUMBER.sub("#", got).split()) == " ".join(NUMBER.sub("#", line).split())
        for one, other in zip(NUMBER.findall(got), NUMBER.findall(line), strict=True):
            assert float(one) == pytest.approx(float(other), rel=RELATIVE, abs=ABSOLUTE), (
                f"{got!r} in place of {line!r}"
            )


def test_every_number_of_the_page_is_what_the_commands_print(folder: Path) -> None:
    told = blocks()
    assert [command.split()[0] for command, _ in told] == [
        "acquire",
        "evaluate",
        "coverage",
        "compare",
        "why",
        "export",
    ]
    for command, wanted in told:
        if command.startswith("compare"):
            check_compare(command, wanted)
        else:
            assert_alike(run(command), wanted)
    assert (folder / "surface.ply").stat().st_size > 10_000
    assert (folder / "runs" / "first" / "report.html").is_file()


def check_compare(command: str, wanted: list[str]) -> None:
    """The lines that the page shows, each by the code that prints them (all methods would take a minute)."""
    _, log, _, truth = command.split()
    scan = load_scan(Path(log))
    grid = grid_of(scan)
    against = Against(read_truth(Path(truth), grid), dense_truth(Path(truth), grid))
    for line in wanted[1:]:
        name, *cells = line.split()
        text = line_of(result_of(scan, FusionSettings(), name, grid, against))
        # The last column is the time.
        assert_alike([" ".join(text.split()[:-1])], [" ".join(cells[:-1])])


def test_the_page_states_the_tolerance() -> None:
    text = " ".join(PAGE.read_text("utf-8").split())
    assert f"within {100 * RELATIVE:.0f} % or {ABSOLUTE}" in text
