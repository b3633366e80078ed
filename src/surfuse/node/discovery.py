"""What is plugged into this machine: serial ports, CAN adapters, cameras, IIO devices, and what seems to be on them.

Only listings of the operating system are read; no port is opened and nothing is sent, since a port may move an arm.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from surfuse.extras import install_command

_ARPHRD_CAN = "280"
_USB_HINTS = {
    "1d50:606f": "CAN adapter: gs_usb",
    "1209:2323": "CAN adapter: gs_usb (candleLight)",
    "1209:ca01": "CAN adapter: gs_usb (CANnectivity)",
    "16d0:117e": "CAN adapter: slcan (CANable)",
    "ad50:60c4": "CAN adapter: slcan (CANable)",
    "16d0:10b8": "CAN adapter: slcan (CANable 2)",
    "0c72:000c": "CAN adapter: pcan (PEAK PCAN-USB)",
    "0c72:0012": "CAN adapter: pcan (PEAK PCAN-USB FD)",
    "0403:6001": "FTDI serial converter: MaxBotix MB14xx (usb), or a bare sensor on a converter",
    "0403:6015": "FTDI serial converter: MaxBotix MB14xx (usb), or a bare sensor on a converter",
    "10c4:ea60": "CP210x serial converter: TFmini, A02YYUW, MaxBotix or an arm; the model must be given",
    "1a86:7523": "CH340 serial converter: A02YYUW, TFmini, an Arduino or an arm; the model must be given",
    "1a86:55d3": "CH343 serial converter: often the motor bus of an SO-101 arm, keep away",
    "2341:0043": "Arduino Uno",
    "2e8a:0005": "Raspberry Pi Pico (MicroPython)",
}
_IIO_HINTS = {
    "vl53l0x": "vl53l0x",
    "vl53l1x": "vl53l1x",
    "vl53l5cx": "vl53l5cx",
    "srf04": "srf04",
    "srf04-gpio": "srf04",
    "mb1202": "mb1232",
    "mb1212": "mb1232",
    "mb1222": "mb1232",
    "mb1232": "mb1232",
    "ping": "ping",
    "laserping": "ping",
}


@dataclass(frozen=True)
class SerialPort:
    """A serial port: device file, what the system calls it, USB ids (`vid:pid`, empty: none), what is likely on it.

    `hint` names the kind of device that has these ids (empty: unknown).
    """

    device: str
    description: str
    usb_id: str
    hint: str


@dataclass(frozen=True)
class CanAdapter:
    """A CAN adapter: python-can's interface and channel, and whether it is up (None: unknown)."""

    interface: str
    channel: str
    up: bool | None
    hint: str


@dataclass(frozen=True)
class VideoDevice:
    """A camera: device file and what the driver calls it."""

    device: str
    name: str


@dataclass(frozen=True)
class IioDevice:
    """An industrial I/O device: folder, chip, and the plug-in model that fits (empty: none known)."""

    folder: str
    name: str
    channels: tuple[str, ...]
    model: str


@dataclass(frozen=True)
class Devices:
    """Everything that was found; `interfaces` are the back ends of python-can, `notes` what could not be looked at.

    Each tuple is empty where nothing was found.
    """

    serial_ports: tuple[SerialPort, ...]
    can_adapters: tuple[CanAdapter, ...]
    cameras: tuple[VideoDevice, ...]
    iio_devices: tuple[IioDevice, ...]
    interfaces: tuple[str, ...]
    notes: tuple[str, ...]


def find_devices(sys_root: Path = Path("/sys"), dev_root: Path = Path("/dev")) -> Devices:
    """List what is there, without opening anything."""
    notes: list[str] = []
    return Devices(
        serial_ports=_serial_ports(notes),
        can_adapters=_can_networks(sys_root) + _usb_adapters(sys_root),
        cameras=_cameras(sys_root, dev_root),
        iio_devices=_iio_devices(sys_root),
        interfaces=_interfaces(notes),
        notes=tuple(notes),
    )


def hint_of_usb(usb_id: str) -> str:
    """What a device with these USB ids (`vid:pid`, lower case) seems to be; empty: unknown."""
    return _USB_HINTS.get(usb_id.lower(), "")


def _serial_ports(notes: list[str]) -> tuple[SerialPort, ...]:
    try:
        from serial.tools.list_ports import comports
    except ModuleNotFoundError:
        notes.append(f"serial ports: not listed, {install_command('serial')}")
        return ()
    ports = []
    for port in sorted(comports()):
        usb_id = "" if port.vid is None or port.pid is None else f"{port.vid:04x}:{port.pid:04x}"
        # pyserial says "n/a" of a port without a description.
        told = port.description if port.description and port.description != "n/a" else ""
        ports.append(SerialPort(port.device, told, usb_id, hint_of_usb(usb_id)))
    return tuple(ports)


def _interfaces(notes: list[str]) -> tuple[str, ...]:
    try:
        import can
    except ModuleNotFoundError:
        notes.append(f"CAN: not listed, {install_command('can')}")
        return ()
    return tuple(sorted(can.VALID_INTERFACES))


def _can_networks(sys_root: Path) -> tuple[CanAdapter, ...]:
    found = []
    for folder in _sorted(sys_root / "class" / "net"):
        if _text(folder / "type") == _ARPHRD_CAN:
            up = {"up": True, "down": False}.get(_text(folder / "operstate"))
            hint = "" if up else f"ip link set {folder.name} up type can bitrate 1000000 restart-ms 100"
            found.append(CanAdapter("socketcan", folder.name, up, hint))
    return tuple(found)


def _usb_adapters(sys_root: Path) -> tuple[CanAdapter, ...]:
    found = []
    for folder in _sorted(sys_root / "bus" / "usb" / "devices"):
        hint = hint_of_usb(f"{_text(folder / 'idVendor')}:{_text(folder / 'idProduct')}")
        match = re.match(r"CAN adapter: (\w+)", hint)
        if match:
            found.append(CanAdapter(match[1], f"usb {folder.name}", None, hint))
    return tuple(found)


def _cameras(sys_root: Path, dev_root: Path) -> tuple[VideoDevice, ...]:
    names = [path.name for path in _sorted(dev_root) if re.fullmatch(r"video\d+", path.name)]
    names.sort(key=lambda name: int(name.removeprefix("video")))
    folder = sys_root / "class" / "video4linux"
    return tuple(VideoDevice(str(dev_root / name), _text(folder / name / "name")) for name in names)


def _iio_devices(sys_root: Path) -> tuple[IioDevice, ...]:
    found = []
    for folder in _sorted(sys_root / "bus" / "iio" / "devices"):
        if not folder.name.startswith("iio:device"):
            continue
        name = _text(folder / "name")
        channels = tuple(path.name.removesuffix("_raw") for path in _sorted(folder) if path.name.endswith("_raw"))
        found.append(IioDevice(str(folder), name, channels, _IIO_HINTS.get(name.lower(), "")))
    return tuple(found)


def _sorted(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


def _text(path: Path) -> str:
    try:
        return path.read_text("utf-8", errors="replace").strip()
    except OSError:
        return ""
