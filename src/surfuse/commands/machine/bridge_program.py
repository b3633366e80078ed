"""The program that serves the twin of a cell file as a rig behind the bridge protocol."""

from __future__ import annotations

import threading
from collections.abc import Callable

from surfuse.bridge.server import BridgeServer, serve_stdio
from surfuse.commands.outcome import Outcome
from surfuse.errors import ConfigError
from surfuse.rig.simulated.on_the_wire import TwinOnTheWire
from surfuse.settings import Settings
from surfuse.settings.sections import NO_BUS


def serve_twin(settings: Settings, port: int | None, stop: threading.Event, say: Callable[[str], None]) -> Outcome:
    """Serve the simulated rig until `stop` is set; over TCP on loopback, or without a port on stdin and stdout.

    Raises
    ------
    ConfigError : the cell file describes a real rig.
    DeviceError : the port cannot be opened.
    """
    if settings.arm.is_real:
        raise ConfigError(
            f"arm.driver = '{settings.arm.driver}' is a real rig", cure="give a cell file of the simulated cell"
        )
    if settings.bus.interface in (NO_BUS, "virtual"):
        _rehearse(settings)
    with TwinOnTheWire(settings) as twin:
        if port is None:
            serve_stdio(twin)
            return Outcome({}, [])
        with BridgeServer(twin, f"tcp://127.0.0.1:{port}") as server:
            address = server.address
            say(f"the twin is at {address}; Ctrl-C ends it")
            thread = threading.Thread(target=server.serve_forever, daemon=True)
            thread.start()
            stop.wait()
            server.close()
            thread.join()
            return Outcome({"address": address}, [("served", address)])


def _rehearse(settings: Settings) -> None:
    """Use another twin once: what is compiled in its first sweep takes longer than a client waits for an answer."""
    with TwinOnTheWire(settings) as twin:
        hello, state = twin.hello(), twin.state()
        assert state.world_from_tool is not None
        twin.reach(state.world_from_tool[None])
        twin.sweep(hello.sensors)
