"""Random pictures of the cell under hard conditions, with the pixels that truly show the part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from surfuse.cameras import REFERENCE_MODEL
from surfuse.interfaces import Generator
from surfuse.records import BoolArray, ByteArray
from surfuse.rig.mounts import looking_outwards, world_from_shoulder
from surfuse.twin.materials import Material
from surfuse.twin.optics import OpticsParameters, render, visible
from surfuse.twin.scene import Scene, SceneBody, TableParameters, table_bodies
from surfuse.twin.shapes import box, cylinder, standing

_CAMERA_M = (0.10, 1.30)


@dataclass(frozen=True)
class StudyPicture:
    """What makes one condition: the part, and the light it is seen in."""

    part: SceneBody
    optics: OpticsParameters


def _even(g: Generator) -> OpticsParameters:
    return OpticsParameters(background=g.uniform(8.0, 30.0))


def _part(g: Generator, material: Material = Material.PART, low: float = 0.10, high: float = 0.25) -> SceneBody:
    """A block or a cylinder on the table, in view."""
    azimuth, radius = g.uniform(-0.12, 0.12), g.uniform(1.0, 1.1)
    width, height = g.uniform(low, high, 2)
    if g.random() < 0.5:
        solid = box(width, min(width, 0.08), height)
    else:
        solid = cylinder(min(0.5 * width, 0.07), height)
    return standing(solid, material, azimuth, radius, TableParameters().table_height_m, g.uniform(-0.5, 0.5))


def _plain(g: Generator) -> StudyPicture:
    return StudyPicture(_part(g), _even(g))


def _gradient(g: Generator) -> StudyPicture:
    x, y = g.uniform(0.5, 1.0, 2) * g.choice([-1.0, 1.0], 2)
    return StudyPicture(_part(g), OpticsParameters(background=g.uniform(20.0, 45.0), gradient_x=x, gradient_y=y))


def _low_contrast(g: Generator) -> StudyPicture:
    return StudyPicture(_part(g, Material.CLUTTER), OpticsParameters(background=g.uniform(35.0, 55.0), exposure=260.0))


def _noise(g: Generator) -> StudyPicture:
    return StudyPicture(
        _part(g), OpticsParameters(background=g.uniform(20.0, 40.0), noise_levels=g.uniform(15.0, 30.0))
    )


def _small(g: Generator) -> StudyPicture:
    return StudyPicture(_part(g, low=0.025, high=0.045), _even(g))


def _shiny(g: Generator) -> StudyPicture:
    """The lamp hangs low enough for its highlight to be seen on an upright surface."""
    part = _part(g, Material.PART_SMOOTH)
    lamp = (0.0, g.uniform(-0.5, 0.5), g.uniform(1.4, 1.8))
    gloss = g.uniform(150.0, 400.0)
    return StudyPicture(part, OpticsParameters(lamp, ambient=0.1, exposure=150.0, gloss=gloss, background=20.0))


CONDITIONS: dict[str, Callable[[Generator], StudyPicture]] = {
    "plain": _plain,
    "illumination gradient": _gradient,
    "low contrast": _low_contrast,
    "noise": _noise,
    "small part": _small,
    "shiny part": _shiny,
}


def photographed(chosen: StudyPicture, generator: Generator) -> tuple[ByteArray, BoolArray]:
    """The picture (H, W) of the cell with the part, and the pixels (H, W) that show the part."""
    scene = Scene((*table_bodies(), chosen.part))
    place = world_from_shoulder(0.0) @ looking_outwards(*_CAMERA_M)
    picture = render(scene, REFERENCE_MODEL, place, generator, chosen.optics)
    return picture, visible(scene, REFERENCE_MODEL, place, len(scene.bodies) - 1)
