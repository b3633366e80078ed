"""The twin of a cell file, each device behind its maker's protocol: the map is that of the twin in this process."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.acquire.acquisition import acquire
from surfuse.commands.machine.bridge_program import with_wires
from surfuse.commands.machine.doctor import doctor
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import ConfigError
from surfuse.exporters import nc
from surfuse.records import Echo, Status
from surfuse.rig.simulated.wires.frames import encoder
from surfuse.rig.simulated.wires.wired_twin import WiredTwin
from surfuse.runs.log_reader import read_log
from surfuse.sensors import a02yyuw, maxbotix, tfmini
from surfuse.settings import load

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals")
SOUND = (
    'kind = "ultrasonic"\nbeam_full_angle_deg = 13.0\nrange_min_m = 0.33\nrange_max_m = 4.0\nsigma_m = 0.0003\n'
    "frequency_hz = 63000.0\naperture_m = 0.04\ndead_length_m = 0.2\nfiring_time_s = 0.125\n"
    "incidence_limit_deg = 25.0\n"
)
LIGHT = (
    'kind = "tof"\nbeam_full_angle_deg = 2.0\nrange_min_m = 0.2\nrange_max_m = 4.0\nsigma_m = 0.0003\n'
    "firing_time_s = 0.125\nincidence_limit_deg = 60.0\n"
)
# Driver with its keys, what it is in the twin, and half of the step in which it counts.
DEVICES = {
    "tfmini": ('driver = "tfmini"\nmodel = "tfmini-plus"\ntimeout_s = 60.0\nport = "?"', LIGHT, 0.005),
    "maxbotix": ('driver = "maxbotix"\nmodel = "hrxl-5m"\ntimeout_s = 60.0\nport = "?"', SOUND, 0.0005),
    "inches": ('driver = "maxbotix"\nmodel = "lv"\ntimeout_s = 60.0\nport = "?"', SOUND, 0.0127),
    "a02yyuw": ('driver = "a02yyuw"\ntimeout_s = 60.0\nport = "?"', SOUND, 0.0005),
    "kit": ('driver = "ranging_kit"\ntimeout_s = 60.0\nport = "?"', SOUND, 0.0),
    "iio": ('driver = "iio"\nmodel = "vl53l1x"\nfolder = "?"', LIGHT, 0.0005),
    "node": ('driver = "node"', SOUND, 0.0001),
    "bridge": ("", SOUND, 0.0),
}
COUNTED = ("tfmini", "maxbotix", "inches", "a02yyuw", "iio")
# Noise of the twin's pings, averaged; every rig draws its own.
NOISE_M = 0.001


def cell(arm: str, channel: str) -> str:
    c, s = math.cos(math.radians(35.0)), math.sin(math.radians(35.0))
    corner = [1.12 * c - 0.05 * s, 1.12 * s + 0.05 * c, 1.06]
    sensors = "".join(
        f'[[sensor]]\nname = "{name}"\n{driver}\nposition_m = {[0.03 * math.cos(k), 0.03 * math.sin(k), 0.0]}\n{what}'
        for k, (name, (driver, what, _)) in enumerate(DEVICES.items())
    )
    area = f"[area]\norigin_m = {corner}\nu = [{s}, {-c}, 0.0]\nv = [0.0, 0.0, 1.0]\nwidth_m = 0.1\nheight_m = 0.05\n"
    bus = f'[bus]\ninterface = "virtual"\nchannel = "{channel}"\n'
    scene = '[scene]\nname = "flat"\n'
    scan = '[scan]\nstep_m = 0.025\nstandoff_m = 0.4337\n[fusion]\nmethod = "median"\n'
    return f"[arm]\n{arm}\n{sensors}{bus}{scene}{area}{scan}"


def written(path: Path, text: str) -> Path:
    path.write_text(text, "utf-8")
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Runs of the twin in this process, and behind the protocols."""
    pytest.importorskip("serial")
    folder = tmp_path_factory.mktemp("wires")
    text = cell('driver = "kinematic"', "the twin")
    file = written(folder / "cell.toml", text)
    acquire(load(file, ["bus.interface=none"]), folder / "inside", SilentWatcher())
    with WiredTwin(load(file), times_faster=20.0) as twin:
        wired = written(folder / "wired.toml", with_wires(text, twin.wires))
        assert doctor(wired, []).summary["problems"] == []
        acquire(load(wired), folder / "outside", SilentWatcher(), yes=True)
    return folder / "inside", folder / "outside"


