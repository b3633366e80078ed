"""The camera of the digital twin: asks the world for a picture from where it is."""

from __future__ import annotations

from collections.abc import Callable

from surfuse.interfaces import AlwaysOpen, Clock, World
from surfuse.records import ByteArray, CameraModel, FloatArray

EXPOSURE_S = 0.04


class SimulatedCamera(AlwaysOpen):
    """A camera without hardware; a picture takes one field's time."""

    def __init__(self, world: World, model: CameraModel, pose: Callable[[], FloatArray], clock: Clock) -> None:
        self._world, self._model, self._pose, self._clock = world, model, pose, clock

    @property
    def model(self) -> CameraModel:
        """Geometry of the pictures."""
        return self._model

    def capture(self) -> tuple[ByteArray, float]:
        """The picture (H, W) uint8 and the moment at which the exposure ended."""
        image = self._world.image(self._model, self._pose())
        self._clock.advance(EXPOSURE_S)
        return image, self._clock.now_s()


def create(world: World, model: CameraModel, pose: Callable[[], FloatArray], clock: Clock) -> SimulatedCamera:
    """A camera whose pose `world_from_camera` (4, 4) is asked for at every picture."""
    return SimulatedCamera(world, model, pose, clock)
