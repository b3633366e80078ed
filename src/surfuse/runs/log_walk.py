"""Walk through the records of an MCAP file that may be cut off or damaged: every chunk that is whole is found.

Our own walk, because the readers of the `mcap` package stop at the first damage: a flipped bit in a length field
would hide everything behind it. A chunk counts only if its checksum is right.
Format: mcap.dev specification; a record is an opcode (1 byte), a length (8 bytes, little endian) and its content.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata, Schema

from surfuse.runs.log_records import Damage

MAGIC = b"\x89MCAP0\r\n"
_PREFIX = 9
_CHUNK_HEAD = struct.Struct("<QQQII")
_CHUNK_LIMIT = 1 << 30
_RECORD_ERRORS = (McapError, EOFError, ValueError, struct.error)


@dataclass
class Walk:
    """What a walk found: `chunk_ends` counts the messages up to each chunk's end, `damage` is (offset, kind, text)."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    damage: list[tuple[int, Damage, str]] = field(default_factory=list)
    chunk_ends: list[int] = field(default_factory=list)


def walk(data: bytes) -> Walk:
    """All readable records of one MCAP file, in file order.

    Chunks with a wrong checksum are left out and named; after a damaged record the walk goes on at the next chunk
    whose fields agree with one another.
    """
    found = Walk()
    if not data.startswith(MAGIC):
        found.damage.append((0, Damage.CORRUPT, "the file does not start as an MCAP file does"))
    position = len(MAGIC)
    while position < len(data):
        end = _record_end(data, position)
        if end is None:
            position = _resume(data, position, found)
            continue
        opcode = data[position]
        if opcode == Opcode.DATA_END:
            _read_summary(data, end, found)
            return found
        _take(data, position, end, found)
        position = end
    found.damage.append((len(data), Damage.UNFINISHED, "the file has no end mark: its writer was stopped"))
    return found


def _record_end(data: bytes, position: int) -> int | None:
    """End of the record at `position`, or None when it cannot be a sound record there."""
    if position + _PREFIX > len(data):
        return None
    opcode = data[position]
    length = int.from_bytes(data[position + 1 : position + _PREFIX], "little")
    end = position + _PREFIX + length
    if end > len(data) or not 1 <= opcode <= 15:
        return None
    if opcode == Opcode.CHUNK:
        return end if _chunk_fields_agree(data, position, length) else None
    if opcode == Opcode.MESSAGE_INDEX:
        entries = int.from_bytes(data[position + _PREFIX + 2 : position + _PREFIX + 6], "little")
        return end if length == 6 + entries and entries % 16 == 0 else None
    if opcode == Opcode.DATA_END:
        return end if length == 4 else None
    # A chunk whose opcode was damaged must not be skipped as something else, and a damaged length not be followed.
    disguised = length > _CHUNK_HEAD.size and _chunk_fields_agree(data, position, length)
    return None if disguised or not _head_is_plausible(data, end) else end


def _head_is_plausible(data: bytes, position: int) -> bool:
    """Whether a record could begin here: a known opcode and a length below 4 GiB, as far as the file goes."""
    head = data[position : position + _PREFIX]
    return not head or data[position:] == MAGIC or (1 <= head[0] <= 15 and not any(head[5:]))


def _chunk_fields_agree(data: bytes, position: int, length: int) -> bool:
    if length < _CHUNK_HEAD.size + 8:
        return False
    *_, name_length = _CHUNK_HEAD.unpack_from(data, position + _PREFIX)
    if name_length > 4:
        return False
    at = position + _PREFIX + _CHUNK_HEAD.size + name_length
    size = int.from_bytes(data[at : at + 8], "little")
    return bool(_CHUNK_HEAD.size + name_length + 8 + size == length)


