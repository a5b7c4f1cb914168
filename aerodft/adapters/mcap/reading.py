"""Messages out of a segment's chunks, in the order in which they were written."""

import logging
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Final, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from aerodft.adapters.mcap.chunk_table import ChunkTable, message_table, record_tables
from aerodft.adapters.mcap.chunks import HEAD_BYTES, MAX_CHUNK_BYTES, chunk_content, chunk_head, records_in
from aerodft.adapters.mcap.definitions import TooMuchDefinedError
from aerodft.adapters.mcap.layout import MESSAGE_HEAD
from aerodft.adapters.mcap.places import Channels, ChunkPlace, ReadChannel
from aerodft.errors import InputError

_DEFINITIONS: Final = (int(Opcode.SCHEMA), int(Opcode.CHANNEL))
_MOST_NAMED: Final = 10  # damaged chunks of a file; one that was cut while it is read has thousands
_MOST_KEPT: Final = 100_000
_DAMAGED: Final = (McapError, struct.error, ValueError, OverflowError)

Wanted = Callable[[ReadChannel], bool]

_log = logging.getLogger(__name__)


class ReadMessage(NamedTuple):
    """One message; ``log_ns`` is an input's arrival, or the tick that made an output."""

    log_ns: int
    channel: ReadChannel
    data: bytes
    sequence: int


@dataclass(slots=True)
class ChunkReader:
    """Reads the chunks of one file; knows the channels of those that it has read.

    Attributes:
        channels: Known so far.
        damaged: Chunks that were left out.
        left_out: Where those begin, each named once; may be shared with who reads the same file again.
    """

    channels: Channels = field(default_factory=Channels)
    damaged: int = 0
    left_out: set[int] = field(default_factory=set)

    def messages(self, chunks: Iterable[ChunkPlace], wanted: Wanted | None = None) -> Iterator[ReadMessage]:
        """The messages of chunks of one file; a damaged chunk is left out, counted and logged.

        Args:
            chunks: In order; a chunk may define the channels of those behind it.
            wanted: Whose messages; None for everybody's.

        Raises:
            InputError: The file cannot be read.
        """
        for place in chunks:
            self.channels.ledger.begin()
            try:
                yield from self._records(_content(place), wanted)
            except _DAMAGED as error:
                self._leave_out(place, error)

    def tables(self, chunks: Iterable[ChunkPlace]) -> Iterator[ChunkTable]:
        """The same messages, each chunk's as columns: quicker where nearly all of them are wanted.

        Args:
            chunks: As in ``messages``.

        Raises:
            InputError: The file cannot be read.
        """
        for place in chunks:
            self.channels.ledger.begin()
            try:
                yield from self._tables(place)
            except _DAMAGED as error:
                self._leave_out(place, error)

    def _tables(self, place: ChunkPlace) -> Iterator[ChunkTable]:
        """Those of one chunk; its content goes with the generator, before the next chunk is unpacked."""
        content = _content(place)
        for records in record_tables(content):
            for row in np.flatnonzero(np.isin(records.opcode, _DEFINITIONS)).tolist():
                self._define(int(records.opcode[row]), content[records.start[row] : records.stop[row]])
            yield message_table(content, self.channels.by_id, records)
            if records.is_damaged:
                raise ValueError("ends within a record, or in none")

    def _leave_out(self, place: ChunkPlace, why: Exception) -> None:
        self.damaged += 1
        if isinstance(why, TooMuchDefinedError):  # what others define must have room
            self.channels.ledger.undo()
        if place.offset in self.left_out or len(self.left_out) == _MOST_KEPT:
            return
        self.left_out.add(place.offset)
        if len(self.left_out) > _MOST_NAMED:
            return
        more = "; further ones are left out and not named" if len(self.left_out) == _MOST_NAMED else ""
        _log.warning("%s: damaged chunk at byte %d left out: %s%s", place.path, place.offset, why, more)

    def _records(self, content: bytes, wanted: Wanted | None) -> Iterator[ReadMessage]:
        known = self.channels.by_id
        for opcode, start, stop in records_in(content):
            if opcode == Opcode.MESSAGE:
                identity, sequence, log_ns, _ = MESSAGE_HEAD.unpack_from(content, start)
                channel = known.get(identity)
                if channel is not None and (wanted is None or wanted(channel)):
                    yield ReadMessage(log_ns, channel, content[start + MESSAGE_HEAD.size : stop], sequence)
            elif opcode in _DEFINITIONS:
                self._define(opcode, content[start:stop])

    def _define(self, opcode: int, data: bytes) -> None:
        """Take a schema or channel record."""
        stream = ReadDataStream(BytesIO(data))
        if opcode == Opcode.SCHEMA:
            self.channels.add_schema(Schema.read(stream))
        else:
            self.channels.add(Channel.read(stream))


def content_bytes(place: ChunkPlace) -> int:
    """What a chunk claims to hold; 0 where it cannot be read.

    Raises:
        InputError: The file cannot be read.
    """
    if place.is_bare:
        return place.length
    try:
        with place.path.open("rb") as file:
            file.seek(place.offset)
            return chunk_head(file.read(min(HEAD_BYTES, place.length)), place.length).content_bytes
    except OSError as error:
        raise InputError("the recording cannot be read", where=place.path, got=error.strerror) from error
    except ValueError:
        return 0


def _content(place: ChunkPlace) -> bytes:
    """A chunk's records, uncompressed and checked.

    Raises:
        InputError: The file cannot be read.
        ValueError: The chunk is damaged.
    """
    try:
        with place.path.open("rb") as file:
            file.seek(place.offset)
            if place.is_bare:
                if place.length > MAX_CHUNK_BYTES:
                    raise ValueError(f"claims {place.length} bytes")
                return file.read(place.length)
            head = chunk_head(file.read(min(HEAD_BYTES, place.length)), place.length)
            file.seek(place.offset + head.data_at)
            data = file.read(head.data_bytes)
    except OSError as error:
        raise InputError("the recording cannot be read", where=place.path, got=error.strerror) from error
    return chunk_content(head, data)
