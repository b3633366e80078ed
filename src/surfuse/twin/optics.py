"""The camera's picture of the twin: ray casting, Lambert shading, blur and sensor noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import cv2
import numpy as np

from surfuse.errors import ConfigError
from surfuse.records import BoolArray, ByteArray, CameraModel, FloatArray, IntArray
from surfuse.twin.materials import Material, table_of
from surfuse.twin.scene import Scene

_REFERENCE_M = 1.0
_SHADOW_LIFT_M = 1e-4
_EDGE_LEVELS = 2.0
_FULL_SCALE = 255.0
_SHININESS = 40.0


@dataclass(frozen=True)
class OpticsParameters:
    """Light, room and sensor of the simulated camera.

    Parameters
    ----------
    light_m : place of the lamp in the world; its light is taken as parallel over the picture.
    ambient : share of the light that comes from everywhere, 0 to 1.
    exposure : grey level of a white surface that faces the lamp.
    background : grey level of what lies outside the cell: the room.
    gradient_x, gradient_y : relative change of illumination from the left to the right, from the top to the bottom.
    gloss : grey level of the lamp's highlight on smooth parts, as bright as this in its middle; 0: none.
    shadows : whether bodies cast shadows (doubles the rays).
    edge_samples : rays a pixel on a side where the picture has an edge, so that edges may lie between pixels.
    blur_px : standard deviation of the lens's blur.
    noise_levels : standard deviation of the sensor's noise in grey levels.
    """

    light_m: tuple[float, float, float] = (0.0, 0.0, 2.6)
    ambient: float = 0.35
    exposure: float = 320.0
    background: float = 16.0
    gradient_x: float = 0.0
    gradient_y: float = 0.0
    gloss: float = 0.0
    shadows: bool = False
    edge_samples: int = 4
    blur_px: float = 0.8
    noise_levels: float = 2.0

    def __post_init__(self) -> None:
        if not all(np.isfinite(self.light_m)):
            raise ConfigError(f"optics light_m = {self.light_m}", cure="give three finite coordinates in metres")
        if not 0.0 <= self.ambient <= 1.0:
            raise ConfigError(f"optics ambient = {self.ambient}", cure="give a share between 0 and 1")
        for name in ("exposure", "background", "gloss"):
            value = getattr(self, name)
            if not 0.0 <= value <= 10.0 * _FULL_SCALE:
                raise ConfigError(f"optics {name} = {value}", cure=f"give 0 to {10 * _FULL_SCALE:g} grey levels")
        for name in ("gradient_x", "gradient_y"):
            value = getattr(self, name)
            if not -2.0 <= value <= 2.0:
                raise ConfigError(f"optics {name} = {value}", cure="give a relative change between -2 and 2")
        if not 1 <= self.edge_samples <= 16:
            raise ConfigError(f"optics edge_samples = {self.edge_samples}", cure="give 1 to 16")
        for name in ("blur_px", "noise_levels"):
            value = getattr(self, name)
            if not 0.0 <= value <= 100.0:
                raise ConfigError(f"optics {name} = {value}", cure="give 0 to 100")


def render(
    scene: Scene,
    camera: CameraModel,
    world_from_camera: FloatArray,
    generator: np.random.Generator,
    parameters: OpticsParameters | None = None,
) -> ByteArray:
    """The picture (H, W) uint8 of a scene from a camera pose; the same generator state gives the same picture."""
    optics = parameters or OpticsParameters()
    shade = _radiance(scene, _rays(camera), world_from_camera, optics).reshape(camera.height_px, camera.width_px)
    shade = _antialiased(shade, scene, camera, world_from_camera, optics)
    shade *= _illumination(camera, optics)
    if optics.blur_px > 0.0:
        shade = np.asarray(cv2.GaussianBlur(shade, (0, 0), optics.blur_px), dtype=np.float32)
    if optics.noise_levels > 0.0:
        shade += np.float32(optics.noise_levels) * generator.standard_normal(shade.shape, dtype=np.float32)
    return np.clip(np.rint(shade), 0.0, _FULL_SCALE).astype(np.uint8)


def pixel_rays(camera: CameraModel, pixels: FloatArray) -> FloatArray:
    """Unit rays (N, 3) in the camera frame through pixel positions (N, 2), lens distortion undone."""
    pixels = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
    normal = cv2.undistortPoints(pixels, camera.matrix, np.array(camera.distortion)).reshape(-1, 2)
    rays = np.column_stack([normal, np.ones(len(normal))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=np.float64)


@lru_cache(maxsize=4)
def _rays(camera: CameraModel) -> FloatArray:
    """Rays (H W, 3) through all pixel centres, row after row; computed once a camera."""
    column, row = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    rays = pixel_rays(camera, np.column_stack([column.ravel(), row.ravel()]))
    rays.setflags(write=False)
    return rays


def _radiance(scene: Scene, rays: FloatArray, world_from_camera: FloatArray, optics: OpticsParameters) -> FloatArray:
    """Grey level (N,) float32 that each ray (N, 3) of the camera frame sees, before lens and sensor."""
    directions = _single(rays) @ _single(world_from_camera[:3, :3].T)
    origin = _single(world_from_camera[:3, 3] - scene.origin_m)
    origins = np.ascontiguousarray(np.broadcast_to(origin, directions.shape))
    triangle = scene.first_triangle(origins, directions)
    to_light = _light_direction(world_from_camera, optics)
    table = np.append(_shading(scene, world_from_camera[:3, 3], to_light, optics), optics.background)
    shade = table.astype(np.float32)[triangle]
    if optics.gloss > 0.0:
        shade += _highlights(scene, world_from_camera[:3, 3], directions, triangle, to_light, optics.gloss)
    if optics.shadows:
        dark = _shaded(scene, world_from_camera[:3, 3], directions, triangle, to_light)
        unlit = np.append(optics.exposure * optics.ambient * table_of("albedo")[scene.material], 0.0)
        shade[dark] = unlit.astype(np.float32)[triangle[dark]]
    return np.asarray(shade)


def _single(array: FloatArray) -> FloatArray:
    """The array in single precision, as the ray caster wants it."""
    return cast(FloatArray, array.astype(np.float32))


def _light_direction(world_from_camera: FloatArray, optics: OpticsParameters) -> FloatArray:
    """Unit direction to the lamp, from one metre in front of the camera."""
    there = world_from_camera[:3, 3] + _REFERENCE_M * world_from_camera[:3, 2]
    direction = np.array(optics.light_m) - there
    return np.asarray(direction / max(float(np.linalg.norm(direction)), 1e-9))


def _shading(scene: Scene, eye_m: FloatArray, to_light: FloatArray, optics: OpticsParameters) -> FloatArray:
    """Grey level (F,) of every triangle by Lambert's law; the side that the camera sees is the lit one."""
    facing = np.where(scene.normal @ eye_m >= scene.offset_m, 1.0, -1.0)
    direct = np.maximum(facing * (scene.normal @ to_light), 0.0)
    light = optics.ambient + (1.0 - optics.ambient) * direct
    return np.asarray(optics.exposure * table_of("albedo")[scene.material] * light)


