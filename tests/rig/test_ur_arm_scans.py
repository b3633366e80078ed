"""An arm of Universal Robots through the whole job: its library, RTDE on loopback, rangers on serial lines."""

from __future__ import annotations

import importlib.util
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import SafetyStopError
from surfuse.exporters import nc
from surfuse.runs.log_reader import read_log
from surfuse.settings import load

for package in ("rtde_receive", "serial", "mujoco"):
    pytest.importorskip(package)
if not sys.platform.startswith("linux"):
    pytest.skip("other loopback addresses than 127.0.0.1 need Linux", allow_module_level=True)

ARMS = Path(__file__).parents[1] / "arms"
# The ports of the protocol are fixed, so the twin gets an address of its own.
ADDRESS = f"127.75.{os.getpid() // 250 % 250 + 1}.{os.getpid() % 250 + 1}"
LIGHT = 'kind = "tof"\nbeam_full_angle_deg = 2.0\nrange_min_m = 0.2\nrange_max_m = 4.0\nsigma_m = 0.0003\n'
SOUND = (
    'kind = "ultrasonic"\nbeam_full_angle_deg = 13.0\nrange_min_m = 0.33\nrange_max_m = 4.0\nsigma_m = 0.0003\n'
    "frequency_hz = 63000.0\naperture_m = 0.04\ndead_length_m = 0.2\n"
)
NOISE_M = 0.001


def six() -> str:
    spec = importlib.util.spec_from_file_location("test_model_file", ARMS / "test_model_file.py")
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found.SIX


def cell(arm: str) -> str:
    c, s = math.cos(math.radians(35.0)), math.sin(math.radians(35.0))
    corner = [1.12 * c - 0.05 * s, 1.12 * s + 0.05 * c, 1.06]
    return (
        f'[arm]\n{arm}\n[[sensor]]\nname = "light"\ndriver = "tfmini"\nmodel = "tfmini-plus"\n'
        'timeout_s = 60.0\nport = "?"\n'
        f"position_m = [0.02, 0.0, 0.03]\nfiring_time_s = 0.125\n{LIGHT}"
        f'[[sensor]]\nname = "sound"\ndriver = "maxbotix"\nmodel = "hrxl-5m"\n'
        'timeout_s = 60.0\nport = "?"\n'
        f"position_m = [-0.02, 0.0, 0.03]\nfiring_time_s = 0.125\n{SOUND}"
        f"[area]\norigin_m = {corner}\nu = [{s}, {-c}, 0.0]\nv = [0.0, 0.0, 1.0]\nwidth_m = 0.06\nheight_m = 0.03\n"
        '[scene]\nname = "flat"\n[scan]\nstep_m = 0.02\nstandoff_m = 0.4337\n[fusion]\nmethod = "median"\n'
    )


class Twin:
    """The wired twin in a process of its own: `cell` is the file with its addresses."""

    def __init__(self, folder: Path) -> None:
        arm, file = folder / "six.xml", folder / "rig.toml"
        arm.write_text(six(), "utf-8")
        base = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.9, 0.0, 0.0, 0.0, 1.0]
        file.write_text(
            cell(
                f'driver = "ur_rtde"\nhost = "{ADDRESS}"\nfile = "{arm}"\ntool = "flange"\nworld_from_base = {base}\n'
                "joint_speed_deg_s = 1000.0\njoint_acceleration_deg_s2 = 10000.0\nsettle_s = 0.03\n"
                "grace_s = 300.0\nanswer_timeout_s = 60.0"
            ),
            "utf-8",
        )
        self.cell = folder / "wired.toml"
        command = [sys.executable, str(ARMS / "wired_ur.py"), str(file), str(self.cell)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout.readline() == "ready\n"

    def tell(self, order: str) -> None:
        self.process.stdin.write(order + "\n")
        self.process.stdin.flush()
        assert self.process.stdout.readline() == "done\n"

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait(300)
        self.process.stdout.close()


@pytest.fixture
def twin(tmp_path):
    started = Twin(tmp_path)
    yield started
    started.close()


class Orders(SilentWatcher):
    """Gives the twin an order after so many sweeps."""

    def __init__(self, twin: Twin, order: str, after: int) -> None:
        self.twin, self.order, self.left = twin, order, after

    def advance(self, steps: int = 1) -> None:
        self.left -= steps
        if self.left == 0:
            self.twin.tell(self.order)


def test_a_scan_with_a_protective_stop_gives_the_map_of_the_twin_in_this_process(twin, tmp_path):
    with pytest.raises(SafetyStopError, match=r"safety mode 3 \(protective stop\).*surfuse resume") as stopped:
        acquire(load(twin.cell), tmp_path / "outside", Orders(twin, "stop", 4), yes=True)
    assert stopped.value.exit_status == 5
    assert len(read_log(tmp_path / "outside").sweeps) == 4
    twin.tell("unlock")
    assert resume(tmp_path / "outside", SilentWatcher(), yes=True).complete
    (tmp_path / "cell.toml").write_text(cell('driver = "kinematic"'), "utf-8")
    acquire(load(tmp_path / "cell.toml", ["bus.interface=none"]), tmp_path / "inside", SilentWatcher())
    inside, outside = (read_log(tmp_path / name).readings() for name in ("inside", "outside"))
    for number, step_m in ((0, 0.01), (1, 0.001)):
        off_m = outside.range_m[outside.sensor == number] - inside.range_m[inside.sensor == number]
        assert np.abs(off_m).max() < 0.5 * step_m + NOISE_M
    one, other = (nc.read(tmp_path / name / "surface.nc") for name in ("inside", "outside"))
    assert other.mask.all()
    assert np.abs(one.height_m - other.height_m).max() < 0.5 * 0.01 + NOISE_M
