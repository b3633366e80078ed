"""A pretended cartesian rig behind the bridge: a dark box on a bright table, a camera, a laser; by rays of its own.

The camera is on the tool or fixed. Everything here is told by slabs and planes, with nothing of surfuse's vision.
"""

from __future__ import annotations

import time

import numpy as np

from surfuse.bridge.messages import (
    Ability,
    ArmKind,
    ArmOfBridge,
    BridgeReading,
    CameraOfBridge,
    Hello,
    Image,
    State,
    SweepAnswer,
)
from surfuse.errors import UnreachableError
from surfuse.records import Status

TABLE_M = 0.05
WIDTH, HEIGHT, FX, FY, CX, CY = 320, 240, 300.0, 330.0, 155.0, 122.0
LOOKING_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
TABLE_LEVEL, BOX_LEVEL, SIDE_LEVEL = 190.0, 60.0, 40.0


def turned(axis: str, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array(
        {
            "x": [[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]],
            "y": [[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]],
            "z": [[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        }[axis]
    )


def moved(x: float, y: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def above(x: float, y: float, z: float = 0.6) -> np.ndarray:
    return moved(x, y, z) @ LOOKING_DOWN


# The camera hangs beside the array, turned about its axis and leaning a little.
TOOL_FROM_CAMERA = moved(0.06, -0.03, -0.02) @ turned("z", 25.0) @ turned("x", 4.0)
WORLD_FROM_CAMERA = moved(0.20, -0.15, 0.75) @ turned("z", 40.0) @ LOOKING_DOWN @ turned("x", 12.0) @ turned("y", -9.0)


class Box:
    """`size` (3,) standing on the table, turned by `degrees` about the vertical through (x, y)."""

    def __init__(self, x: float, y: float, size=(0.12, 0.07, 0.03), degrees: float = 20.0) -> None:
        self.pose, self.size = moved(x, y, TABLE_M) @ turned("z", degrees), np.array(size)

    def hit(self, start: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance along each ray (N, 3), inf without a hit, and whether the top is what is hit: by slabs."""
        turn = self.pose[:3, :3]
        begin = turn.T @ (start - self.pose[:3, 3])
        along = rays @ turn
        along = np.where(np.abs(along) < 1e-12, 1e-12, along)
        low = np.array([-self.size[0] / 2, -self.size[1] / 2, 0.0])
        a, b = (low - begin) / along, (low + self.size - begin) / along
        enter, leave = np.minimum(a, b), np.maximum(a, b)
        first, last = enter.max(axis=1), leave.min(axis=1)
        there = (first <= last) & (first > 0.0)
        return np.where(there, first, np.inf), np.argmax(enter, axis=1) == 2

    def corners(self) -> np.ndarray:
        half = self.size[:2] / 2
        flat = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
        solid = np.array([[*xy, z] for z in (0.0, self.size[2]) for xy in flat])
        return solid @ self.pose[:3, :3].T + self.pose[:3, 3]


def picture(boxes, world_from_camera, light: float = 1.0, samples: int = 3, seed: int = 1) -> np.ndarray:
    """What the camera sees (HEIGHT, WIDTH): the nearest of the table and the boxes, mean of samples, a little noise."""
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    total = np.zeros((HEIGHT, WIDTH))
    for dy in offsets:
        for dx in offsets:
            x, y = np.meshgrid(np.arange(WIDTH) + dx, np.arange(HEIGHT) + dy)
            rays = np.stack([(x - CX) / FX, (y - CY) / FY, np.ones_like(x)], axis=-1).reshape(-1, 3)
            rays = rays @ world_from_camera[:3, :3].T
            start = world_from_camera[:3, 3]
            with np.errstate(divide="ignore"):
                nearest = (TABLE_M - start[2]) / rays[:, 2]
            level = np.where(nearest > 0.0, TABLE_LEVEL, 0.0)
            nearest = np.where(nearest > 0.0, nearest, np.inf)
            for box in boxes:
                distance, top = box.hit(start, rays)
                hit = distance < nearest
                level = np.where(hit, np.where(top, BOX_LEVEL, SIDE_LEVEL), level)
                nearest = np.where(hit, distance, nearest)
            total += level.reshape(HEIGHT, WIDTH)
    noise = np.random.default_rng(seed).normal(0.0, 1.5, total.shape)
    return np.clip(light * total / samples**2 + noise, 0, 255).astype(np.uint8)


def shadow(box: Box, world_from_camera) -> np.ndarray:
    """The corners of a box (8, 2), thrown onto the table by the camera's rays: world x, y."""
    eye, corners = world_from_camera[:3, 3], box.corners()
    share = (eye[2] - TABLE_M) / (eye[2] - corners[:, 2])
    return (eye + share[:, None] * (corners - eye))[:, :2]


class BoxRig:
    """`Bridgeable`; attributes may change at any time."""

    def __init__(self, boxes, on_tool: bool = True) -> None:
        self.boxes, self.on_tool = list(boxes), on_tool
        self.pose = above(-0.25, 0.2)
        self.moves, self.pictures = [], 0
        self.light = 1.0
        self.camera: CameraOfBridge | None = CameraOfBridge(WIDTH, HEIGHT)
        self.can = frozenset({Ability.IMAGE, Ability.REACH})
        self.farthest_x_m = np.inf
        self.began_s = time.monotonic()

    @property
    def world_from_camera(self):
        return self.pose @ TOOL_FROM_CAMERA if self.on_tool else WORLD_FROM_CAMERA

    def _now_s(self):
        return time.monotonic() - self.began_s

    def hello(self):
        return Hello("a box on a table", ArmOfBridge(ArmKind.CARTESIAN), ("spot",), self.camera, self.can)

    def state(self):
        return State(self._now_s(), self.pose)

    def reach(self, world_from_tool):
        return np.asarray(world_from_tool)[:, 0, 3] <= self.farthest_x_m

    def move(self, to):
        if to.world_from_tool[0, 3] > self.farthest_x_m:
            raise UnreachableError("beyond the end of the rail", cure="stay within")
        self.pose = np.array(to.world_from_tool)
        self.moves.append(self.pose)
        return self.state()

    def image(self):
        self.pictures += 1
        return Image(self._now_s(), picture(self.boxes, self.world_from_camera, self.light, seed=self.pictures))

    def sweep(self, sensors):
        start, axis = self.pose[:3, 3], self.pose[:3, 2]
        ranges = [(TABLE_M - start[2]) / axis[2]] + [box.hit(start, axis[None])[0][0] for box in self.boxes]
        return SweepAnswer(tuple(BridgeReading(name, self._now_s(), float(min(ranges)), Status.OK) for name in sensors))