def _highlights(
    scene: Scene, eye_m: FloatArray, directions: FloatArray, triangle: IntArray, to_light: FloatArray, gloss: float
) -> FloatArray:
    """Grey level (N,) float32 that the lamp's highlight adds on smooth parts (J. F. Blinn, SIGGRAPH 1977)."""
    added = np.zeros(len(triangle), np.float32)
    smooth = np.flatnonzero((triangle >= 0) & (scene.material[triangle] == Material.PART_SMOOTH))
    hit = triangle[smooth]
    facing = np.where(scene.normal[hit] @ eye_m >= scene.offset_m[hit], 1.0, -1.0)
    half = to_light - directions[smooth]
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-9)
    added[smooth] = gloss * np.maximum(facing * np.einsum("ij,ij->i", scene.normal[hit], half), 0.0) ** _SHININESS
    return np.asarray(added)


def visible(scene: Scene, camera: CameraModel, world_from_camera: FloatArray, body: int) -> BoolArray:
    """The pixels (H, W) whose middle shows the body of this index: the true mask of a picture."""
    directions = _single(_rays(camera)) @ _single(world_from_camera[:3, :3].T)
    origin = _single(world_from_camera[:3, 3] - scene.origin_m)
    triangle = scene.first_triangle(np.ascontiguousarray(np.broadcast_to(origin, directions.shape)), directions)
    seen = (triangle >= 0) & (scene.body[triangle] == body)
    return np.asarray(seen.reshape(camera.height_px, camera.width_px))


def _shaded(
    scene: Scene, eye_m: FloatArray, directions: FloatArray, triangle: IntArray, to_light: FloatArray
) -> IntArray:
    """Indices of the rays whose hit point does not see the lamp."""
    met = np.flatnonzero(triangle >= 0)
    hit = triangle[met]
    rays = directions[met].astype(np.float64)
    distance = (scene.offset_m[hit] - scene.normal[hit] @ eye_m) / np.einsum("ij,ij->i", scene.normal[hit], rays)
    points = eye_m + (distance[:, None] * rays) + _SHADOW_LIFT_M * (to_light - rays)
    _, blocker = scene.cast(points, np.broadcast_to(to_light, points.shape))
    return np.asarray(met[blocker >= 0])


def _antialiased(
    shade: FloatArray, scene: Scene, camera: CameraModel, world_from_camera: FloatArray, optics: OpticsParameters
) -> FloatArray:
    """Cast several rays a pixel where neighbours differ, as a pixel collects light over its area."""
    side = optics.edge_samples
    if side == 1:
        return shade
    kernel = np.ones((3, 3), np.uint8)
    contrast = cv2.subtract(cv2.dilate(shade, kernel), cv2.erode(shade, kernel))
    row, column = np.nonzero(contrast > _EDGE_LEVELS)
    if len(row) == 0:
        return shade
    step = (np.arange(side) + 0.5) / side - 0.5
    x = np.repeat(column, side * side) + np.tile(np.tile(step, side), len(row))
    y = np.repeat(row, side * side) + np.tile(np.repeat(step, side), len(row))
    fine = _radiance(scene, pixel_rays(camera, np.column_stack([x, y])), world_from_camera, optics)
    shade[row, column] = fine.reshape(len(row), -1).mean(axis=1)
    return shade


@lru_cache(maxsize=4)
def _illumination(camera: CameraModel, optics: OpticsParameters) -> FloatArray:
    """Relative illumination (H, W) float32: 1 in the middle, rising or falling towards the sides."""
    x, y = np.linspace(-0.5, 0.5, camera.width_px), np.linspace(-0.5, 0.5, camera.height_px)
    return _single(np.maximum(1.0 + optics.gradient_x * x[None, :] + optics.gradient_y * y[:, None], 0.0))
