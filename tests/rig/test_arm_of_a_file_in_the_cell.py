"""The sensors of a cell file sit on the arm of a file as on the built-in one: where their tables say."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from surfuse.rig.assembled import assembled
from surfuse.settings import load

ARMS = Path(__file__).parents[1] / "arms"
# Beside the axis of the tool, all on one side, and looking a little outwards: nothing cancels.
PLACES = {"a": ([0.05, 0.01, 0.02], [0.0, 0.0, 1.0]), "b": ([0.03, -0.04, 0.01], [0.6, 0.0, 0.8])}


def cell(folder: Path, arm: str, sensors: bool) -> Path:
    tables = "".join(
        f'[[sensor]]\nname = "{name}"\nkind = "ultrasonic"\nposition_m = {place}\naxis = {axis}\n'
        for name, (place, axis) in PLACES.items()
    )
    path = folder / f"cell_{sensors}.toml"
    path.write_text(f'[arm]\n{arm}\n[scene]\nname = "flat"\n{tables if sensors else ""}', "utf-8")
    return path


def arms(folder: Path) -> dict[str, str]:
    spec = importlib.util.spec_from_file_location("test_model_file", ARMS / "test_model_file.py")
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    (folder / "six.xml").write_text(found.SIX, "utf-8")
    return {"built in": 'driver = "kinematic"', "file": f'file = "{folder / "six.xml"}"\ntool = "flange"'}


@pytest.mark.parametrize("arm", ["built in", "file"])
def test_readings_come_from_where_the_tables_put_the_sensors(tmp_path, arm):
    if arm == "file":
        pytest.importorskip("mujoco")
    keys = arms(tmp_path)[arm]
    bare, rig = (assembled(load(cell(tmp_path, keys, sensors))) for sensors in (False, True))
    fixture, kinematics = rig.array.fixture, rig.motion.arm.kinematics
    middle = 0.5 * (kinematics.lower_rad + kinematics.upper_rad)
    for joints in (middle, middle + 0.3):
        # Without tables the four of the paper sit around the axis of the tool, so that the grip is the tool.
        world_from_tool = bare.motion.arm.kinematics.forward(joints)
        world_from_sensor = kinematics.forward(joints) @ fixture.grip_from_sensor
        for found, (place, axis) in zip(world_from_sensor, PLACES.values(), strict=True):
            np.testing.assert_allclose(found[:3, 3], (world_from_tool @ np.append(place, 1.0))[:3], atol=1e-12)
            np.testing.assert_allclose(found[:3, 2], world_from_tool[:3, :3] @ axis, atol=1e-12)
