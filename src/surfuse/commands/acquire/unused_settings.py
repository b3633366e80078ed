"""Settings that are given but do nothing with the others: told, because nobody gives a value in order to be ignored."""

from __future__ import annotations

from pathlib import Path

from surfuse.settings import NO_BUS, Settings
from surfuse.settings.changes import changed


def unused(settings: Settings) -> tuple[str, ...]:
    """One sentence for every value that was changed and has no effect, with the reason."""
    given = changed(settings)
    return tuple(
        f"{key} has no effect {why}"
        for key in given
        for prefixes, why in _without_effect(settings)
        if key.startswith(prefixes)
    )


def _without_effect(settings: Settings) -> list[tuple[tuple[str, ...], str]]:
    """Beginnings of keys that do nothing, and why."""
    arm, interface = settings.arm, settings.bus.interface
    found: list[tuple[tuple[str, ...], str]] = []
    if settings.scan.mode == "stops":
        found.append((("scan.pings", "scan.speed_m_s"), "with scan.mode = 'stops'"))
    if arm.driven_by == "kinematic":
        found.append((("arm.law", "arm.settle_deg", "arm.fixture_kg"), "with arm.driver = 'kinematic'"))
    if arm.file is None:
        found.append((("arm.ready_deg", "arm.joint_speed", "arm.joint_acceleration"), "without arm.file"))
    if interface in (NO_BUS, "virtual"):
        keys: tuple[str, ...] = ("bus.channel", "bus.port", "bus.connect", "bus.tether")
        without: tuple[str, ...] = ("bus.node", "bus.bitrate_bps") if interface == NO_BUS else ()
        found.append((keys + without, f"with bus.interface = '{interface}'"))
    elif interface != "udp_multicast":
        found.append((("bus.port",), f"with bus.interface = '{interface}'"))
    if not Path(settings.scene.name).suffix:
        found.append((("scene.scale", "scene.up"), f"on the scene '{settings.scene.name}', which is no mesh file"))
    return found
