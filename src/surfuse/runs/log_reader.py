"""Reading the log of a run, also after a crash: what is whole is returned, what is not is named."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap_ros2.decoder import DecoderFactory

from surfuse.errors import DataError, SurfuseError
from surfuse.records import CameraFrame, FusionScene, ScanPlan, Sweep
from surfuse.runs import own_messages as own
from surfuse.runs.log_files import log_segments, read_whole
from surfuse.runs.log_records import FORMAT_VERSION, Damage, LogDamage, LogEvent, RunLog
from surfuse.runs.log_walk import Walk, walk
from surfuse.runs.own_topics import EVENT_TOPIC, OWN_TOPICS, PLAN_TOPIC, SCENE_TOPIC, SWEEP_TOPIC, VIEW_TOPIC
from surfuse.runs.segment import MARK
from surfuse.runs.sweep_fields import VERSION_1, definition_text, logged

_DECODE_ERRORS = (McapError, ValueError, TypeError, IndexError, AttributeError, struct.error, EOFError, SurfuseError)


@dataclass
class _Gathered:
    scene: FusionScene | None = None
    plan: ScanPlan | None = None
    frames: list[CameraFrame] = field(default_factory=list)
    events: list[LogEvent] = field(default_factory=list)
    sweeps: dict[int, Sweep] = field(default_factory=dict)
    damage: list[LogDamage] = field(default_factory=list)


def is_own_log(path: Path) -> bool:
    """Whether surfuse wrote the log at `path` (a run folder, a log folder or one segment)."""
    for segment in log_segments(path):
        found = walk(read_whole(segment))
        topics = {channel.topic for channel in found.channels.values()}
        if MARK in found.metadata or SWEEP_TOPIC in topics:
            return True
    return False


def read_log(path: Path) -> RunLog:
    """Everything in a log of ours: `path` is a run folder, its log folder, or one segment.

    Sweeps come in the order of their stops. Where a stop was taken twice (after an interruption), the last complete
    one counts. Incomplete and corrupt parts are left out and named in `damage`.

    Raises
    ------
    DataError : nothing there, or a newer format.
    StorageError : a file cannot be read.
    """
    gathered = _Gathered()
    for segment in log_segments(path):
        _gather(segment.name, walk(read_whole(segment)), gathered)
    return RunLog(
        scene=gathered.scene,
        plan=gathered.plan,
        frames=tuple(gathered.frames),
        events=tuple(gathered.events),
        sweeps=tuple(gathered.sweeps[stop] for stop in sorted(gathered.sweeps)),
        damage=tuple(gathered.damage),
    )


def _gather(name: str, found: Walk, gathered: _Gathered) -> None:
    gathered.damage += [LogDamage(name, offset, kind, text) for offset, kind, text in found.damage]
    expected: dict[str, int] = {}
    pixels = _image_bytes(found)
    for topic, message, decode in _own_messages(found):
        try:
            _take(topic, cast(own.Decoded, decode(message.data)), pixels, gathered, name)
        except _NewerFormatError:
            raise
        except _DECODE_ERRORS as error:
            text = f"a message of {topic} cannot be used: {error}"
            gathered.damage.append(LogDamage(name, 0, Damage.CORRUPT, text))
        missing = message.sequence - expected.get(topic, 0)
        if missing > 0:
            text = f"{missing} message(s) of {topic} before number {message.sequence} are missing"
            gathered.damage.append(LogDamage(name, 0, Damage.MISSING, text))
        expected[topic] = message.sequence + 1


class _NewerFormatError(DataError):
    """The log says that a later version wrote it."""


def _take(topic: str, decoded: own.Decoded, pixels: Iterator[bytes], gathered: _Gathered, segment: str) -> None:
    if topic == SWEEP_TOPIC:
        sweep = own.sweep_record(decoded)
        gathered.sweeps[sweep.stop] = sweep
    elif topic == SCENE_TOPIC:
        version = own.scene_version(decoded)
        if version > FORMAT_VERSION:
            raise _NewerFormatError(
                f"the log has format version {version}, this surfuse reads up to {FORMAT_VERSION}",
                where=segment,
                cure="install a newer surfuse",
            )
        gathered.scene = own.scene_record(decoded)
    elif topic == PLAN_TOPIC:
        gathered.plan = own.plan_record(decoded)
    elif topic == VIEW_TOPIC:
        gathered.frames.append(own.frame_record(decoded, next(pixels, b"")))
    elif topic == EVENT_TOPIC:
        gathered.events.append(own.event_record(decoded))


def _image_bytes(found: Walk) -> Iterator[bytes]:
    """Pixels of the images of our camera, in order: each view and its image share a chunk, so they pair up."""
    channel = next((c for c in found.channels.values() if c.topic == "/camera/image"), None)
    schema = found.schemas.get(channel.schema_id) if channel else None
    decode = DecoderFactory().decoder_for("cdr", schema) if schema else None
    for message in found.messages:
        if decode is not None and channel is not None and message.channel_id == channel.id:
            yield bytes(decode(message.data).data)


def _own_messages(found: Walk) -> Iterator[tuple[str, Message, Callable[[bytes], object]]]:
    factory = DecoderFactory()
    decoders: dict[int, tuple[str, Callable[[bytes], object]]] = {}
    for number, (channel, schema) in _own_channels(found).items():
        decode = factory.decoder_for(channel.message_encoding, schema)
        if decode is not None:
            decoders[number] = (channel.topic, decode)
    for message in found.messages:
        if message.channel_id in decoders:
            topic, decoder = decoders[message.channel_id]
            yield topic, message, decoder


def _own_channels(found: Walk) -> dict[int, tuple[Channel, Schema]]:
    """Our channels with their definitions; those of the format itself where a damaged file has lost them."""
    own_names = {topic for topic, _ in OWN_TOPICS}
    channels = {
        number: (channel, found.schemas[channel.schema_id])
        for number, channel in found.channels.items()
        if channel.topic in own_names and channel.schema_id in found.schemas
    }
    mark = found.metadata.get(MARK, {})
    if not channels and mark.get("log_format") == str(FORMAT_VERSION):
        # Fields are only ever added behind the others: a log has the first ones, as many as it says.
        fields = int(mark.get("sweep_fields", len(VERSION_1)))
        for number, (topic, definition) in enumerate(OWN_TOPICS, start=1):
            text = definition_text(logged()[:fields]) if topic == SWEEP_TOPIC else definition.text
            schema = Schema(id=number, data=text.encode(), encoding="ros2msg", name=definition.name)
            channel = Channel(id=number, topic=topic, message_encoding="cdr", metadata={}, schema_id=number)
            channels[number] = (channel, schema)
    return channels
