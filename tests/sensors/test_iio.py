"""IIO rangers on a folder that looks like `/sys/bus/iio/devices/iio:device0`."""

import errno
import math
from pathlib import Path
from types import SimpleNamespace

import pytest

from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import SensorSurroundings
from surfuse.records import Status
from surfuse.sensors.iio import MODELS, SPEC, IioRanger, Parameters, create


def device(tmp_path: Path, **files: str) -> Path:
    folder = tmp_path / "iio:device0"
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def fire(folder, model="vl53l1x", **more):
    around = SensorSurroundings(SimpleNamespace(now_s=lambda: 12.5))
    with create(Parameters(folder, model, surroundings=around, **more)) as sensor:
        return sensor.fire()


def test_a_distance_is_raw_times_scale(tmp_path):
    echo = fire(device(tmp_path, in_distance_raw="431\n", in_distance_scale="0.001000000\n"))
    assert (echo.status, echo.t_s, echo.count) == (Status.OK, 12.5, 1)
    assert echo.range_m == pytest.approx(0.431)
    assert SPEC is MODELS["vl53l1x"].spec


def test_an_offset_is_added_before_the_scale(tmp_path):
    folder = device(tmp_path, in_distance_raw="431", in_distance_scale="0.001", in_distance_offset="-20")
    assert fire(folder).range_m == pytest.approx(0.411)


@pytest.mark.parametrize(
    ("model", "raw", "scale", "status"),
    [
        ("vl53l1x", "39", "0.001", Status.TOO_CLOSE),
        ("vl53l1x", "0", "0.001", Status.TOO_CLOSE),
        ("vl53l1x", "8190", "0.001", Status.NO_ECHO),
        ("vl53l0x", "2001", "0.001", Status.NO_ECHO),
        ("srf04", "300", "0.01", Status.OK),
        ("mb1232", "766", "0.01", Status.NO_ECHO),
        ("vl53l1x", "-5", "0.001", Status.FAULT),
        ("vl53l1x", "", "0.001", Status.FAULT),
        ("vl53l1x", "many", "0.001", Status.FAULT),
        ("vl53l1x", "\xff\xfe", "0.001", Status.FAULT),
    ],
)
def test_what_is_no_distance_is_no_number(tmp_path, model, raw, scale, status):
    folder = device(tmp_path, in_distance_scale=scale)
    (folder / "in_distance_raw").write_bytes(raw.encode("latin-1"))
    echo = fire(folder, model)
    assert echo.status is status
    assert math.isfinite(echo.range_m) == (status is Status.OK)


@pytest.mark.parametrize(
    ("model", "word", "status"),
    [("vl53l1x", word, Status.FAULT) for word in (1, 2, 4, 5, 7, 255)]
    + [("vl53l1x", 0, Status.OK), ("vl53l1x", 13, Status.TOO_CLOSE)]
    + [("vl53l5cx", 5, Status.OK), ("vl53l5cx", 9, Status.OK), ("vl53l5cx", 0, Status.FAULT)],
)
def test_the_status_word_decides(tmp_path, model, word, status):
    folder = device(tmp_path, in_distance_raw="431", in_distance_scale="0.001", in_distance_status=str(word))
    assert fire(folder, model, status_file="in_distance_status").status is status


def test_a_zone_of_an_array_is_a_channel(tmp_path):
    folder = device(tmp_path, in_distance7_raw="812", in_distance7_scale="0.001")
    assert fire(folder, "vl53l5cx", channel="in_distance7").range_m == pytest.approx(0.812)


class Failing(IioRanger):
    code = 0

    def _text(self, name):
        if name.endswith("_raw"):
            raise OSError(self.code, "from the driver")
        return super()._text(name)


@pytest.mark.parametrize("code", [errno.EIO, errno.ETIMEDOUT, errno.EREMOTEIO])
def test_a_read_that_fails_is_a_fault(tmp_path, code):
    folder = device(tmp_path, in_distance_raw="1", in_distance_scale="0.001")
    with Failing(Parameters(folder, "srf04")) as sensor:
        sensor.code = code
        assert sensor.fire().status is Status.FAULT


def test_a_device_that_vanishes_is_an_error(tmp_path):
    folder = device(tmp_path, in_distance_raw="431", in_distance_scale="0.001")
    with create(Parameters(folder, "vl53l1x")) as sensor:
        (folder / "in_distance_raw").unlink()
        with pytest.raises(DeviceError, match="vanished"):
            sensor.fire()


def test_a_folder_without_the_channel_says_what_it_has(tmp_path):
    folder = device(tmp_path, in_proximity_raw="5")
    with pytest.raises(DeviceError, match="in_proximity_raw"), create(Parameters(folder, "vl53l1x")):
        pass


@pytest.mark.parametrize("scale", ["", "x", "0", "-1", "nan", "inf"])
def test_a_scale_that_is_none_is_an_error(tmp_path, scale):
    folder = device(tmp_path, in_distance_raw="431", in_distance_scale=scale)
    with pytest.raises(DeviceError, match="in_distance_scale"), create(Parameters(folder, "vl53l1x")):
        pass


def test_parameters_have_limits(tmp_path):
    with pytest.raises(ConfigError, match="did you mean 'vl53l1x'"):
        Parameters(tmp_path, "vl53l1")
    with pytest.raises(ConfigError, match="channel"):
        Parameters(tmp_path, "srf04", channel="../../etc/passwd")
    with pytest.raises(ConfigError, match="status_file"):
        Parameters(tmp_path, "srf04", status_file="/etc/passwd")
