"""A USB camera by OpenCV's video capture."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import GIVEN_BY_RIG, CameraSurroundings, surrounded
from surfuse.records import ByteArray, CameraModel

_STALE_FRAMES = 2
_REPEATS_MAX = 5
SUMMARY = "a USB camera, by its number in the system"


@dataclass(frozen=True)
class Parameters:
    """`index`: number of the camera in the system's order, from 0."""

    index: int = 0
    surroundings: CameraSurroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not 0 <= self.index <= 999:
            raise ConfigError(f"index = {self.index}", cure="give 0 for the first camera, at most 999")


class UvcCamera:
    """One camera of the system; opened by `with`, closed on every way out."""

    def __init__(self, parameters: Parameters, surroundings: CameraSurroundings) -> None:
        self._index, self._model, self._clock = parameters.index, surroundings.model, surroundings.clock
        self._capture: cv2.VideoCapture | None = None
        self._last: ByteArray | None = None
        self._repeats = 0

    @property
    def model(self) -> CameraModel:
        """Geometry that every picture must have."""
        return self._model

    def __enter__(self) -> Self:
        level = cv2.utils.logging.getLogLevel()
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            capture = cv2.VideoCapture(self._index)
        finally:
            cv2.utils.logging.setLogLevel(level)
        if not capture.isOpened():
            capture.release()
            raise DeviceError(
                "no camera answers",
                cure="plug it in, close other programs that use it, or give another index",
                where=self._name,
            )
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._model.width_px)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._model.height_px)
        self._capture, self._last, self._repeats = capture, None, 0
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._capture is not None:
            self._capture.release()
        self._capture = None

    def capture(self) -> tuple[ByteArray, float]:
        """A fresh picture (H, W) uint8 and its time; what the driver had buffered before is thrown away.

        Raises
        ------
        DeviceError : not open, unplugged, of another size than the model, or the same picture again and again.
        """
        if self._capture is None:
            raise DeviceError("the camera is not open", cure="use it in a `with` block", where=self._name)
        for _ in range(_STALE_FRAMES):
            self._capture.grab()
        arrived, frame = self._capture.read()
        t_s = self._clock.now_s()
        if not arrived or frame is None:
            raise DeviceError("the camera stopped answering", cure="check its cable", where=self._name)
        image = np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) if frame.ndim == 3 else frame, dtype=np.uint8)
        if image.shape != (self._model.height_px, self._model.width_px):
            raise DeviceError(
                f"the camera sends {image.shape[1]} x {image.shape[0]} pixels, "
                f"wanted {self._model.width_px} x {self._model.height_px}",
                cure="give a size in the camera's settings that the camera has",
                where=self._name,
            )
        self._notice_frozen(image)
        return image, t_s

    def _notice_frozen(self, image: ByteArray) -> None:
        """A real sensor has noise: pictures that are equal to the last bit come from a dead link."""
        same = self._last is not None and np.array_equal(image, self._last)
        self._repeats = self._repeats + 1 if same else 0
        self._last = image
        if self._repeats >= _REPEATS_MAX:
            raise DeviceError(
                f"the camera sent the same picture {self._repeats + 1} times",
                cure="unplug it and plug it in again",
                where=self._name,
            )

    @property
    def _name(self) -> str:
        return f"camera {self._index}"


def create(parameters: Parameters) -> UvcCamera:
    """A USB camera."""
    return UvcCamera(parameters, surrounded(parameters.surroundings, "uvc"))
