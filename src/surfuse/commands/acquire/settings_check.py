"""Whether settings fit one another: what cannot work is refused before the arm moves, what is doubtful is told."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surfuse.commands.acquire.unused_settings import unused
from surfuse.errors import ConfigError
from surfuse.records import ULTRASONIC, FloatArray, Outline, ScanPlan, SensorSpec
from surfuse.rig.description import sweep_time
from surfuse.settings import Settings

_ROOM_M = 0.03  # relief in front of the plane that should still be heard
_AIR_M = 0.001  # error of a range by the temperature that is worth a word
_SOUND_SHARE_PER_K = 0.5 / 293.15  # the speed of sound grows with the root of the absolute temperature
_NEARER_M = 0.02  # an edge this much nearer than the part cannot be taken for it


def refuse_contradictions(settings: Settings, specs: Sequence[SensorSpec]) -> None:
    """Refuse a standoff at which a sensor of the array hears nothing, or a real arm would run into the part.

    Raises
    ------
    ConfigError : the standoff is outside of what a sensor can hear, or below the tallest point of the part.
    """
    _refuse_taller(settings)
    standoff_m = settings.scan.standoff_m
    for spec in specs:
        what = f"scan.standoff_m = {standoff_m:g}, but '{spec.name}' hears nothing"
        if standoff_m <= spec.dead_length_m:
            raise ConfigError(
                f"{what} nearer than the {spec.dead_length_m:.3f} m of its tube",
                cure=f"give a standoff above {spec.dead_length_m + _ROOM_M:.2f}, or a shorter kit.tube_length_m",
            )
        if standoff_m <= spec.range_min_m:
            if settings.arm.is_real:
                cure = f"give a standoff above {spec.range_min_m + _ROOM_M:.2f}, or correct its range_min_m"
                raise ConfigError(f"{what} nearer than {spec.range_min_m:.3f} m", cure=cure)
            most_s = settings.kit.blanking_s * standoff_m / spec.range_min_m
            raise ConfigError(
                f"{what} nearer than {spec.range_min_m:.3f} m (kit.blanking_s = {settings.kit.blanking_s:g})",
                cure=f"give a standoff above {spec.range_min_m + _ROOM_M:.2f}, or kit.blanking_s below {most_s:.4f}",
            )
        if standoff_m >= spec.range_max_m:
            raise ConfigError(f"{what} beyond {spec.range_max_m:.3f} m", cure="give a smaller standoff")


def doubts(settings: Settings, specs: Sequence[SensorSpec], plan: ScanPlan) -> tuple[str, ...]:
    """One sentence, with value, limit and cure, for everything about a planned scan that is doubtful."""
    standoff_m = settings.scan.standoff_m
    found = [*_near_limit(settings, specs), *_beam_and_part(settings, specs, plan.outline, standoff_m)]
    if settings.arm.is_real:
        return tuple(found + _tallest(settings))
    found += [*_table_edge(settings, specs, plan), *_air(settings, standoff_m), *_disturbing(settings)]
    found += [*_hurried(settings, specs), *unused(settings)]
    return tuple(found)


def _refuse_taller(settings: Settings) -> None:
    """Refuse a part that stands higher than the sensors of a real arm travel; a record moves nothing."""
    name, tallest_m = _named_tallest(settings)
    standoff_m = settings.scan.standoff_m
    if tallest_m is None or tallest_m <= standoff_m or not settings.arm.is_real or settings.arm.is_played_back:
        return
    raise ConfigError(
        f"{name}.tallest_m = {tallest_m:g} is above scan.standoff_m = {standoff_m:g}: the sensors would be driven "
        "through the part",
        cure=f"give a standoff above {tallest_m + _ROOM_M:.2f}, or correct {name}.tallest_m if the part is lower",
    )


def _named_tallest(settings: Settings) -> tuple[str, float | None]:
    """The table that says how high the part stands over its plane, and what it says in m."""
    area = settings.area
    return ("search", settings.search.tallest_m) if area is None else ("area", area.tallest_m)


def _tallest(settings: Settings) -> list[str]:
    """Of a real rig: what stands in the way of the sensors where they travel."""
    name, tallest_m = _named_tallest(settings)
    if tallest_m is None or tallest_m < settings.scan.standoff_m - _ROOM_M:
        return []
    return [
        f"{name}.tallest_m = {tallest_m:g} leaves {1e3 * (settings.scan.standoff_m - tallest_m):.0f} mm to the sensors "
        f"at scan.standoff_m = {settings.scan.standoff_m:g}: give a standoff above {tallest_m + _ROOM_M:.2f}"
    ]


def _near_limit(settings: Settings, specs: Sequence[SensorSpec]) -> list[str]:
    nearest_m = max(max(spec.range_min_m, spec.dead_length_m) for spec in specs)
    room_m = settings.scan.standoff_m - nearest_m
    if room_m >= _ROOM_M:
        return []
    return [
        f"scan.standoff_m = {settings.scan.standoff_m:g} is only {1e3 * room_m:.0f} mm more than the nearest range of "
        f"{nearest_m:.3f} m: what stands out further is not heard; give {nearest_m + _ROOM_M:.2f} or more, or a "
        "shorter kit.blanking_s"
    ]


def _beam_and_part(settings: Settings, specs: Sequence[SensorSpec], outline: Outline, standoff_m: float) -> list[str]:
    if all(spec.kind != ULTRASONIC for spec in specs):
        return []
    beam_m = 2.0 * standoff_m * math.tan(0.5 * min(max(spec.beam_full_angle_rad for spec in specs), math.radians(170)))
    size_m = np.ptp(outline.vertices_m, axis=0) - 2.0 * outline.margin_m
    narrow_m = float(size_m.min())
    found = []
    if beam_m > narrow_m:
        found.append(
            f"the beam is {1e3 * beam_m:.0f} mm wide at scan.standoff_m = {standoff_m:g}, the part only "
            f"{1e3 * narrow_m:.0f} mm: every reading hears its edges; go nearer, or narrow the beam (kit.tube_length_m)"
        )
    if settings.step_m > beam_m:
        found.append(
            f"scan.step_m = {settings.step_m:g} is more than the beam's {1e3 * beam_m:.0f} mm: between the stops "
            f"nothing is heard; give {beam_m / 2.0:.2f} or less"
        )
    return found


def _table_edge(settings: Settings, specs: Sequence[SensorSpec], plan: ScanPlan) -> list[str]:
    """Stops at which a beam meets the near edge of the table before the part, too far away to be blanked."""
    table, half = settings.cell, math.tan(0.5 * max(spec.beam_full_angle_rad for spec in specs))
    ahead_m = _to_cylinder(plan, table.table_inner_radius_m)
    lowest_m = plan.world_from_grip[:, 2, 3] - 0.5 * settings.array.side_m - table.table_height_m
    nearest_m = min(spec.range_min_m for spec in specs)
    heard = (ahead_m > nearest_m) & (ahead_m < plan.standoff_m - _NEARER_M) & (ahead_m * half > lowest_m)
    count = int(np.count_nonzero(heard))
    if not count:
        return []
    edge_m = float(np.min(ahead_m[heard]))
    blanked = nearest_m + plan.standoff_m - edge_m
    return [
        f"at {count} of {len(plan)} stops a beam meets the table's near edge, {1e3 * edge_m:.0f} mm ahead: nearer "
        f"than the part at scan.standoff_m = {plan.standoff_m:g} and beyond the {1e3 * nearest_m:.0f} mm that are "
        f"blanked, so that the surface may seem {1e3 * (plan.standoff_m - edge_m):.0f} mm too near there; give a "
        f"standoff of at most {math.floor(100.0 * blanked) / 100.0:.2f}, or move the part towards the edge"
    ]


def _to_cylinder(plan: ScanPlan, radius_m: float) -> FloatArray:
    """Distance (N,) along each grip axis, seen from above, to a cylinder around the arm; nan where it is not ahead."""
    start, axis = plan.world_from_grip[:, :2, 3], plan.world_from_grip[:, :2, 2]
    along = np.einsum("ij,ij->i", start, axis)
    square = radius_m**2 - (np.einsum("ij,ij->i", start, start) - along**2)
    ahead = np.sqrt(np.where(square > 0.0, square, np.nan)) - along
    return np.asarray(np.where(ahead > 0.0, ahead, np.nan), dtype=np.float64)


def _air(settings: Settings, standoff_m: float) -> list[str]:
    air = settings.air
    error_m = standoff_m * _SOUND_SHARE_PER_K * (air.temperature_c - air.assumed_temperature_c)
    if abs(error_m) < _AIR_M:
        return []
    return [
        f"air.assumed_temperature_c = {air.assumed_temperature_c:g}, but the air has {air.temperature_c:g}: ranges are "
        f"off by {1e3 * abs(error_m):.1f} mm at scan.standoff_m = {standoff_m:g}; assume what it has"
    ]


def _disturbing(settings: Settings) -> list[str]:
    keys = []
    if settings.array.trigger == "simultaneous":
        keys.append("array.trigger = 'simultaneous'")
    if settings.kit.trigger == "internal":
        keys.append("kit.trigger = 'internal'")
    return [f"{key}: the sensors hear one another; triggered one after the other they do not" for key in keys]


def _hurried(settings: Settings, specs: Sequence[SensorSpec]) -> list[str]:
    """A smooth pass on which the next stop comes before the sweep of the last one is in."""
    speed_m_s = settings.scan.speed_m_s
    if settings.scan.mode != "smooth" or speed_m_s is None:
        return []
    time, step_s = sweep_time(settings, specs), settings.step_m / speed_m_s
    if time.total_s <= step_s:
        return []
    most_m_s = settings.step_m / time.total_s
    bus = f", {1e3 * time.bus_s:.1f} ms of it on the bus at bus.bitrate_bps = {settings.bus.bitrate_bps}"
    return [
        f"scan.speed_m_s = {speed_m_s:g} passes a stop every {1e3 * step_s:.0f} ms, but a sweep takes "
        f"{1e3 * time.total_s:.1f} ms{bus if time.bus_s else ''}: readings come later and later behind their stops; "
        f"give {math.floor(1e4 * most_m_s) / 1e4:g} or less{', or a faster bus' if time.firing_s <= step_s else ''}"
    ]
