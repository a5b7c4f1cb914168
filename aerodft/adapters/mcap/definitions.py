"""The schemas and channels that a file defines: whatever it claims, no more of them than is believed."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, Final, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from aerodft.adapters.mcap.chunks import records_in

MOST_DEFINED_BYTES: Final = 16 << 20
"""Of a file's schemas and channels: those of a large robot take one; some kilobytes of zstd can claim gigabytes."""

_Value = TypeVar("_Value")


class TooMuchDefinedError(ValueError):
    """Schemas and channels of more than ``MOST_DEFINED_BYTES``."""


@dataclass(slots=True)
class Ledger:
    """What a file's definitions take, and which are of the chunk in progress: to undo it costs no more than it."""

    _bytes: int = 0
    _bytes_before: int = 0
    _changes: list[tuple[dict[int, Any], int, Any]] = field(default_factory=list)

    def begin(self) -> None:
        """Another chunk begins."""
        self._bytes_before = self._bytes
        self._changes.clear()

    def put(self, known: dict[int, _Value], value: _Value, record: Schema | Channel) -> None:
        """Have a definition known by its id; of one that is replaced the bytes are not given back.

        Raises:
            TooMuchDefinedError: It is one too many.
        """
        self._bytes += _size_of(record)
        if self._bytes > MOST_DEFINED_BYTES:
            raise TooMuchDefinedError(f"schemas and channels of more than {MOST_DEFINED_BYTES >> 20} MB in the file")
        self._changes.append((known, record.id, known.get(record.id)))
        known[record.id] = value

    def copy(self) -> "Ledger":
        """The same, with nothing to be undone."""
        return Ledger(self._bytes)

    def undo(self) -> None:
        """Take back what the chunk defined."""
        for known, identity, before in reversed(self._changes):
            if before is None:
                del known[identity]
            else:
                known[identity] = before
        self._bytes = self._bytes_before
        self._changes.clear()


@dataclass(slots=True)
class Definitions:
    """Schemas and channels by id.

    Attributes:
        ledger: Of what they take.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    ledger: Ledger = field(default_factory=Ledger)

    def add(self, record: Schema | Channel) -> None:
        """Take a schema or a channel.

        Raises:
            TooMuchDefinedError: It is one too many.
        """
        if isinstance(record, Schema):
            if record != self.schemas.get(record.id):
                self.ledger.put(self.schemas, record, record)
        elif record != self.channels.get(record.id):
            self.ledger.put(self.channels, record, record)


def _size_of(record: Schema | Channel) -> int:
    if isinstance(record, Schema):
        return len(record.name) + len(record.encoding) + len(record.data)
    return sum(map(len, (record.topic, record.message_encoding, *record.metadata, *record.metadata.values())))


def definitions_in(content: bytes) -> Iterator[Schema | Channel]:
    """The schemas and channels of a chunk.

    Raises:
        ValueError: A record ends outside of it, or is none; others as the library has them.
    """
    for opcode, begin, end in records_in(content):
        if opcode == Opcode.SCHEMA:
            yield Schema.read(ReadDataStream(BytesIO(content[begin:end])))
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(ReadDataStream(BytesIO(content[begin:end])))
