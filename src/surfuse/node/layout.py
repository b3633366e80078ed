"""Where the bits of each message are: read from the DBC file, the only place that knows them."""

from __future__ import annotations

import importlib.resources
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from surfuse.errors import ConfigError, DataError
from surfuse.node.messages import (
    MAX_SENSORS,
    FaultCode,
    Function,
    NodeState,
    Result,
    Subject,
    TriggerSource,
    identifier,
)
from surfuse.records import Status

if TYPE_CHECKING:
    from cantools.database.can import Database, Message

FRAME_BYTES = 8
_DBC_MAX_BYTES = 1_000_000
_NODES = (1, 2)
_NAMES = {
    Function.FAULT: "Fault",
    Function.TRIGGER: "Trigger",
    Function.ACKNOWLEDGE: "Acknowledge",
    Function.READING: "Reading",
    Function.ECHO: "Echo",
    Function.KIT_PULSE: "KitPulse",
    Function.KIT_SAMPLING: "KitSampling",
    Function.QUERY: "Query",
    Function.HEARTBEAT: "Heartbeat",
}
_SIGNALS: dict[Function, tuple[str, ...]] = {
    Function.FAULT: ("sequence", "session", "code", "sensor", "detail"),
    Function.TRIGGER: ("sequence", "attempt", "sensors", "epoch", "together"),
    Function.ACKNOWLEDGE: ("sequence", "session", "subject", "result", "attempt", "sensors"),
    Function.READING: ("sequence", "session", "status", "count", "range", "spread", "attempt"),
    Function.ECHO: ("sequence", "session", "time", "attempt", "accepted", "amplitude"),
    Function.KIT_PULSE: ("sequence", "sensor", "frequency", "cycles", "blanking", "gain"),
    Function.KIT_SAMPLING: ("sequence", "sensor", "trigger_source", "sample_rate", "pings"),
    Function.QUERY: ("sequence", "epoch"),
    Function.HEARTBEAT: (
        "node",
        "state",
        "session",
        "tx_errors",
        "rx_errors",
        "version_major",
        "version_minor",
        "uid",
    ),
}
_ENUMS: dict[tuple[Function, str], type[IntEnum]] = {
    (Function.FAULT, "code"): FaultCode,
    (Function.ACKNOWLEDGE, "subject"): Subject,
    (Function.ACKNOWLEDGE, "result"): Result,
    (Function.READING, "status"): Status,
    (Function.KIT_SAMPLING, "trigger_source"): TriggerSource,
    (Function.HEARTBEAT, "state"): NodeState,
}


@dataclass(frozen=True)
class Layout:
    """The fields of one message in the order of its signals: `shift` and `mask` of each, `scale` to its unit.

    A raw word is the payload, read as one number, shifted right and masked; times the entry of `scales` it is in the
    unit of the catalogue.
    """

    fields: tuple[tuple[int, int], ...]
    scales: tuple[float, ...]

    def unpack(self, data: bytes) -> tuple[int, ...]:
        """Raw values of the fields of an 8-byte frame."""
        bits = int.from_bytes(data, "little")
        return tuple([(bits >> shift) & mask for shift, mask in self.fields])

    def pack(self, *raw: int) -> bytes:
        """An 8-byte frame from raw values.

        Raises
        ------
        DataError : a value does not fit into its field.
        """
        bits = 0
        for value, (shift, mask) in zip(raw, self.fields, strict=True):
            if not 0 <= value <= mask:
                raise DataError(f"value {value} does not fit into its field of the bus", cure=f"give 0 to {mask}")
            bits |= value << shift
        return bits.to_bytes(FRAME_BYTES, "little")


Layouts = dict[Function, Layout]


@cache
def load_layouts(path: Path | None = None) -> Layouts:
    """Read and check a message catalogue; without a path the one of this package.

    Raises
    ------
    ConfigError : the file cannot be read, is no DBC, or is not the catalogue that host and node agreed on.
    """
    where = "surfuse.dbc" if path is None else str(path)
    database = _parse(_text(path, where), where)
    by_id = {message.frame_id: message for message in database.messages}
    layouts: Layouts = {}
    for function in Function:
        for node in _NODES:
            sensors = range(MAX_SENSORS) if function in (Function.READING, Function.ECHO) else range(1)
            for sensor in sensors:
                frame_id = identifier(function, node, sensor)
                if frame_id not in by_id:
                    raise _disagrees(where, f"there is no message {frame_id:#x} ({_NAMES[function]} of node {node})")
                layout = _layout(by_id[frame_id], function, where)
                if layouts.setdefault(function, layout) != layout:
                    raise _disagrees(where, f"message {by_id[frame_id].name} differs from that of node 1, sensor 0")
    return layouts


def _text(path: Path | None, where: str) -> str:
    source = importlib.resources.files("surfuse.node") / "surfuse.dbc" if path is None else path
    try:
        raw = source.read_bytes()
        if len(raw) > _DBC_MAX_BYTES:
            raise ConfigError(f"{len(raw)} bytes", cure=f"a catalogue has at most {_DBC_MAX_BYTES} bytes", where=where)
        return raw.decode("cp1252")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot be read: {error}", cure="give a readable DBC file", where=where) from error


def _parse(text: str, where: str) -> Database:
    from cantools.database import load_string
    from cantools.database.can import Database

    try:
        database = load_string(text, database_format="dbc", strict=True)
    except Exception as error:  # whatever a hostile file makes the parser raise, it is the file's fault
        raise ConfigError(f"is no DBC file: {error}"[:300], cure="give a valid DBC file", where=where) from error
    if not isinstance(database, Database):
        raise ConfigError("is no CAN catalogue", cure="give a DBC file", where=where)
    return database


def _layout(message: Message, function: Function, where: str) -> Layout:
    signals = {signal.name: signal for signal in message.signals}
    names = _SIGNALS[function]
    if message.length != FRAME_BYTES or message.is_extended_frame or set(signals) != set(names):
        raise _disagrees(where, f"message {message.name} must have {FRAME_BYTES} bytes, an 11-bit id and {names}")
    fields, scales = [], []
    for name in names:
        signal = signals[name]
        plain = signal.byte_order == "little_endian" and not (signal.is_signed or signal.is_float)
        if not plain or signal.is_multiplexer or signal.multiplexer_ids or signal.offset != 0 or not signal.scale > 0:
            raise _disagrees(where, f"signal {message.name}.{name} must be unsigned, Intel order, offset 0")
        words = _ENUMS.get((function, name))
        choices = {int(value): str(word) for value, word in (signal.choices or {}).items()}
        if words is not None and choices != {word.value: word.name for word in words}:
            raise _disagrees(where, f"signal {message.name}.{name} has the words {choices}")
        fields.append((signal.start, (1 << signal.length) - 1))
        scales.append(float(signal.scale))
    return Layout(tuple(fields), tuple(scales))


def _disagrees(where: str, what: str) -> ConfigError:
    return ConfigError(what, cure="use the surfuse.dbc of the version that runs on the node", where=where)
