"""A controller of Universal Robots on this machine: joint states over RTDE (port 30004), URScript (port 30002).

It takes `movej` of joints and `stopj`, moves on a half wave of a cosine, and can be put into any safety mode. Formats:
Universal Robots, "Real-Time Data Exchange (RTDE) Guide".
"""

from __future__ import annotations

import contextlib
import math
import re
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np

from surfuse.arms.ur_rtde import ROBOT_RUNNING, RTDE_PORT, SAFETY_NORMAL, SCRIPT_PORT
from surfuse.errors import DeviceError
from surfuse.records import FloatArray

_TYPES = {
    b"timestamp": ("DOUBLE", ">d"),
    b"actual_q": ("VECTOR6D", ">6d"),
    b"actual_qd": ("VECTOR6D", ">6d"),
    b"robot_mode": ("INT32", ">i"),
    b"safety_mode": ("INT32", ">i"),
}
_VERSION = struct.pack(">IIII", 5, 11, 1, 0)
_PROTECTIVE_STOP = 3
_SHORTEST_MOVE_S = 0.02
_MOVE = re.compile(r"movej\(\[([^\]]*)\], a=([0-9.]+), v=([0-9.]+)\)")


class _Motion(NamedTuple):
    """From where to where (6,) the joints go, when they began (s of this machine), and how long they take."""

    start_rad: FloatArray
    end_rad: FloatArray
    began_s: float
    takes_s: float

    def state(self) -> tuple[FloatArray, FloatArray]:
        """Joints (6,) and their speeds (6,) now."""
        passed_s = time.monotonic() - self.began_s
        if passed_s >= self.takes_s:
            return self.end_rad, np.zeros_like(self.end_rad)
        phase, way_rad = math.pi * passed_s / self.takes_s, self.end_rad - self.start_rad
        rate = 0.5 * math.pi / self.takes_s * math.sin(phase)
        return self.start_rad + 0.5 * (1.0 - math.cos(phase)) * way_rad, rate * way_rad


class UrController:
    """An arm of six joints at a loopback address; `start_rad` (6,) is where it stands at first.

    `safety_mode` and `robot_mode` are what it reports; in another mode than a normal one it does not move. `silent`: it
    sends no data. `deaf`: it takes no scripts. All may be changed at any time.
    """

    def __init__(self, host: str, start_rad: Sequence[float]) -> None:
        self.host = host
        self.safety_mode, self.robot_mode, self.silent, self.deaf = SAFETY_NORMAL[0], ROBOT_RUNNING, False, False
        self._motion = _standing(np.array(start_rad, dtype=np.float64))
        self._listeners: list[socket.socket] = []

    def __enter__(self) -> Self:
        try:
            for port, talk in ((RTDE_PORT, self._talk_rtde), (SCRIPT_PORT, self._talk_script)):
                listener = socket.create_server((self.host, port))
                self._listeners.append(listener)
                threading.Thread(target=self._accept, args=(listener, talk), daemon=True).start()
        except OSError as error:
            self.__exit__(None, None, None)
            raise DeviceError(
                f"port {RTDE_PORT} or {SCRIPT_PORT} cannot be opened: {error}",
                where=self.host,
                cure="the ports of the protocol are fixed: end the other program, or give another loopback address",
            ) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for listener in self._listeners:
            with contextlib.suppress(OSError):
                listener.shutdown(socket.SHUT_RDWR)
            listener.close()
        self._listeners.clear()

    def joints_rad(self) -> FloatArray:
        """Where the joints (6,) are now."""
        return self._motion.state()[0]

    def protective_stop(self) -> None:
        """Stop the arm and keep it from moving until `unlock`."""
        self.safety_mode = _PROTECTIVE_STOP
        self._motion = _standing(self.joints_rad())

    def unlock(self) -> None:
        """Let it move again."""
        self.safety_mode = SAFETY_NORMAL[0]

    def script(self, program: str) -> None:
        """Take a program in URScript."""
        found = _MOVE.search(program)
        ready = self.safety_mode in SAFETY_NORMAL and self.robot_mode == ROBOT_RUNNING
        if found is not None and not self.deaf and ready:
            start_rad, end_rad = self.joints_rad(), np.array([float(angle) for angle in found[1].split(",")])
            way_rad = float(np.max(np.abs(end_rad - start_rad)))
            takes_s = max(_SHORTEST_MOVE_S, 0.5 * math.pi * way_rad / float(found[3]))
            self._motion = _Motion(start_rad, end_rad, time.monotonic(), takes_s)
        elif "stopj" in program:
            self._motion = _standing(self.joints_rad())

    def _accept(self, listener: socket.socket, talk: Callable[[socket.socket], None]) -> None:
        with contextlib.suppress(OSError):  # closed under us
            while True:
                line, _ = listener.accept()
                threading.Thread(target=_until_it_breaks, args=(talk, line), daemon=True).start()

    def _talk_rtde(self, line: socket.socket) -> None:
        names: list[bytes] = []
        period_s = 0.008
        for kind, body in _packages(line):
            if kind == "V":
                _send(line, "V", bytes([struct.unpack(">H", body)[0] == 2]))
            elif kind == "v":
                _send(line, "v", _VERSION)
            elif kind == "O":
                period_s = 1.0 / struct.unpack(">d", body[:8])[0]
                names = [name for name in body[8:].split(b",") if name]
                kinds = ",".join(_TYPES[name][0] if name in _TYPES else "NOT_FOUND" for name in names)
                _send(line, "O", b"\x01" + kinds.encode("ascii"))
            elif kind == "S":
                _send(line, "S", b"\x01")
                arguments = self._stream, line, tuple(names), period_s
                threading.Thread(target=_until_it_breaks, args=arguments, daemon=True).start()
            elif kind == "P":
                _send(line, "P", b"\x01")

    def _stream(self, line: socket.socket, names: tuple[bytes, ...], period_s: float) -> None:
        while True:
            if not self.silent:
                joints, speeds = self._motion.state()
                values: dict[bytes, tuple[float, ...]] = {
                    b"timestamp": (time.monotonic(),),
                    b"actual_q": tuple(joints.tolist()),
                    b"actual_qd": tuple(speeds.tolist()),
                    b"robot_mode": (self.robot_mode,),
                    b"safety_mode": (self.safety_mode,),
                }
                fields = b"".join(struct.pack(_TYPES[name][1], *values[name]) for name in names)
                _send(line, "U", b"\x01" + fields)
            time.sleep(period_s)

    def _talk_script(self, line: socket.socket) -> None:
        text = ""
        while data := line.recv(4096):
            text += data.decode("ascii", "replace")
            while "end\n" in text:
                program, text = text.split("end\n", 1)
                self.script(program)


def _standing(joints_rad: FloatArray) -> _Motion:
    return _Motion(joints_rad, joints_rad, time.monotonic(), 0.0)


def _until_it_breaks(talk: Callable[..., None], line: socket.socket, *more: object) -> None:
    with contextlib.suppress(OSError), line:
        talk(line, *more)


def _send(line: socket.socket, kind: str, body: bytes) -> None:
    line.sendall(struct.pack(">HB", 3 + len(body), ord(kind)) + body)


def _packages(line: socket.socket) -> Iterator[tuple[str, bytes]]:
    buffer = b""
    while data := line.recv(4096):
        buffer += data
        while len(buffer) >= 3 and len(buffer) >= struct.unpack(">H", buffer[:2])[0]:
            size = struct.unpack(">H", buffer[:2])[0]
            yield chr(buffer[2]), buffer[3:size]
            buffer = buffer[size:]
