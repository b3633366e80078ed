"""Giving a segment of a killed writer the end that it lacks, so that every MCAP reader opens it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from mcap.writer import Writer

from surfuse import durable
from surfuse.runs.bag_metadata import SegmentSummary
from surfuse.runs.log_files import read_whole
from surfuse.runs.log_records import Damage
from surfuse.runs.log_walk import MAGIC, Walk, walk
from surfuse.runs.segment import MARK


def seal_segment(path: Path) -> bool:
    """Rewrite an unfinished segment of ours whole, message by message; True when it was rewritten.

    Only what no reader could use is left out (an incomplete last chunk). When anything else is damaged, the
    original is kept beside it as `NAME.mcap.damaged`. Foreign and sound files are not touched.
    """
    data = read_whole(path)
    if data.endswith(MAGIC) and len(data) > len(MAGIC):
        return False
    found = walk(data)
    if MARK not in found.metadata and found.chunk_ends:
        return False
    if any(kind is Damage.CORRUPT for _, kind, _ in found.damage):
        durable.write_bytes(path.with_name(path.name + ".damaged"), data, overwrite=True)
    with durable.replacing(path, overwrite=True) as temporary, temporary.open("wb") as stream:
        _write_found(found, Writer(stream, chunk_size=1 << 40))
    return True


def _write_found(found: Walk, writer: Writer) -> None:
    """Write what a walk found as a finished file: same schemas, channels, times, sequence numbers and bytes."""
    writer.start(profile="ros2")
    for name, values in found.metadata.items():
        writer.add_metadata(name, values)
    schemas = {
        number: writer.register_schema(schema.name, schema.encoding, schema.data)
        for number, schema in sorted(found.schemas.items())
    }
    channels = {
        number: writer.register_channel(
            channel.topic, channel.message_encoding, schemas.get(channel.schema_id, 0), channel.metadata
        )
        for number, channel in sorted(found.channels.items())
    }
    ends = set(found.chunk_ends)
    for index, message in enumerate(found.messages, start=1):
        if message.channel_id in channels:
            writer.add_message(
                channel_id=channels[message.channel_id],
                log_time=message.log_time,
                data=message.data,
                publish_time=message.publish_time,
                sequence=message.sequence,
            )
        if index in ends:
            writer.flush()  # type: ignore[no-untyped-call]
    writer.finish()  # type: ignore[no-untyped-call]


def summarise(path: Path) -> SegmentSummary:
    """What `metadata.yaml` says of a segment that is already there."""
    found = walk(read_whole(path))
    number = Counter(message.channel_id for message in found.messages)
    counts = {channel.topic: number[channel.id] for channel in found.channels.values()}
    types = {
        channel.topic: found.schemas[channel.schema_id].name
        for channel in found.channels.values()
        if channel.schema_id in found.schemas
    }
    times = [message.log_time for message in found.messages]
    return SegmentSummary(path.name, min(times, default=None), max(times, default=0), counts, types)
