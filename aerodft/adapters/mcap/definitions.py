"""The schemas and channels that a file defines: whatever it claims, no more of them than is believed."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from aerodft.adapters.mcap.chunks import records_in

MOST_DEFINED_BYTES: Final = 16 << 20
"""Of a file's schemas and channels: those of a large robot take one; some kilobytes of zstd can claim gigabytes."""


class TooMuchDefinedError(ValueError):
    """Schemas and channels of more than ``MOST_DEFINED_BYTES``."""


@dataclass(slots=True)
class Definitions:
    """Schemas and channels by id."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    _bytes: int = 0

    def add(self, record: Schema | Channel) -> None:
        """Take a schema or a channel.

        Raises:
            TooMuchDefinedError: It is one too many.
        """
        if isinstance(record, Schema):
            if record != self.schemas.get(record.id):
                self._bytes = with_defined(self._bytes, record)
                self.schemas[record.id] = record
        elif record != self.channels.get(record.id):
            self._bytes = with_defined(self._bytes, record)
            self.channels[record.id] = record

    def copy(self) -> "Definitions":
        """The same, to be added to."""
        return Definitions(dict(self.schemas), dict(self.channels), self._bytes)


def with_defined(so_far_bytes: int, record: Schema | Channel) -> int:
    """The bytes of a file's definitions with one more; of one that is replaced they are not given back.

    Raises:
        TooMuchDefinedError: These are too many.
    """
    if isinstance(record, Schema):
        taken = len(record.name) + len(record.encoding) + len(record.data)
    else:
        texts = (record.topic, record.message_encoding, *record.metadata, *record.metadata.values())
        taken = sum(map(len, texts))
    if so_far_bytes + taken > MOST_DEFINED_BYTES:
        raise TooMuchDefinedError(f"schemas and channels of more than {MOST_DEFINED_BYTES >> 20} MB in the file")
    return so_far_bytes + taken


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