def _resume(data: bytes, position: int, found: Walk) -> int:
    """Note the damage at `position` and go to the next chunk behind it (or to the end)."""
    for name in (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4"):
        at = data.find(name, position + _PREFIX + _CHUNK_HEAD.size - 4)
        while at >= 0:
            start = at - _PREFIX - _CHUNK_HEAD.size + 4
            length = int.from_bytes(data[start + 1 : start + _PREFIX], "little")
            fits = start + _PREFIX + length <= len(data) and _chunk_fields_agree(data, start, length)
            if fits and _chunk_content(data, start, start + _PREFIX + length) is not None:
                text = f"{start - position} bytes cannot be read" if start > position else "a damaged record head"
                found.damage.append((position, Damage.CORRUPT, text))
                _take_chunk(data, start, start + _PREFIX + length, found)
                return start + _PREFIX + length
            at = data.find(name, at + 1)
    text = f"the last {len(data) - position} bytes are incomplete or damaged"
    found.damage.append((position, Damage.CUT_OFF, text))
    return len(data)


def _chunk_content(data: bytes, position: int, end: int) -> bytes | None:
    """Decompressed records of a chunk, or None when it is not what was written."""
    _, _, size, crc, name_length = _CHUNK_HEAD.unpack_from(data, position + _PREFIX)
    at = position + _PREFIX + _CHUNK_HEAD.size
    name = data[at : at + name_length]
    packed = data[at + name_length + 8 : end]
    if size > _CHUNK_LIMIT:
        return None
    try:
        content = _UNPACK[name](packed, size)
    except (KeyError, RuntimeError, ValueError, EOFError, zstandard.ZstdError):
        return None
    # Without a checksum (0) only a foreign writer's word says that the data is right.
    return content if crc in (0, zlib.crc32(content)) and len(content) == size else None


def _unpack_lz4(packed: bytes, size: int) -> bytes:
    content: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1)
    return content


def _unpack_zstd(packed: bytes, size: int) -> bytes:
    # The frame's own word on its size decides how much memory is taken, so it is checked before.
    if zstandard.frame_content_size(packed) not in (-1, size):
        raise ValueError("the sizes of the chunk disagree")
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=max(size, 1), allow_extra_data=False)


_UNPACK: dict[bytes, Callable[[bytes, int], bytes]] = {
    b"": lambda packed, size: packed,
    b"lz4": _unpack_lz4,
    b"zstd": _unpack_zstd,
}


def _take(data: bytes, position: int, end: int, found: Walk) -> None:
    opcode = data[position]
    if opcode == Opcode.CHUNK:
        _take_chunk(data, position, end, found)
    elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA):
        try:
            _take_record(opcode, data[position + _PREFIX : end], found)
        except _RECORD_ERRORS as error:
            found.damage.append((position, Damage.CORRUPT, f"a record cannot be read: {error}"))


def _take_chunk(data: bytes, position: int, end: int, found: Walk) -> None:
    content = _chunk_content(data, position, end)
    if content is None:
        found.damage.append((position, Damage.CORRUPT, "a chunk fails its checksum"))
        return
    try:
        for opcode, body in _records(content):
            _take_record(opcode, body, found)
    except _RECORD_ERRORS as error:
        found.damage.append((position, Damage.CORRUPT, f"a chunk cannot be read: {error}"))
    found.chunk_ends.append(len(found.messages))


def _records(content: bytes) -> Iterator[tuple[int, bytes]]:
    position = 0
    while position < len(content):
        length = int.from_bytes(content[position + 1 : position + _PREFIX], "little")
        end = position + _PREFIX + length
        if end > len(content):
            raise ValueError("a record reaches beyond its chunk")
        yield content[position], content[position + _PREFIX : end]
        position = end


def _take_record(opcode: int, body: bytes, found: Walk) -> None:
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(stream)
        found.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(stream)
        found.channels[channel.id] = channel
    elif opcode == Opcode.MESSAGE:
        found.messages.append(Message.read(stream, len(body)))
    elif opcode == Opcode.METADATA:
        record = Metadata.read(stream)
        found.metadata[record.name] = record.metadata


def _read_summary(data: bytes, position: int, found: Walk) -> None:
    """Schemas and channels repeated at the end, when the summary's checksum is right."""
    footer = data.rfind(b"\x02\x14\x00\x00\x00\x00\x00\x00\x00", position)
    if footer < 0 or not data.endswith(MAGIC) or footer + 29 + len(MAGIC) != len(data):
        found.damage.append((position, Damage.UNFINISHED, "the file has no end mark: its writer was stopped"))
        return
    (crc,) = struct.unpack_from("<I", data, footer + 25)
    if crc != 0 and zlib.crc32(data[position : footer + 25]) != crc:
        found.damage.append((position, Damage.CORRUPT, "the summary fails its checksum"))
        return
    known = Walk()
    while position < footer:
        end = position + _PREFIX + int.from_bytes(data[position + 1 : position + _PREFIX], "little")
        if data[position] in (Opcode.SCHEMA, Opcode.CHANNEL):
            _take_record(data[position], data[position + _PREFIX : end], known)
        position = end
    found.schemas = known.schemas | found.schemas
    found.channels = known.channels | found.channels
