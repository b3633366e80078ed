"""One MCAP segment being written: every `commit` is a checksummed chunk that is on the disk when it returns."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from mcap.records import Schema
from mcap_ros2.writer import Writer

from surfuse import __version__
from surfuse.durable import storage_error, sync_folder
from surfuse.errors import StorageError
from surfuse.runs.definitions import Definition
from surfuse.runs.log_records import FORMAT_VERSION
from surfuse.runs.own_messages import Message
from surfuse.runs.sweep_fields import logged

_BINARY = getattr(os, "O_BINARY", 0)  # else Windows would end every line of the bytes in its own way
# A chunk ends when it is committed, never by its size: one stop is one chunk, whole or not there.
_UNLIMITED_CHUNK = 1 << 40
MARK = "surfuse"
"""Name of the metadata record at the head of our segments; it says `log_format`, `version` and `sweep_fields`: how many
fields a message of a sweep has."""


class _Sink:
    """Collects what the MCAP writer emits until it is committed.

    The writer gets no real file: after a failed write a buffered file would try again at `close`, and an
    unbuffered one would not notice a short write.
    """

    def __init__(self) -> None:
        self._pending = bytearray()
        self._total = 0

    def write(self, data: bytes) -> int:
        self._pending += data
        self._total += len(data)
        return len(data)

    def tell(self) -> int:
        return self._total

    def flush(self) -> None:
        """Nothing to do: `take` hands the bytes over."""

    def take(self) -> bytes:
        taken = bytes(self._pending)
        self._pending.clear()
        return taken


class _RosWriter(Writer):
    """The ROS 2 writer of mcap-ros2-support with chunks that end when asked and channels known from the start."""

    def __init__(self, sink: _Sink) -> None:
        super().__init__(sink, chunk_size=_UNLIMITED_CHUNK)  # type: ignore[arg-type]
        self._announced: dict[str, Schema] = {}

    def end_chunk(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]

    def announce(self, topic: str, definition: Definition) -> None:
        schema = self.register_msgdef(definition.name, definition.text)
        self._channel_ids[topic] = self._writer.register_channel(topic, "cdr", schema.id, {})
        self._announced[topic] = schema

    def put(self, topic: str, message: Message, time_ns: int, sequence: int) -> None:
        self.write_message(topic, self._announced[topic], message, log_time=time_ns, sequence=sequence)


class Segment:
    """A new MCAP file; the file must not exist yet.

    Raises
    ------
    StorageError : the file cannot be created, written or synced. What was committed before stays readable.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.message_count: dict[str, int] = {}
        self.first_ns: int | None = None
        self.last_ns = 0
        self._types: dict[str, str] = {}
        self._broken = False
        self._safe_size = 0
        self._sink = _Sink()
        self._writer = _RosWriter(self._sink)
        mark = {"log_format": str(FORMAT_VERSION), "version": __version__, "sweep_fields": str(len(logged()))}
        self._writer.add_metadata(MARK, mark)
        try:
            self._descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | _BINARY, 0o666)
        except OSError as error:
            raise storage_error(error, path, "create the log segment") from error
        try:
            sync_folder(path.parent)
        except OSError as error:
            raise storage_error(error, path.parent, "sync the log folder") from error

    @property
    def types(self) -> dict[str, str]:
        """Topics of this segment with the names of their types."""
        return dict(self._types)

    def announce(self, topic: str, definition: Definition) -> None:
        """Register a topic; those registered before the first commit share its chunk, in this order."""
        if topic not in self._types:
            self._writer.announce(topic, definition)
            self._types[topic] = definition.name
            self.message_count[topic] = 0

    def put(self, topic: str, message: Message, time_ns: int) -> None:
        """Add a message to the chunk in progress; its sequence number counts the messages of the topic."""
        self._writer.put(topic, message, time_ns, self.message_count[topic])
        self.message_count[topic] += 1
        self.first_ns = time_ns if self.first_ns is None else min(self.first_ns, time_ns)
        self.last_ns = max(self.last_ns, time_ns)

    def commit(self) -> None:
        """End the chunk, write it and sync it: after this it survives a kill and a power cut."""
        self._writer.end_chunk()
        self._write()

    def close(self) -> None:
        """Write summary and footer, and close; a broken segment is closed as it is."""
        try:
            if not self._broken:
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._write()
        finally:
            self._broken = True
            os.close(self._descriptor)

    def _write(self) -> None:
        if self._broken:
            raise StorageError(
                "the log segment failed before and takes no more data",
                where=str(self.path),
                cure="resume the run in a new segment",
            )
        try:
            view = memoryview(self._sink.take())
            size = self._safe_size + len(view)
            while view:
                view = view[os.write(self._descriptor, view) :]
            os.fsync(self._descriptor)
            if os.fstat(self._descriptor).st_nlink == 0:
                raise FileNotFoundError(2, "the file was deleted while it was written")
        except OSError as error:
            self._broken = True
            # Half a chunk is of no use to anyone; without it the segment ends at a whole one.
            with suppress(OSError):
                os.ftruncate(self._descriptor, self._safe_size)
            raise storage_error(error, self.path, "write the log") from error
        self._safe_size = size
