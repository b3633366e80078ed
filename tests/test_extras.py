"""Without an optional package: one line with the command that brings it, exit status 3; and doctor lists them all."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from surfuse.errors import ConfigError
from surfuse.exporters import nc
from surfuse.extras import EXTRAS, install_command, missing_package, needed_by
from surfuse.records import MapGrid, SurfaceMap

_BLOCKED = """
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {modules!r}:
            raise ModuleNotFoundError(f"No module named '{{name}}'", name=name)
sys.meta_path.insert(0, Blocker())
"""
_COMMAND = "sys.argv = ['surfuse', *{words!r}]\nfrom surfuse.cli import main\nmain()\n"
_CALL = """
from surfuse.errors import SurfuseError
try:
    {call}
except SurfuseError as error:
    print('surfuse:', error, file=sys.stderr)
    sys.exit(error.exit_status)
"""
_SERIAL = """from surfuse.sensors import tfmini
    tfmini.create(tfmini.Parameters('COM9', 'tfmini')).__enter__()"""
_PINS = """from surfuse.sensors import hcsr04
    hcsr04.create(hcsr04.Parameters('GPIO23', 'GPIO24')).__enter__()"""
_ROBOT = """from surfuse.arms import ur_rtde
    from surfuse.motion.arm_surroundings import ArmSurroundings
    around = ArmSurroundings(None, None)
    ur_rtde.create(ur_rtde.Parameters('192.0.2.1', surroundings=around)).__enter__()"""
_ARM = '<mujoco><worldbody><body><joint name="j"/><geom size="0.1"/></body></worldbody></mujoco>'
MODULES = {module for extra in EXTRAS for module in extra.modules}


def without(modules: set[str], code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run code in a process in which some modules cannot be imported."""
    text = _BLOCKED.format(modules=modules) + code
    return subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False, cwd=folder)


def small_map(path: Path) -> None:
    nodes, shape = np.arange(3) * 0.01, (3, 3)
    grid = MapGrid(u_m=nodes, v_m=nodes, world_from_part=np.eye(4))
    ones = np.ones(shape, dtype=bool)
    nc.write(
        path,
        SurfaceMap(
            grid,
            np.zeros(shape),
            np.full(shape, 1e-3),
            np.ones(shape),
            ones.astype(int),
            ones,
            ones.astype(np.uint8),
            "m",
        ),
    )


@pytest.mark.parametrize(
    ("extra", "code"),
    [
        ("surface", _COMMAND.format(words=["export", "map.nc", "out.sdf"])),
        ("surface", _COMMAND.format(words=["export", "map.nc", "out.x3p"])),
        ("dynamics", _COMMAND.format(words=["acquire", "--arm", "arm.xml", "--out", "run"])),
        ("serial", _CALL.format(call=_SERIAL)),
        ("gpio", _CALL.format(call=_PINS)),
        ("ur", _CALL.format(call=_ROBOT)),
    ],
)
def test_what_needs_a_missing_extra_names_its_command(extra, code, tmp_path):
    small_map(tmp_path / "map.nc")
    (tmp_path / "arm.xml").write_text(_ARM)
    before = sorted(tmp_path.iterdir())
    answer = without(MODULES, code, tmp_path)
    assert answer.returncode == 3, answer.stderr
    (line,) = answer.stderr.splitlines()
    assert f"pip install 'surfuse[{extra}]'" in line
    assert "which is not installed" in line
    assert sorted(tmp_path.iterdir()) == before


def test_arms_of_files_do_without_the_closed_form(tmp_path):
    code = "from surfuse.arm_models.closed_form import closed_form\nimport numpy as np\n"
    code += "print(closed_form(np.eye(6, 3), np.zeros((6, 3)), np.tile(np.eye(4), (7, 1, 1))))"
    assert without({"eaik"}, code, tmp_path).stdout == "None\n"


def test_the_main_job_and_its_smooth_pass_need_no_extra(tmp_path):
    words = ["acquire", "flat", "--smooth", "--arm-driver", "kinematic", "--method", "mean", "--out", "run", "--quiet"]
    code = _COMMAND.format(words=[*words, "--set", "scan.step_m=0.05"])
    answer = without(MODULES | {"toppra", "ruckig"}, code, tmp_path)
    assert (answer.returncode, answer.stderr) == (0, "")
    assert (tmp_path / "run" / "report.html").is_file()


def test_doctor_lists_every_extra_with_its_command(tmp_path):
    # A cell that is refused: the installation is looked at all the same.
    code = _COMMAND.format(words=["doctor", "--set", "scan.step_m=-1"])
    rows = without(MODULES, code, tmp_path).stdout.splitlines()
    for extra in EXTRAS:
        (row,) = [row for row in rows if row.startswith(f"extra {extra.name} ")]
        assert "missing" in row
        assert extra.command in row
    rows = without(MODULES - {"serial"}, code, tmp_path).stdout.splitlines()
    assert any("extra serial" in row and "present" in row for row in rows)


def test_the_extras_are_those_of_the_distribution():
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8"))["project"]
    assert {extra.name for extra in EXTRAS} == set(project["optional-dependencies"]) - {"test"}


def test_a_package_that_no_extra_brings_is_a_broken_installation():
    assert install_command("scipy.linalg") == "pip install --force-reinstall surfuse"
    assert install_command("serial.tools") == "pip install 'surfuse[serial]'"
    assert "this needs the package 'scipy'" in str(missing_package(ModuleNotFoundError(name="scipy"), "this"))
    with (
        pytest.raises(ConfigError, match=r"^here: it needs the package 'mujoco'.*surfuse\[dynamics\]"),
        needed_by("it", "here"),
    ):
        raise ModuleNotFoundError("no", name="mujoco")
