"""What is plugged into this machine and what can drive it, for people and for machines."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from surfuse import registry
from surfuse.commands.outcome import Outcome
from surfuse.node.discovery import CanAdapter, Devices, IioDevice, SerialPort, find_devices

DRIVERS = ("arms", "cameras", "sensors")
_UP = {True: "up", False: "down", None: "state unknown"}


def devices(sys_root: Path = Path("/sys"), dev_root: Path = Path("/dev")) -> Outcome:
    """List serial ports, CAN adapters, cameras and IIO devices without opening any of them; then the drivers."""
    found = find_devices(sys_root, dev_root)
    listings = {kind: registry.listing(kind) for kind in DRIVERS}
    drivers = {kind: [asdict(one) for one in listing.plug_ins] for kind, listing in listings.items()}
    left_out = [line for listing in listings.values() for line in listing.left_out]
    rows = _rows(found)
    for kind, listing in listings.items():
        rows += [(f"{registry.NOUNS[kind]} {one.name}", _driver(one)) for one in listing.plug_ins]
    rows += [("note", line) for line in left_out]
    return Outcome({**asdict(found), "drivers": drivers, "left_out": left_out}, rows)


def _driver(one: registry.Listed) -> str:
    return "; ".join(filter(None, (one.summary, one.needs)))


def _rows(found: Devices) -> list[tuple[str, str]]:
    rows = [(f"serial {port.device}", _serial(port)) for port in found.serial_ports]
    rows += [(f"can {adapter.interface} {adapter.channel}", _adapter(adapter)) for adapter in found.can_adapters]
    rows += [(f"camera {camera.device}", camera.name or "no name") for camera in found.cameras]
    rows += [(f"iio {device.folder}", _iio(device)) for device in found.iio_devices]
    if not rows:
        rows.append(("devices", "none found"))
    rows.append(("python-can", ", ".join(found.interfaces) or "not installed"))
    return rows + [("note", text) for text in found.notes]


def _serial(port: SerialPort) -> str:
    usb = f"[{port.usb_id}]" if port.usb_id else "on the board, not USB"
    told = " ".join(filter(None, (port.description, usb)))
    return f"{told}: {port.hint or 'what is on it is not known'}"


def _adapter(adapter: CanAdapter) -> str:
    return _UP[adapter.up] + (f"; {adapter.hint}" if adapter.hint else "")


def _iio(device: IioDevice) -> str:
    use = f"; plug-in iio, model '{device.model}'" if device.model else "; no plug-in knows it"
    return f"{device.name} ({', '.join(device.channels) or 'no channels'}){use}"
