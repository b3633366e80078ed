"""The camera of a bridge: it answers `image`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from surfuse.bridge.messages import Ability
from surfuse.bridge.shared import SharedBridge
from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import GIVEN_BY_RIG, CameraSurroundings, OpenedTogether, surrounded
from surfuse.records import ByteArray, CameraModel

SUMMARY = "the camera of the arm's bridge, which answers 'image'"


@dataclass(frozen=True, kw_only=True)
class Surroundings(CameraSurroundings):
    """The connection that the camera shares with the arm."""

    bridge: SharedBridge


@dataclass(frozen=True)
class Parameters:
    """Nothing to choose: the bridge is that of the arm."""

    surroundings: Surroundings | None = field(default=None, metadata=GIVEN_BY_RIG)


class BridgeCamera(OpenedTogether):
    """A camera behind a bridge; opened, it is known to have pictures of the size of the model."""

    def __init__(self, surroundings: Surroundings) -> None:
        super().__init__(surroundings.bridge)
        self._bridge, self._model = surroundings.bridge, surroundings.model

    @property
    def model(self) -> CameraModel:
        """Geometry that every picture must have."""
        return self._model

    def __enter__(self) -> Self:
        super().__enter__()
        try:
            self._check()
        except BaseException as error:
            self.__exit__(type(error), error, error.__traceback__)
            raise
        return self

    def _check(self) -> None:
        """Refuse a bridge without a camera, or with one of another size, before anything moves."""
        hello, model = self._bridge.client.hello, self._model
        if hello.camera is None or Ability.IMAGE not in hello.can:
            lacks = "'image' is not in its 'can'" if hello.camera is not None else "its 'camera' is null"
            raise DeviceError(
                f"the bridge '{hello.name}' has no camera: {lacks}",
                cure="let it answer 'image', and say so in 'hello'; or give camera.driver = 'uvc'",
            )
        if (hello.camera.width_px, hello.camera.height_px) != (model.width_px, model.height_px):
            raise ConfigError(
                f"the bridge's camera has {hello.camera.width_px} x {hello.camera.height_px} pixels, "
                f"camera.width_px and height_px say {model.width_px} x {model.height_px}",
                cure="calibrate it at the size that it sends, or let the bridge send the size that was calibrated",
            )

    def capture(self) -> tuple[ByteArray, float]:
        """One picture (H, W) uint8 and its time by the bridge's clock.

        Raises
        ------
        DeviceError : not open, gone, or an answer that is no picture of that size.
        """
        image = self._bridge.client.image()
        return np.asarray(image.grey, dtype=np.uint8), image.t_s


def create(parameters: Parameters) -> BridgeCamera:
    """The camera of a bridge."""
    return BridgeCamera(surrounded(parameters.surroundings, "bridge"))
