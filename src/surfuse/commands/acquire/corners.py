"""Corners of the area shown by hand: the user guides the arm to each, and says when it is there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surfuse.commands.acquire.job import Job
from surfuse.commands.outcome import Asker, Watcher, asked_by
from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import Echo, Fixture, FloatArray, Status
from surfuse.rig.area import outline_of
from surfuse.rig.devices import Rig
from surfuse.runs.configuration import write_configuration
from surfuse.runs.folder import RunFolder
from surfuse.settings import Settings
from surfuse.settings.rig_tables import AreaSettings

LEAST_CORNERS = 3
DONE, UNDO = "done", "undo"
_SWEEPS = 5  # the corner is where their median range ends


def with_corners(settings: Settings, rig: Rig, watcher: Watcher) -> Settings:
    """The settings with the corners that the user shows, if the area wants them; else the same object.

    The rig is open, and guided.

    Raises
    ------
    ConfigError : nobody can be asked.
    """
    area = settings.area
    if area is None or not area.jog or area.corners_m is not None:
        return settings
    asker = asked_by(watcher)
    if asker is None:
        raise nobody_asked()
    return settings.model_copy(update={"area": shown_corners(area, rig, asker)})


def job_with_corners(run: RunFolder, job: Job) -> Job:
    """The job with the corners that the user shows, which go into the run's configuration; else the same object."""
    with job.rig.guided():
        settings = with_corners(job.settings, job.rig, job.watcher)
    if settings is job.settings:
        return job
    write_configuration(run.configuration, settings.model_dump(exclude={"seed"}), settings.seed)
    return replace(job, settings=settings)


def nobody_asked() -> ConfigError:
    """What to do where nobody can show the corners."""
    return ConfigError(
        "[area] jog = true asks for corners shown by hand, and there is no terminal",
        cure="run it on a terminal, or give corners_m, or width_m and height_m",
    )


def shown_corners(area: AreaSettings, rig: Rig, asker: Asker) -> AreaSettings:
    """The area with its corners (world, m), in the order in which they were shown; three or more, around an area."""
    corners: list[list[float]] = []
    said = "Guide the arm over the first corner of the area, then press Enter."
    while True:
        answer = asker.ask(said)
        if answer is None:
            raise nobody_asked()
        answer = answer.strip().lower()
        if answer == UNDO:
            del corners[-1:]
            said = f"{len(corners)} corners are left; the next one, then Enter."
        elif answer == DONE:
            found = area.model_copy(update={"corners_m": corners})
            try:
                outline_of(found)
            except DataError as error:
                said = f"{error.what[0].upper()}{error.what[1:]}: show another corner, then Enter."
                continue
            return found
        elif answer:
            said = f"'{answer}' is not understood: Enter takes a corner, '{UNDO}' drops the last, '{DONE}' ends."
        else:
            corners.append(corner(rig).tolist())
            said = _next(corners)


def _next(corners: list[list[float]]) -> str:
    where = ", ".join(f"{1e3 * value:.0f}" for value in corners[-1])
    more = f", '{DONE}' ends" if len(corners) >= LEAST_CORNERS else ""
    return f"Corner {len(corners)} is at ({where}) mm. The next one, then Enter ('{UNDO}' drops this one{more})."


def corner(rig: Rig) -> FloatArray:
    """Where the sensors look now (3,), in the world: along their mean beam, at the median range; else the tool."""
    swept = [rig.array.sweep() for _ in range(_SWEEPS)]
    world_from_grip = rig.stop_arm.standing().world_from_tool
    ahead = [_ahead_m(echoes, rig.array.fixture) for echoes in swept]
    heard = np.array([depth for depths in ahead for depth in depths])
    if not len(heard):
        place: FloatArray = (world_from_grip @ inverse(rig.tool_from_grip))[:3, 3]
        return place
    return transform_points(world_from_grip, np.array([0.0, 0.0, float(np.median(heard))]))


def _ahead_m(echoes: tuple[Echo, ...], fixture: Fixture) -> list[float]:
    """How far ahead of the grip, along its axis, each sensor met something."""
    return [
        float(place[2, 3] + echo.range_m * place[2, 2])
        for echo, place in zip(echoes, fixture.grip_from_sensor, strict=True)
        if echo.status is Status.OK
    ]
