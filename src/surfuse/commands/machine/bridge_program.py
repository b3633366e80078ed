"""The program that serves the twin of a cell file as a rig behind the bridge protocol."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, MutableMapping
from dataclasses import dataclass
from pathlib import Path

import tomlkit

from surfuse import durable
from surfuse.bridge.server import BridgeServer, serve_stdio
from surfuse.commands.outcome import Outcome
from surfuse.errors import ConfigError, StorageError
from surfuse.rig.simulated.on_the_wire import TwinOnTheWire
from surfuse.rig.simulated.wires.wired_twin import WiredTwin, Wires
from surfuse.runs.log_files import read_whole
from surfuse.settings import NO_BUS, Settings


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


_OURS = "# Written by `surfuse bridge --wires`: the devices of its twin, while it runs.\n"


@dataclass(frozen=True)
class WiresJob:
    """The cell file whose twin is served, where the one with the addresses is written, and how it is served.

    `port` is that of the bridge (0: a free one); `times_faster`: than the real devices.
    """

    cell: Path
    wired: Path
    port: int = 0
    times_faster: float = 1.0


def serve_wires(settings: Settings, job: WiresJob, stop: threading.Event, say: Callable[[str], None]) -> Outcome:
    """Serve every device of a cell file at the protocol that its driver speaks, until `stop` is set.

    The cell file with the addresses is written when all are there, and `say` is told of each.

    Raises
    ------
    UsageError, ConfigError, DataError : the twin does not speak for a device of the file.
    DeviceError : a port cannot be opened.
    StorageError : the file is there already, or cannot be written.
    """
    text = read_whole(job.cell).decode("utf-8-sig")
    if job.wired.exists() and not read_whole(job.wired).startswith(_OURS.encode("utf-8")):
        raise StorageError(
            "it would be overwritten, and is no file of an earlier twin",
            where=str(job.wired),
            cure="give another name with --wires",
        )
    with WiredTwin(settings, job.port, job.times_faster) as twin:
        wires = twin.wires
        durable.write_text(job.wired, _OURS + with_wires(text, wires), overwrite=True)
        rows = [("arm", wires.arm.words)]
        rows += [(sensor.name, wire.words) for sensor, wire in zip(settings.sensor, wires.sensors, strict=True)]
        for name, words in rows:
            say(f"{name}: {words}")
        say(f"scan it with 'surfuse acquire --cell {job.wired}'; Ctrl-C ends it")
        stop.wait()
    return Outcome({"cell": str(job.wired), **dict(rows)}, [*rows, ("cell file", str(job.wired))])


def with_wires(text: str, wires: Wires) -> str:
    """The text of a cell file with the addresses of the devices instead of its own."""
    document = tomlkit.parse(text)
    arm = document.setdefault("arm", tomlkit.table())
    assert isinstance(arm, MutableMapping)
    if "address" in wires.arm.keys:
        # Behind the bridge the arm takes poses of its tool; its own model stays at the other end.
        for key in ("command", "address", "file", "tool", "ready_deg"):
            arm.pop(key, None)
    _set(arm, wires.arm.keys)
    for table, wire in zip(document.get("sensor", ()), wires.sensors, strict=True):
        _set(table, wire.keys)
    return tomlkit.dumps(document)


def _set(table: MutableMapping[str, object], keys: Mapping[str, str]) -> None:
    for key, value in keys.items():
        table[key] = value


def _rehearse(settings: Settings) -> None:
    """Use another twin once: what is compiled in its first sweep takes longer than a client waits for an answer."""
    with TwinOnTheWire(settings) as twin:
        hello, state = twin.hello(), twin.state()
        assert state.world_from_tool is not None
        twin.reach(state.world_from_tool[None])
        twin.sweep(hello.sensors)
