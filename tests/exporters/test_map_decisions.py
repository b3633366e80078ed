"""Decisions of the guard in the native map file: there and back, and damage noticed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.exporters import nc
from surfuse.records import GuardReason, MapGrid, RegionDecision, SurfaceMap

NAMES = ("beam", "average", "carving")


def surface(*decisions: RegionDecision) -> SurfaceMap:
    grid = MapGrid(np.arange(3.0), np.arange(2.0), np.eye(4))
    one = np.ones(grid.shape)
    return SurfaceMap(grid, one, one, one, one, one > 0, one, "beam", decisions=decisions)


def decision(chosen: str, reason: GuardReason) -> RegionDecision:
    return RegionDecision(
        (-0.1, 0.2), (0.3, 0.4), 12, 7, NAMES, chosen, reason, (1e-3, 2.5e-4, float("nan")), (0.0, 0.125, 1.0)
    )  # fmt: skip


def test_decisions_come_back_as_they_were(tmp_path: Path) -> None:
    wanted = (decision("beam", GuardReason.BEST), decision("average", GuardReason.BEATEN))
    nc.write(tmp_path / "map.nc", surface(*wanted))
    found = nc.read(tmp_path / "map.nc").decisions
    assert repr(found) == repr(wanted)


def test_a_map_without_decisions_has_none(tmp_path: Path) -> None:
    nc.write(tmp_path / "map.nc", surface())
    assert nc.read(tmp_path / "map.nc").decisions == ()


def test_a_changed_decision_is_noticed(tmp_path: Path) -> None:
    nc.write(tmp_path / "map.nc", surface(decision("beam", GuardReason.BEST)))
    with h5py.File(tmp_path / "map.nc", "r+") as file:
        file["guard/miss"][0, 0] = 0.5
    with pytest.raises(DataError, match="checksum"):
        nc.read(tmp_path / "map.nc")


def test_regions_must_have_the_same_candidates(tmp_path: Path) -> None:
    other = replace(decision("beam", GuardReason.BEST), candidates=("beam", "mean", "median"))
    with pytest.raises(DataError, match="different candidates"):
        nc.write(tmp_path / "map.nc", surface(decision("beam", GuardReason.BEST), other))
