"""Listing of devices on folders that look like /sys and /dev; on this machine it must only not fail."""

from pathlib import Path

import pytest

from surfuse.node.discovery import Devices, find_devices, hint_of_usb
from surfuse.sensors.iio import MODELS


def write(root: Path, name: str, text: str) -> None:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text + "\n")


@pytest.fixture
def machine(tmp_path):
    system, devices = tmp_path / "sys", tmp_path / "dev"
    write(system, "class/net/can0/type", "280")
    write(system, "class/net/can0/operstate", "down")
    write(system, "class/net/can1/type", "280")
    write(system, "class/net/can1/operstate", "up")
    write(system, "class/net/eth0/type", "1")
    write(system, "bus/usb/devices/1-1/idVendor", "1d50")
    write(system, "bus/usb/devices/1-1/idProduct", "606f")
    write(system, "bus/usb/devices/1-2/idVendor", "dead")
    write(system, "bus/usb/devices/1-2/idProduct", "beef")
    write(system, "bus/iio/devices/iio:device0/name", "vl53l1x")
    write(system, "bus/iio/devices/iio:device0/in_distance_raw", "5")
    write(system, "bus/iio/devices/trigger0/name", "sysfstrig")
    write(system, "class/video4linux/video10/name", "USB Camera")
    for name in ("video10", "video2", "videofoo", "ttyUSB0"):
        write(devices, name, "")
    return system, devices


def test_what_is_there_is_listed(machine):
    found = find_devices(*machine)
    assert [(adapter.interface, adapter.channel, adapter.up) for adapter in found.can_adapters] == [
        ("socketcan", "can0", False),
        ("socketcan", "can1", True),
        ("gs_usb", "usb 1-1", None),
    ]
    assert "restart-ms" in found.can_adapters[0].hint
    assert [Path(camera.device).name for camera in found.cameras] == ["video2", "video10"]
    assert found.cameras[1].name == "USB Camera"
    (iio,) = found.iio_devices
    assert (iio.name, iio.channels, iio.model) == ("vl53l1x", ("in_distance",), "vl53l1x")
    assert "slcan" in found.interfaces


def test_nothing_there_is_an_empty_list(tmp_path):
    found = find_devices(tmp_path / "no sys", tmp_path / "no dev")
    assert (found.can_adapters, found.cameras, found.iio_devices) == ((), (), ())


def test_nothing_is_written_or_opened_for_writing(machine):
    before = {path: path.stat().st_mtime_ns for root in machine for path in root.rglob("*")}
    find_devices(*machine)
    assert {path: path.stat().st_mtime_ns for root in machine for path in root.rglob("*")} == before


def test_this_machine_can_be_listed():
    assert isinstance(find_devices(), Devices)


def test_hints_name_plug_ins_that_exist():
    from surfuse.node import discovery

    assert set(discovery._IIO_HINTS.values()) <= set(MODELS)
    assert hint_of_usb("1D50:606F") == "CAN adapter: gs_usb"
    assert hint_of_usb("0000:0000") == ""
