"""A ranger as the kernel's industrial I/O shows it: reading the file `in_distance_raw` measures."""

from __future__ import annotations

import contextlib
import errno
import os
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from surfuse.errors import DeviceError
from surfuse.interfaces import RangeSensor
from surfuse.records import Echo, Status
from surfuse.sensors.iio import MODELS, Parameters

_SCALE_M = 1e-3
_FAR_M = 1e3
_POLL_S = 0.002


class IioFolder:
    """One channel in a folder; the raw file is a pipe, so that every reader gets a reading of its own."""

    def __init__(self, sensor: RangeSensor, parameters: Parameters) -> None:
        self._sensor, self._parameters = sensor, parameters
        self._raw = parameters.folder / f"{parameters.channel}_raw"
        self._next = parameters.folder / f".{parameters.channel}_next"
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="surfuse-iio", daemon=True)

    @property
    def folder(self) -> Path:
        """Where the files are."""
        return self._parameters.folder

    def __enter__(self) -> Self:
        if os.name != "posix":
            raise DeviceError("this system has no pipes with names", cure="serve an IIO ranger on Linux or macOS")
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / f"{self._parameters.channel}_scale").write_text(f"{_SCALE_M}\n", "ascii")
        if self._parameters.status_file:
            word = min(MODELS[self._parameters.model].valid)
            (self.folder / self._parameters.status_file).write_text(f"{word}\n", "ascii")
        os.mkfifo(self._raw)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end.set()
        self._thread.join()
        self._raw.unlink()

    def _serve(self) -> None:
        while not self._end.is_set():
            try:
                answer = os.open(self._raw, os.O_WRONLY | os.O_NONBLOCK)
            except OSError as error:
                if error.errno != errno.ENXIO:  # nobody reads
                    raise
                self._end.wait(_POLL_S)
                continue
            # The next reader comes to another pipe, so that this one's reading ends here.
            os.mkfifo(self._next)
            os.replace(self._next, self._raw)
            with contextlib.suppress(BrokenPipeError):
                os.write(answer, _text(self._sensor.fire()))
            os.close(answer)


def _text(echo: Echo) -> bytes:
    if echo.status is Status.FAULT:
        return b"fault\n"
    range_m = {Status.NO_ECHO: _FAR_M, Status.TOO_CLOSE: 0.0}.get(echo.status, echo.range_m)
    return f"{round(range_m / _SCALE_M)}\n".encode("ascii")
