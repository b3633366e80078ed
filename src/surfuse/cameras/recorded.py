"""A camera that plays back: a folder of pictures, one picture, or a video file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from surfuse.errors import ConfigError, DataError, DeviceError
from surfuse.interfaces import GIVEN_BY_RIG, CameraSurroundings, surrounded
from surfuse.records import ByteArray, CameraModel

PICTURES = (".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".tif", ".tiff")
VIDEOS = (".avi", ".m4v", ".mkv", ".mov", ".mp4")
SUMMARY = "plays back a folder of pictures, one picture, or a video file"


@dataclass(frozen=True)
class Parameters:
    """`source`: folder, picture or video. `interval_s`: time from one picture to the next."""

    source: Path
    interval_s: float = 0.04
    surroundings: CameraSurroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not 0.0 < self.interval_s <= 86_400.0:
            raise ConfigError(f"interval_s = {self.interval_s}", cure="give more than 0 and at most a day")


class RecordedCamera:
    """Pictures in the order of their names, or the frames of a video, one a capture."""

    def __init__(self, parameters: Parameters, surroundings: CameraSurroundings) -> None:
        self._source, self._interval_s = parameters.source, parameters.interval_s
        self._model = surroundings.model
        self._pictures: Iterator[ByteArray] = iter(())
        self._taken = 0

    @property
    def model(self) -> CameraModel:
        """Geometry that every picture must have."""
        return self._model

    def __enter__(self) -> Self:
        self._pictures = _frames(self._source)
        self._taken = 0
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pictures = iter(())

    def capture(self) -> tuple[ByteArray, float]:
        """The next picture (H, W) uint8 and its time, one interval after the one before.

        Raises
        ------
        DeviceError : the recording is at its end, or the camera is not open.
        DataError : the picture cannot be read, or has another size than the model.
        """
        image = next(self._pictures, None)
        if image is None:
            raise DeviceError(
                f"no picture after {self._taken}", cure="record more, or open the camera", where=str(self._source)
            )
        if image.shape != (self._model.height_px, self._model.width_px):
            raise DataError(
                f"picture {self._taken + 1} has {image.shape[1]} x {image.shape[0]} pixels, "
                f"the camera {self._model.width_px} x {self._model.height_px}",
                cure="give the size of the recording in the camera's settings",
                where=str(self._source),
            )
        t_s = self._taken * self._interval_s
        self._taken += 1
        return image, t_s


def create(parameters: Parameters) -> RecordedCamera:
    """A camera that plays back; it begins with the first picture whenever it is opened."""
    return RecordedCamera(parameters, surrounded(parameters.surroundings, "recorded"))


def _frames(source: Path) -> Iterator[ByteArray]:
    if source.is_dir():
        files = sorted(file for file in source.iterdir() if file.suffix.lower() in PICTURES)
        if not files:
            raise DeviceError("no pictures in the folder", cure=f"give files {', '.join(PICTURES)}", where=str(source))
        return (_picture(file) for file in files)
    if not source.exists():
        raise DeviceError("no such file or folder", cure="give the path of a recording", where=str(source))
    return _video(source) if source.suffix.lower() in VIDEOS else map(_picture, (source,))


def _picture(file: Path) -> ByteArray:
    try:
        content = np.frombuffer(file.read_bytes(), np.uint8)
    except OSError as error:
        raise DataError(f"cannot read it ({error.strerror})", cure="check the recording", where=str(file)) from error
    decoded = cv2.imdecode(content, cv2.IMREAD_GRAYSCALE) if content.size else None
    if decoded is None:
        raise DataError("not a picture that can be read", cure="remove it from the recording", where=str(file))
    return np.asarray(decoded, dtype=np.uint8)


def _video(file: Path) -> Iterator[ByteArray]:
    video = cv2.VideoCapture(str(file))
    try:
        if not video.isOpened():
            raise DataError("not a video that can be read", cure="convert it to AVI or MP4", where=str(file))
        while True:
            arrived, frame = video.read()
            if not arrived:
                return
            yield np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) if frame.ndim == 3 else frame, dtype=np.uint8)
    finally:
        video.release()