@pytest.mark.parametrize("name", DEVICES)
def test_every_device_says_what_the_twin_hears_to_within_its_step(runs, name):
    inside, outside = (read_log(run).readings() for run in runs)
    number = list(DEVICES).index(name)
    rows = inside.sensor == number
    assert (inside.status[rows] == int(Status.OK)).all()
    np.testing.assert_array_equal(outside.status[outside.sensor == number], inside.status[rows])
    off_m = np.abs(outside.range_m[outside.sensor == number] - inside.range_m[rows])
    assert off_m.max() < DEVICES[name][2] + NOISE_M
    if name in COUNTED:
        steps = outside.range_m[outside.sensor == number] / (2.0 * DEVICES[name][2])
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)


def test_the_map_is_that_of_the_twin_in_this_process(runs):
    inside, outside = (nc.read(run / "surface.nc") for run in runs)
    np.testing.assert_array_equal(outside.mask, inside.mask)
    # Most of the eight count in millimetres or finer, and the median is one of them.
    assert np.abs(outside.height_m - inside.height_m)[inside.mask].max() < 0.0005 + NOISE_M


@pytest.mark.parametrize(
    ("driver", "model", "parser"),
    [
        ("a02yyuw", None, a02yyuw.Parser),
        *(("tfmini", name, lambda name=name: tfmini.Parser(tfmini.MODELS[name])) for name in tfmini.MODELS),
        *(("maxbotix", name, lambda name=name: maxbotix.Parser(maxbotix.MODELS[name])) for name in maxbotix.MODELS),
    ],
)
def test_what_a_ranger_says_is_what_its_driver_reads(driver, model, parser):
    encode, heard = encoder(driver, {"model": model}), parser()
    step_m = {"a02yyuw": 1e-3, "tfmini": 1e-2}.get(driver) or maxbotix.MODELS[model].unit_m
    for range_m in (0.7, 1.2345, 2.0):
        (reading,) = heard.feed(encode(Echo(range_m, Status.OK, 0.0)))
        assert reading.status is Status.OK
        assert abs(reading.range_m - range_m) <= 0.5 * step_m + 1e-9
    for status, range_m in ((Status.NO_ECHO, math.inf), (Status.TOO_CLOSE, -math.inf), (Status.FAULT, math.nan)):
        found = heard.feed(encode(Echo(range_m, status, 0.0)))
        assert [reading.status for reading in found] == ([] if not found else [status])
        assert found or status is Status.FAULT  # some say nothing at all
    assert heard.rejected == 0


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            'driver = "tfmini"\nmodel = "tfmini-plus"\ntimeout_s = 60.0\nport = "?"',
            'driver = "hcsr04"',
            "does not speak for driver",
        ),
        ('driver = "kinematic"', 'driver = "gcode"', "does not speak for arm.driver = 'gcode'"),
        ('driver = "kinematic"', 'driver = "ur_rtde"', "nothing says what the arm is"),
        ('interface = "virtual"', 'interface = "none"', "bus.interface = 'none' reaches none"),
        ('driver = "node"', 'driver = "node"\nnumber = 3', "number its sensors 0, 1, 2"),
    ],
)
def test_devices_that_the_twin_does_not_speak_for_are_named(tmp_path, old, new, told):
    text = cell('driver = "kinematic"', "named")
    assert old in text
    with pytest.raises(ConfigError, match=told), WiredTwin(load(written(tmp_path / "c.toml", text.replace(old, new)))):
        pass


def test_the_command_says_where_everything_is_and_writes_the_cell_file(tmp_path):
    pytest.importorskip("serial")
    text = cell('driver = "kinematic"', "the twin").replace('driver = "node"', "")
    file, wired = written(tmp_path / "cell.toml", text), tmp_path / "wired.toml"
    command = [sys.executable, "-m", "surfuse", "bridge", "--cell", str(file), "--wires", str(wired)]
    program = subprocess.Popen([*command, "--times-faster", "20"], stderr=subprocess.PIPE, text=True)
    try:
        lines = [program.stderr.readline() for _ in range(len(DEVICES) + 2)]
        assert lines[0].startswith("arm: bridge at tcp://127.0.0.1:")
        assert lines[1].startswith("tfmini: tfmini at /dev/")
        assert f"surfuse acquire --cell {wired}" in lines[-1]
        assert doctor(wired, []).summary["problems"] == []
    finally:
        program.send_signal(signal.SIGINT)
        assert program.wait(300) == 0
        program.stderr.close()
    again = subprocess.run([*command[:-1], str(file)], capture_output=True, text=True, check=False)
    assert again.returncode == 6
    assert "would be overwritten" in again.stderr
