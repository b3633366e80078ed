"""Zones that measure perpendicular to their chip: what sensors.toml says, and what the readings say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surfuse.errors import ConfigError
from surfuse.runs.scan_source import load_scan
from surfuse.runs.side_files import read_corrections

OFF_DEG = 20.0


def write_log(folder: Path, distance: str) -> Path:
    """Four zones 20 degrees off the axis of a chip that turns over a plane; the numbers are perpendicular distances."""
    rng = np.random.default_rng(3)
    rows = ["t,sensor,px,py,pz,ax,ay,az,range_m"]
    off = np.radians(OFF_DEG)
    for k in range(150):
        turn, lean = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.3, 0.3)
        c, s = np.cos(lean), np.sin(lean)
        turned = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        place = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.25, 0.4)])
        for zone in range(4):
            angle = turn + zone * np.pi / 2
            axis = turned @ [np.sin(off) * np.cos(angle), np.sin(off) * np.sin(angle), -np.cos(off)]
            number = -place[2] / axis[2] * np.cos(off)
            cells = [0.1 * k + 0.01 * zone, f"z{zone}", *place, *axis, number]
            rows.append(",".join(cell if isinstance(cell, str) else repr(float(cell)) for cell in cells))
    (folder / "readings.csv").write_text("\n".join(rows) + "\n", "utf-8")
    table = 'kind = "tof"\nbeam_full_angle_deg = 8\nrange_min_m = 0.02\nrange_max_m = 2\nsigma_m = 0.003\n'
    table += f'off_axis_deg = {OFF_DEG}\ndistance = "{distance}"\n'
    (folder / "sensors.toml").write_text("\n".join(f"[z{k}]\n{table}" for k in range(4)), "utf-8")
    return folder / "readings.csv"


def test_a_perpendicular_distance_becomes_a_range_along_the_zone(tmp_path: Path) -> None:
    scan = load_scan(write_log(tmp_path, "perpendicular"))
    ends = scan.readings.position_m + scan.readings.axis * scan.readings.range_m[:, None]
    assert np.abs(ends[:, 2]) == pytest.approx(0.0, abs=1e-9)
    assert not any("distance =" in warning for warning in scan.warnings)


def test_numbers_that_are_read_the_wrong_way_are_told(tmp_path: Path) -> None:
    warnings = load_scan(write_log(tmp_path, "ray")).warnings
    assert any('write distance = "perpendicular"' in warning for warning in warnings)


@pytest.mark.parametrize(("key", "value"), [("distance", '"sideways"'), ("off_axis_deg", "80")])
def test_other_values_are_refused(tmp_path: Path, key: str, value: str) -> None:
    write_log(tmp_path, "ray")
    path = tmp_path / "sensors.toml"
    lines = [f"{key} = {value}" if line.startswith(key) else line for line in path.read_text("utf-8").split("\n")]
    path.write_text("\n".join(lines), "utf-8")
    with pytest.raises(ConfigError, match=key):
        read_corrections(path)
