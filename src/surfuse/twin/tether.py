"""A line between the twin of the host and a simulated node in another process: where the arm truly is, and when.

A real node is bolted to the arm and needs no such line. It runs over TCP on this machine only: one JSON object a line,
each answered with `ok` or a reason.
"""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np

from surfuse.errors import DeviceError, SurfuseError
from surfuse.geometry.poses import is_rigid
from surfuse.records import FloatArray

HOST = "127.0.0.1"
LINE_LIMIT_BYTES = 1 << 20
_OK = "ok"
_TIMEOUT_S = 60.0
_RETRY_S = 0.2


@dataclass(frozen=True)
class Place:
    """Stop (stage, index), simulated time, and the true pose (4, 4) of the grip in the world.

    `t_s` is the simulated time; `world_from_grip` is the truth, not what the arm measures.
    """

    stage: str
    index: int
    t_s: float
    world_from_grip: FloatArray


class HostEnd:
    """The host's end.

    Parameters
    ----------
    port : TCP port of the node.
    configuration : the host's whole configuration as plain data; the node builds its own twin from it.
    place : returns where the arm is now.
    return_s : how long a node that has gone may take to come back.
    """

    def __init__(
        self, port: int, configuration: Mapping[str, object], place: Callable[[], Place], return_s: float = 20.0
    ) -> None:
        self._port, self._configuration, self._place, self._return_s = port, configuration, place, return_s
        self._socket: socket.socket | None = None
        self._given_up = False

    def __enter__(self) -> Self:
        try:
            self._connect()
        except OSError as error:
            raise DeviceError(
                f"the simulated node cannot be told where the arm is: {error.strerror or error}",
                cure="start `surfuse node` on this machine; a node with sensors of its own: --set bus.tether_port=0",
                where=f"{HOST}:{self._port}",
            ) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._hang_up()

    def tell(self) -> None:
        """Send the stop and the arm's place now; a node that was started again is configured again first.

        Raises
        ------
        DeviceError : the node has gone and did not come back, or refuses.
        """
        now = self._place()
        pose = now.world_from_grip.ravel().tolist()
        message = {"stage": now.stage, "index": now.index, "t_s": now.t_s, "world_from_grip": pose}
        try:
            self._say(message)
        except OSError as error:
            self._say_again(message, error)

    def _connect(self) -> None:
        self._socket = socket.create_connection((HOST, self._port), _TIMEOUT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            self._say({"configuration": self._configuration})
        except BaseException:
            self._hang_up()
            raise

    def _say_again(self, message: Mapping[str, object], gone: OSError) -> None:
        give_up_s = time.monotonic() + (0.0 if self._given_up else self._return_s)
        self._given_up = True
        while True:
            self._hang_up()
            try:
                self._connect()
                self._say(message)
            except OSError:
                if time.monotonic() >= give_up_s:
                    break
                time.sleep(_RETRY_S)
            else:
                self._given_up = False
                return
        raise DeviceError(
            f"the simulated node has gone ({gone.strerror or gone}), and is not back after {self._return_s:g} s",
            cure="start `surfuse node` again",
            where=f"{HOST}:{self._port}",
        ) from gone

    def _hang_up(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _say(self, message: Mapping[str, object]) -> None:
        if self._socket is None:
            raise ConnectionError("the line is closed")
        self._socket.sendall(json.dumps(message).encode() + b"\n")
        answer = _line(self._socket, bytearray())
        if not answer:
            raise ConnectionError("it closed the line")
        if answer != _OK:
            raise DeviceError(f"the simulated node refuses: {answer}", where=f"{HOST}:{self._port}")


class NodeEnd:
    """The node's end: a thread that serves one host after the other.

    Parameters
    ----------
    port : TCP port to listen on; 0 chooses a free one.
    configure : takes a host's configuration.
    move : takes each place.
    """

    def __init__(
        self, port: int, configure: Callable[[Mapping[str, object]], None], move: Callable[[Place], None]
    ) -> None:
        self._wanted, self._configure, self._move = port, configure, move
        self._server: socket.socket | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="surfuse-tether", daemon=True)

    def __enter__(self) -> Self:
        try:
            self._server = socket.create_server((HOST, self._wanted))
        except OSError as error:
            raise DeviceError(
                f"cannot listen: {error.strerror or error}",
                cure="end the other simulated node, or choose another bus.tether_port on both sides",
                where=f"{HOST}:{self._wanted}",
            ) from error
        self._server.settimeout(0.1)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join(timeout=5.0)
        if self._server is not None:
            self._server.close()

    @property
    def port(self) -> int:
        """The port it listens on."""
        return int(self._server.getsockname()[1]) if self._server is not None else self._wanted

    def _serve(self) -> None:
        while not self._stop.is_set() and self._server is not None:
            try:
                host, _ = self._server.accept()
            except TimeoutError:
                continue
            with host:
                host.settimeout(0.1)
                host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._attend(host)

    def _attend(self, host: socket.socket) -> None:
        """Serve one host until it hangs up."""
        waiting = bytearray()
        while not self._stop.is_set():
            try:
                line = _line(host, waiting)
                if not line:
                    return
                host.sendall(self._answer(line).encode() + b"\n")
            except TimeoutError:
                continue
            except OSError:
                return

    def _answer(self, line: str) -> str:
        try:
            message = json.loads(line)
            if not isinstance(message, dict):
                raise ValueError("not an object")
            if "configuration" in message:
                self._configure(message["configuration"])
            else:
                self._move(_place(message))
        except (SurfuseError, ValueError, TypeError, KeyError, RecursionError) as error:
            return " ".join(f"{type(error).__name__}: {error}".split())
        return _OK


def _place(message: Mapping[str, object]) -> Place:
    pose = np.asarray(message["world_from_grip"], dtype=np.float64).reshape(4, 4)
    if not is_rigid(pose):
        raise ValueError("world_from_grip is not a rigid pose")
    stage, index, t_s = message["stage"], message["index"], message["t_s"]
    if not (isinstance(stage, str) and isinstance(index, int) and isinstance(t_s, int | float) and index >= 0):
        raise ValueError("stage, index or t_s has the wrong type")
    return Place(stage, index, float(t_s), pose)


def _line(source: socket.socket, waiting: bytearray) -> str:
    """The next line; empty when the other end hung up. What is read of an unfinished one stays in `waiting`."""
    while b"\n" not in waiting:
        if len(waiting) > LINE_LIMIT_BYTES:
            raise OSError(f"a line longer than {LINE_LIMIT_BYTES} bytes")
        chunk = source.recv(65536)
        if not chunk:
            return ""
        waiting += chunk
    line, _, rest = bytes(waiting).partition(b"\n")
    waiting[:] = rest
    return line.decode(errors="replace")
