"""The arm of a wired twin: behind a controller of its maker, else behind the bridge."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from surfuse.bridge.server import BridgeServer
from surfuse.errors import ConfigError
from surfuse.geometry.sensor_array import tool_from_grip
from surfuse.interfaces import Device, OpenedTogether
from surfuse.records import FloatArray
from surfuse.rig.described_sensors import places
from surfuse.rig.real.joint_arm import described_model
from surfuse.rig.simulated.on_the_wire import TwinOnTheWire
from surfuse.rig.simulated.wires.ur_controller import UrController
from surfuse.settings import Settings

_UR_JOINTS = 6
_LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Wire:
    """How a device is reached: in words, and the keys by which its table of the cell file says so."""

    words: str
    keys: Mapping[str, str]


class WiredArm(Device, Protocol):
    """An arm that a client moves."""

    def world_from_grip(self) -> FloatArray:
        """Where the grip (4, 4) is now."""

    @property
    def wire(self) -> Wire:
        """How it is reached, while it is open."""


class RtdeArm(OpenedTogether):
    """The arm of `arm.file` behind a controller of Universal Robots; it stands at `arm.ready_deg` at first."""

    def __init__(self, settings: Settings) -> None:
        own, grip = settings.arm, tool_from_grip(*places(settings.sensor))
        self._model = described_model(settings, grip)
        if (joints := len(self._model.lower_rad)) != _UR_JOINTS:
            raise ConfigError(
                f"'{own.file}' has {joints} joints, an arm of Universal Robots has {_UR_JOINTS}",
                cure="give the file of such an arm",
            )
        host = str(own.parameters.get("host", ""))
        self.controller = UrController(
            host if host.startswith("127.") else _LOOPBACK, np.radians(own.ready_deg or (0.0,) * _UR_JOINTS).tolist()
        )
        super().__init__(self.controller)

    def world_from_grip(self) -> FloatArray:
        """See `WiredArm`."""
        return self._model.forward(self.controller.joints_rad())

    @property
    def wire(self) -> Wire:
        """See `WiredArm`."""
        return Wire(f"ur_rtde at {self.controller.host}", {"driver": "ur_rtde", "host": self.controller.host})


class BridgedArm(OpenedTogether):
    """The twin's arm, and the sensors that it reads, behind the bridge protocol on a port of this machine."""

    def __init__(self, settings: Settings, port: int) -> None:
        if settings.arm.is_real:
            settings = settings.model_copy(update={"arm": settings.arm.model_copy(update={"driver": "kinematic"})})
        self._twin = TwinOnTheWire(settings)
        self._server = BridgeServer(self._twin, f"tcp://{_LOOPBACK}:{port}")
        super().__init__(self._twin, self._server)
        self._thread = threading.Thread(target=self._server.serve_forever, name="surfuse-bridge", daemon=True)

    def __enter__(self) -> Self:
        super().__enter__()
        self._thread.start()
        return self

    def world_from_grip(self) -> FloatArray:
        """See `WiredArm`."""
        return self._twin.world_from_grip()

    @property
    def wire(self) -> Wire:
        """See `WiredArm`."""
        return Wire(f"bridge at {self._server.address}", {"driver": "bridge", "address": self._server.address})


def wired_arm(settings: Settings, port: int) -> WiredArm:
    """The arm of a cell file; the bridge takes this port (0: a free one).

    Raises
    ------
    ConfigError, DataError : the twin does not speak for such an arm, or its file cannot be used.
    """
    driver = settings.arm.driver
    if driver == "ur_rtde":
        return RtdeArm(settings)
    if driver == "bridge" or not settings.arm.is_real:
        return BridgedArm(settings, port)
    raise ConfigError(
        f"the twin does not speak for arm.driver = '{driver}'", cure="take ur_rtde, bridge, or an arm of the twin"
    )
