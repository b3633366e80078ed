"""The twin of a cell file, served behind the bridge: the same bits as in this process, also after kills."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import DeviceError, SafetyStopError
from surfuse.exporters import nc
from surfuse.runs.log_reader import read_log
from surfuse.settings import load


def cell(arm: str) -> str:
    c, s = math.cos(math.radians(35.0)), math.sin(math.radians(35.0))
    corner = [1.12 * c - 0.1 * s, 1.12 * s + 0.1 * c, 1.0]
    sensors = "".join(
        f'[[sensor]]\nname = "us{k}"\nkind = "ultrasonic"\nposition_m = [{x}, {y}, 0.0]\nbeam_full_angle_deg = 13.0\n'
        "range_min_m = 0.33\nrange_max_m = 4.0\nsigma_m = 0.0003\nfrequency_hz = 63000.0\naperture_m = 0.04\n"
        "dead_length_m = 0.2\nfiring_time_s = 0.125\n"
        for k, (x, y) in enumerate([(0.025, -0.025), (-0.025, -0.025), (0.025, 0.025), (-0.025, 0.025)])
    )
    area = f"[area]\norigin_m = {corner}\nu = [{s}, {-c}, 0.0]\nv = [0.0, 0.0, 1.0]\nwidth_m = 0.2\nheight_m = 0.2\n"
    return f'[arm]\n{arm}\n{sensors}{area}[scan]\nstep_m = 0.05\n[fusion]\nmethod = "weighted_average"\n'


class Wire:
    """`surfuse bridge` in a process of its own, on the same port every time it is started."""

    def __init__(self, folder: Path) -> None:
        self.file, self.port = folder / "twin.toml", "0"
        self.file.write_text(cell('driver = "kinematic"'))
        self.address = ""
        self.program: subprocess.Popen[str] | None = None

    def start(self) -> None:
        command = [sys.executable, "-m", "surfuse", "bridge", "--cell", str(self.file), "--port", self.port]
        self.program = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        self.address = self.program.stderr.readline().split()[4].rstrip(";")
        self.port = self.address.rpartition(":")[2]

    def kill(self) -> None:
        self.program.send_signal(signal.SIGKILL)
        self.program.communicate()


@pytest.fixture
def wire(tmp_path):
    found = Wire(tmp_path)
    found.start()
    yield found
    found.kill()


@pytest.fixture(scope="module")
def in_process(tmp_path_factory):
    folder = tmp_path_factory.mktemp("twin")
    (folder / "cell.toml").write_text(cell('driver = "kinematic"'))
    acquire(load(folder / "cell.toml"), folder / "run", SilentWatcher())
    return folder / "run"


def over(wire: Wire, folder: Path):
    path = folder / "wire.toml"
    path.write_text(cell(f'driver = "bridge"\naddress = "{wire.address}"'))
    return load(path)


def assert_same(one: Path, other: Path) -> None:
    first, second = read_log(one).readings(), read_log(other).readings()
    for column in ("range_m", "position_m", "axis", "amplitude", "spread_m", "status", "count", "world_from_grip"):
        np.testing.assert_array_equal(getattr(first, column), getattr(second, column), err_msg=column)
    a, b = nc.read(one / "surface.nc"), nc.read(other / "surface.nc")
    np.testing.assert_array_equal(a.height_m, b.height_m)
    np.testing.assert_array_equal(a.sigma_m, b.sigma_m)


def test_ctrl_c_ends_the_bridge_without_a_complaint(tmp_path):
    wire = Wire(tmp_path)
    wire.start()
    wire.program.send_signal(signal.SIGINT)
    assert wire.program.communicate(timeout=60)[1] == ""
    assert wire.program.returncode == 0


def test_a_scan_over_the_wire_is_that_of_this_process_to_the_last_bit(wire, in_process, tmp_path):
    assert acquire(over(wire, tmp_path), tmp_path / "run", SilentWatcher(), yes=True).complete
    assert_same(tmp_path / "run", in_process)


class KillsAfter(SilentWatcher):
    """Kills the bridge after so many sweeps."""

    def __init__(self, wire: Wire, sweeps: int) -> None:
        self.wire, self.left = wire, sweeps

    def advance(self, steps: int = 1) -> None:
        self.left -= steps
        if self.left == 0:
            self.wire.kill()


@pytest.mark.parametrize("sweeps", [1, 7, 20])
def test_a_killed_bridge_costs_nothing(wire, in_process, tmp_path, sweeps):
    with pytest.raises((DeviceError, SafetyStopError)):
        acquire(over(wire, tmp_path), tmp_path / "run", KillsAfter(wire, sweeps), yes=True)
    wire.start()
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert_same(tmp_path / "run", in_process)


class RestartsAfter(KillsAfter):
    """Kills the bridge after so many sweeps, and starts it again before anybody has noticed."""

    def advance(self, steps: int = 1) -> None:
        super().advance(steps)
        if self.left == 0:
            self.wire.start()


def test_a_bridge_started_again_between_two_stops_costs_nothing(wire, in_process, tmp_path):
    with pytest.raises(SafetyStopError, match=r"has moved by .* without a move"):
        acquire(over(wire, tmp_path), tmp_path / "run", RestartsAfter(wire, 7), yes=True)
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert_same(tmp_path / "run", in_process)


def test_a_killed_scan_costs_nothing(wire, in_process, tmp_path):
    over(wire, tmp_path)
    command = [sys.executable, "-m", "surfuse", "acquire", "--cell", str(tmp_path / "wire.toml"), "--yes", "--quiet"]
    scan = subprocess.Popen([*command, "--out", str(tmp_path / "run")])
    deadline = time.monotonic() + 300.0
    log = tmp_path / "run" / "log"
    while scan.poll() is None and time.monotonic() < deadline:
        if log.is_dir() and sum(file.stat().st_size for file in log.glob("*.mcap")) > 30_000:
            scan.kill()
        time.sleep(0.005)
    scan.wait()
    if (tmp_path / "run" / "report.html").is_file():
        return  # it was quicker than the kill
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert_same(tmp_path / "run", in_process)
