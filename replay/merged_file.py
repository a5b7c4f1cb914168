"""The one MCAP file that a recording's segments are put together in: chunks, checksums, attachments and an index."""

import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, Self

import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment

from aerodft.adapters.codec.wire import SOFTWARE
from aerodft.adapters.mcap.channels import Channel
from aerodft.adapters.mcap.ending import Summary
from aerodft.adapters.mcap.layout import RECORD_HEAD, ChunkBuffer, Registry, encoded
from aerodft.adapters.mcap.places import ReadChannel
from aerodft.adapters.mcap.reading import ReadMessage
from aerodft.adapters.mcap.segment import PROFILE
from aerodft.errors import InputError

_CHUNK_BYTES: Final = 1 << 20
_DATA_SIZE: Final = struct.Struct("<Q")
_CRC: Final = struct.Struct("<I")


@dataclass(frozen=True, slots=True)
class Attached:
    """Something to be attached: part of a file, or all of it.

    Attributes:
        about: Its name and times, without its data.
        path: The file.
        offset: Where it begins there.
        data_bytes: How much it is.
    """

    about: Attachment
    path: Path
    offset: int
    data_bytes: int

    def pieces(self) -> Iterator[bytes]:
        """Its data.

        Raises:
            InputError: It cannot be read, or is not all there any more.
        """
        try:
            with self.path.open("rb") as file:
                file.seek(self.offset)
                left = self.data_bytes
                while left:
                    piece = file.read(min(left, _CHUNK_BYTES))
                    if not piece:
                        raise InputError("the file became shorter while it was read", where=self.path)
                    left -= len(piece)
                    yield piece
        except OSError as error:
            raise InputError("the file cannot be read", where=self.path, got=error.strerror) from error


class MergedFile:
    """Writes the file; it is whole once the context is left.

    The recorder's own layout: the stock writer holds a large image five times.

    Args:
        file: Empty, open for writing.
        metadata: Keys and values, by name.

    Attributes:
        messages: Written so far.
        attachments: Likewise.

    Raises:
        OSError: From all methods: the file cannot be written.
    """

    def __init__(self, file: BinaryIO, metadata: Iterable[tuple[str, dict[str, str]]]) -> None:
        self.messages = self.attachments = 0
        self._file = file
        self._registry = Registry()
        self._summary = Summary(PROFILE, SOFTWARE, metadata, self._registry.schemas, self._registry.channels)
        self._compressor = zstandard.ZstdCompressor()  # nobody waits for it: a sixth smaller than what is recorded live
        self._buffer = ChunkBuffer()
        self._ids: dict[int, int] = {}
        self._kept: list[ReadChannel] = []  # an id stays one object's as long as the object is kept
        file.write(self._summary.beginning)

    def attach(self, found: "Attached") -> None:
        """Write an attachment, of any size, piece by piece; before the first message.

        Raises:
            InputError: It cannot be read.
        """
        offset, about = self._file.tell(), found.about
        empty = encoded(about)[RECORD_HEAD.size :]
        head = empty[: -_DATA_SIZE.size - _CRC.size] + _DATA_SIZE.pack(found.data_bytes)
        length, crc = len(head) + found.data_bytes + _CRC.size, zlib.crc32(head)
        self._file.write(RECORD_HEAD.pack(Opcode.ATTACHMENT, length) + head)
        for piece in found.pieces():
            self._file.write(piece)
            crc = zlib.crc32(piece, crc)
        self._file.write(_CRC.pack(crc))
        self._summary.attach(offset, RECORD_HEAD.size + length, about, found.data_bytes)
        self.attachments += 1

    def add(self, message: ReadMessage) -> None:
        """Add a message; segments that have the same channel share it."""
        channel = self._ids.get(id(message.channel))
        if channel is None:
            channel = self._ids[id(message.channel)] = self._registered(message.channel)
            self._kept.append(message.channel)
        if self._buffer.messages and len(message.data) > _CHUNK_BYTES:
            self._close_chunk()
        self._buffer.add(channel, message.log_ns, message.data, message.sequence)
        self.messages += 1
        if self._buffer.content_bytes > _CHUNK_BYTES:
            self._close_chunk()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            if self._buffer.messages:
                self._close_chunk()
            self._file.write(self._summary.ending(self._file.tell()))

    def _registered(self, found: ReadChannel) -> int:
        channel = Channel(
            topic=found.topic,
            encoding=found.encoding,
            schema_name=found.schema,
            schema_encoding=found.schema_encoding,
            schema=found.schema_data,
            metadata=tuple(sorted(found.metadata.items())),
        )
        identity = self._registry.find(channel)
        if identity is None:
            self._buffer.define(self._registry.register(channel))
            identity = len(self._registry.channels)
        return identity

    def _close_chunk(self) -> None:
        chunk = self._buffer.built(self._compressor)
        self._buffer = ChunkBuffer()
        offset = self._file.tell()
        for part in (chunk.head, chunk.content, chunk.indexes):
            self._file.write(part)
        self._summary.add(offset, chunk)
