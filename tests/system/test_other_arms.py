"""Arms from files through the whole job: a six-axis and a seven-axis one; scans out of reach; bad files and options."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")
sys.path.insert(0, str(Path(__file__).parents[1] / "arms"))
from test_model_file import SIX, seven

from surfuse.runs.folder import RunFolder
from surfuse.runs.log_reader import read_log

QUICK = ("--method", "weighted_average", "--set", "scan.step_m=0.08", "--set", "array.pings=2", "--json")
PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "own_arm.md"
HEIGHT = {"six": ("--set", "arm.base_height_m=1.0"), "seven": ("--set", "arm.base_height_m=0.8")}


@pytest.fixture(scope="module")
def arms(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[object, ...]]:
    """The options that choose each arm."""
    folder = tmp_path_factory.mktemp("arms")
    example = re.search(r"```xml\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    assert example is not None
    (folder / "six.xml").write_text(example.group(1))
    (folder / "seven.urdf").write_text(seven())
    return {
        "six": ("--arm", folder / "six.xml", "--tool", "flange", *HEIGHT["six"]),
        "seven": ("--arm", folder / "seven.urdf", "--tool", "tool", *HEIGHT["seven"]),
    }


@pytest.mark.parametrize(("name", "joints"), [("six", 6), ("seven", 7)])
def test_an_arm_from_a_file_scans_a_part(command, arms, tmp_path, name: str, joints: int) -> None:
    """The six-axis arm is the example of the how-to page."""
    run = tmp_path / "run"
    answer = command("acquire", "flat", *arms[name], *QUICK, "--out", run)
    assert answer.status == 0, answer.err
    assert answer.json["complete"] is True
    assert answer.json["stops"] == answer.json["stops_planned"] > 6
    assert answer.json["rmse_mm"] < 1.0
    sweeps = read_log(RunFolder.open(run).log).sweeps
    reached = np.array([sweep.joints_rad for sweep in sweeps])
    assert reached.shape == (len(sweeps), joints)
    # Whatever the arm, the array looks at the part from the standoff, level and straight.
    poses = np.array([sweep.world_from_grip for sweep in sweeps])
    assert np.abs(poses[:, :3, 2] - poses[0, :3, 2]).max() < 2e-3
    assert np.hypot(*poses[:, :2, 3].mean(axis=0)) == pytest.approx(1.12 - 0.43, abs=0.02)


def test_a_scan_with_another_arm_can_be_resumed_from_another_folder(
    command, arms, tmp_path, monkeypatch: pytest.MonkeyPatch, map_bits: Callable[[Path], dict[str, bytes]]
) -> None:
    file = Path(str(arms["six"][1]))
    monkeypatch.chdir(file.parent)
    run = tmp_path / "run"
    options = ("--arm", file.name, *arms["six"][2:])
    assert command("acquire", "flat", *options, *QUICK, "--out", run).status == 0
    wanted = map_bits(run)
    monkeypatch.chdir(tmp_path)
    for name in ("surface.nc", "report.html"):
        (run / name).unlink()
    assert command("resume", run, "--json").status == 0
    assert map_bits(run) == wanted


def test_a_part_out_of_reach_is_refused_with_the_stops_and_the_way_to_move_it(command, arms, tmp_path) -> None:
    far = ("--set", "scene.radius_m=1.75", "--set", "cell.table_outer_radius_m=1.9")
    line = command("acquire", "flat", *arms["six"], *far, *QUICK[:-1], "--out", tmp_path / "run").error(
        3, "out of reach", "mm towards the arm (scene.radius_m = 1."
    )
    assert "stops can be visited" in line


BAD = {
    "no tool named": (SIX, (), "no tool frame is named; name the site, body or link that carries the array"),
    "no such tool": (SIX, ("--tool", "flang"), "did you mean 'flange'"),
    "first joint not upright": (
        SIX.replace('axis="0 0 1"', 'axis="1 0 0"'),
        ("--tool", "flange"),
        "joint 'a1' turns about (1, 0, 0)",
    ),
    "servo cards": (SIX, ("--tool", "flange", "--arm-driver", "trident"), "arm.driver = 'kinematic'"),
    "ready posture outside its limits": (
        SIX,
        ("--tool", "flange", "--set", "arm.ready_deg=[0, 100, 0, 0, 0, 0]"),
        "target of joint 2 is 100.00 deg, its limits are -190.0 to 10.0 deg",
    ),
    "ready posture of another arm": (
        SIX,
        ("--tool", "flange", "--set", "arm.ready_deg=[0, 0]"),
        "the arm has 6 joints",
    ),
    "on the floor": (SIX, ("--tool", "flange", "--set", "arm.base_height_m=0"), "change arm.base_height_m"),
    "not an arm": ("<html/>", ("--tool", "flange"), "root element is <html>"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_arm_is_one_clear_error(command, tmp_path, case: str) -> None:
    text, options, told = BAD[case]
    (tmp_path / "arm.xml").write_text(text)
    high = () if case == "on the floor" else HEIGHT["six"]
    answer = command("acquire", "flat", "--arm", tmp_path / "arm.xml", *high, *options, "--out", tmp_path / "run")
    assert answer.status in (3, 5)
    answer.error(answer.status, told)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--tool", "flange"), "arm.tool = 'flange' without an arm file; give arm.file"),
        (("--arm", "gone.xml", "--tool", "flange"), "gone.xml: there is no such file; give an MJCF or URDF file"),
        (
            ("--arm-driver", "tridnet"),
            "did you mean 'trident'? valid: bridge, gcode, kinematic, recorded, simulated, trident, ur_rtde",
        ),
        (
            ("--set", "arm.law=computed_torqe"),
            "did you mean 'computed_torque'? valid: computed_torque, gravity_pd, independent_pid, set_points_28ms",
        ),
        (("--set", "arm.fixture_kg=2.7"), "a load of 2.7 kg, the PUMA 560 carries 2.5 kg; lighten the tool"),
    ],
)
def test_a_bad_option_of_the_arm_is_one_clear_error(command, tmp_path, options, told: str) -> None:
    command("acquire", "flat", *options, "--out", tmp_path / "run").error(3, told)


def test_without_mujoco_the_error_names_the_extra(command, arms, tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("surfuse.rig.arm_of_file", "surfuse.arm_models.model_file", "surfuse.arm_models.arm_file"):
        importlib.import_module(name)
        monkeypatch.delitem(sys.modules, name)
        monkeypatch.delattr(name)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    command("acquire", "flat", *arms["six"], "--out", tmp_path / "run").error(
        3, "needs the package 'mujoco'", "pip install 'surfuse[dynamics]'"
    )
