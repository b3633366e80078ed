"""The core of surfuse runs where POSIX is missing: every command in a child process that has nothing of it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

CHILD = Path(__file__).parent / "without_posix.py"
QUICK = ["--method", "weighted_average", "--set", "scan.step_m=0.05", "--set", "bus.interface=none"]


def readings(path: Path) -> None:
    """A plate, seen from above by one sensor."""
    lines = ["t,sensor,px,py,pz,ax,ay,az,range_m"]
    places = [(0.02 * i, 0.02 * j) for j in range(6) for i in range(6)]
    lines += [f"{0.1 * n:.1f},us0,{x},{y},0.5,0,0,-1,{0.4 + 0.01 * x:.5f}" for n, (x, y) in enumerate(places)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def run(folder: Path, *commands: list[object]) -> subprocess.CompletedProcess[str]:
    words = json.dumps([[str(word) for word in command] for command in commands])
    # Texts without an encoding would be read in another one on other machines.
    how = ["-X", "warn_default_encoding", "-W", "always::EncodingWarning"]
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252", "COLUMNS": "80"}
    return subprocess.run(
        [sys.executable, *how, str(CHILD), words], cwd=folder, env=environment, capture_output=True, encoding="cp1252"
    )


@pytest.mark.timeout(900)
def test_the_core_runs_without_posix(tmp_path: Path) -> None:
    readings(tmp_path / "plate.csv")
    scan, fused = tmp_path / "Lauf ü", tmp_path / "fused"
    answer = run(
        tmp_path,
        ["--version"],
        ["methods"],
        ["devices"],
        ["acquire", "flat", "--out", scan, "--arm-driver", "kinematic", *QUICK],
        ["resume", scan],
        ["report", scan, "--force"],
        ["evaluate", scan, "--truth", scan / "truth.ply"],
        ["fuse", "plate.csv", "--method", "mean", "--out", fused],
        *(["export", scan, tmp_path / f"map.{suffix}"] for suffix in ("csv", "ply", "stl", "png", "nc")),
        ["export", scan, tmp_path / "Ω.csv"],
        ["evaluate", tmp_path / "map.csv", "--truth", scan / "surface.nc"],
    )
    assert answer.returncode == 0, answer.stderr
    assert "?.csv" in answer.stdout
    assert (scan / "report.html").stat().st_size > 10_000
    assert (fused / "surface.nc").exists()
    assert all((tmp_path / f"map.{suffix}").stat().st_size > 100 for suffix in ("csv", "ply", "stl", "png", "nc"))
    mine = [line for line in answer.stderr.splitlines() if "EncodingWarning" in line and "surfuse" in line]
    assert mine == []


def test_every_module_imports_without_posix(tmp_path: Path) -> None:
    code = f"""
import importlib, pkgutil, runpy, sys
runpy.run_path({str(CHILD)!r})["break_everything"]()
import surfuse
for found in pkgutil.walk_packages(surfuse.__path__, "surfuse."):
    if not found.name.endswith("__main__"):
        importlib.import_module(found.name)
"""
    answer = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
