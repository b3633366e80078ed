"""The page of the drivers has a row for each, and what it names as proof is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from surfuse import registry
from surfuse.rig.real.sources import BRIDGE, NODE

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "drivers.md").read_text("utf-8")
HEADS = {"arms": "## Arms", "sensors": "## Sensors"}


def rows(kind: str) -> dict[str, list[str]]:
    """Driver -> the other cells of its row."""
    part = PAGE.split(HEADS[kind])[1].split("\n## ")[0]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in part.splitlines() if line[:3] == "| `"]
    return {row[0].strip("`"): row[1:] for row in cells}


@pytest.mark.parametrize("kind", HEADS)
def test_every_driver_has_a_row_and_every_row_a_driver(kind):
    beside = {BRIDGE, NODE} if kind == "sensors" else set()
    assert set(rows(kind)) == set(registry.found(kind).built_in) | beside


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in HEADS for name in rows(kind)])
def test_what_a_row_names_as_proof_speaks_of_the_driver(kind, name):
    command, against, proof = rows(kind)[name]
    assert command
    assert against
    text = (ROOT / re.fullmatch(r"`(tests/\S+\.py)`", proof)[1]).read_text("utf-8")
    assert name in text
