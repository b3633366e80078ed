"""The camera of the digital twin: asks the world for a picture from where it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from surfuse.errors import ConfigError
from surfuse.interfaces import GIVEN_BY_RIG, AlwaysOpen, CameraSurroundings, World, surrounded
from surfuse.records import ByteArray, CameraModel, FloatArray

SUMMARY = "a camera in the simulated rig"


@dataclass(frozen=True, kw_only=True)
class Surroundings(CameraSurroundings):
    """The world of the twin; `pose` says where the camera truly is: `world_from_camera` (4, 4)."""

    world: World
    pose: Callable[[], FloatArray]


@dataclass(frozen=True)
class Parameters:
    """`exposure_s`: time that a picture takes, one field of video by default."""

    exposure_s: float = 0.04
    surroundings: Surroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not 0.0 < self.exposure_s <= 60.0:
            raise ConfigError(f"exposure_s = {self.exposure_s}", cure="give more than 0 and at most 60 s")


class SimulatedCamera(AlwaysOpen):
    """A camera without hardware; its pose is asked for at every picture."""

    def __init__(self, parameters: Parameters, surroundings: Surroundings) -> None:
        self._exposure_s, self._surroundings = parameters.exposure_s, surroundings

    @property
    def model(self) -> CameraModel:
        """Geometry of the pictures."""
        return self._surroundings.model

    def capture(self) -> tuple[ByteArray, float]:
        """The picture (H, W) uint8 and the moment at which the exposure ended."""
        around = self._surroundings
        image = around.world.image(around.model, around.pose())
        around.clock.advance(self._exposure_s)
        return image, around.clock.now_s()


def create(parameters: Parameters) -> SimulatedCamera:
    """A camera in the twin."""
    return SimulatedCamera(parameters, surrounded(parameters.surroundings, "simulated"))
