"""`surfuse init`: the files that it writes run as they stand, in processes of their own."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from surfuse import settings
from surfuse.cli import acquire as acquire_command
from surfuse.commands.machine.starter import SHIPPED, shipped
from surfuse.errors import SurfuseError
from surfuse.exporters import nc

ROOT = Path(__file__).parents[2]
# A script has nobody to ask before the first move.
YES = ["--yes"] if "yes" in acquire_command.acquire.__annotations__ else []
COMMENTED = re.compile(r"^# (\w+) = (.+?)(?:  +#.*)?$")
ALTERNATIVES = {"address": ("command",), "outline": ("width_m", "height_m"), "mesh": ("width_m", "height_m")}
ALTERNATIVES["jog"] = ALTERNATIVES["mesh"]


def surfuse(*words, folder):
    command = [sys.executable, "-m", "surfuse", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig") / "mine"
    done = surfuse("init", "mine", folder=folder.parent)
    assert done.returncode == 0, done.stderr
    assert "surfuse fuse readings.csv" in done.stdout
    return folder


def test_the_written_rig_is_scanned(written):
    done = surfuse("acquire", "--cell", "rig.toml", *YES, "--out", "run", "--json", folder=written)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["complete"] is True
    surface = nc.read(written / "run" / "surface.nc")
    height_m = 0.1 * (surface.grid.u_m - 0.05)  # the plane z = 0.1 x of the bridge, from the corner of the area
    assert np.abs(surface.height_m - height_m)[surface.mask].max() < 1e-3


def test_the_written_log_is_fused(written):
    done = surfuse("fuse", "readings.csv", "--out", "map", "--json", folder=written)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["frame_estimated"] is False
    surface = nc.read(written / "map" / "surface.nc")
    assert abs(np.nanmax(surface.height_m) - 0.012) < 1.5e-3
    assert abs(np.nanmedian(surface.height_m)) < 1e-3


def test_nothing_is_overwritten_unasked(tmp_path):
    (tmp_path / "rig.toml").write_text("mine", "utf-8")
    done = surfuse("init", folder=tmp_path)
    assert done.returncode == 6
    assert "rig.toml would be overwritten" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]
    assert (tmp_path / "rig.toml").read_text("utf-8") == "mine"
    assert surfuse("init", "--force", "-q", folder=tmp_path).returncode == 0
    assert {path.name for path in tmp_path.iterdir()} == set(SHIPPED)


def test_the_bridge_is_that_of_the_examples():
    assert shipped("bridge.py") == (ROOT / "examples" / "bridges" / "minimal.py").read_text("utf-8")


def lines_of_cell():
    return shipped("rig.toml").splitlines()


@pytest.mark.parametrize("at", [i for i, line in enumerate(lines_of_cell()) if COMMENTED.match(line)])
def test_each_commented_key_of_the_cell_file_is_one(at, tmp_path):
    lines = lines_of_cell()
    key = COMMENTED.match(lines[at])[1]
    lines[at] = lines[at].removeprefix("# ")
    kept = [line for line in lines if line.split(" ")[0] not in ALTERNATIVES.get(key, ())]
    (tmp_path / "rig.toml").write_text("\n".join(kept), "utf-8")
    try:
        found = settings.load(tmp_path / "rig.toml")
    except SurfuseError as error:
        pytest.fail(str(error))
    drivers = set(found.arm.parameters) - {"command"}
    assert drivers <= {*bridge_keys()}
    assert found.sensor[0].parameters == {}


def bridge_keys():
    from surfuse.arms.bridge import Parameters

    return Parameters.__dataclass_fields__


def test_every_key_of_the_tables_of_a_rig_stands_in_the_cell_file():
    text = shipped("rig.toml")
    elsewhere = {"parameters", "late_tilt_deg", "late_bias_m", "late_scatter_m", "world_from_mesh", "corners_m"}
    for model in (settings.rig_tables.SensorSettings, settings.rig_tables.AreaSettings):
        for key in set(model.model_fields) - elsewhere:
            assert re.search(rf"^(# )?{key} = ", text, re.MULTILINE), key
