"""A recording's segments as one MCAP file, in order of log time, with what lies beside them attached."""

import heapq
import logging
import mimetypes
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from io import BytesIO
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, Self, TypeAlias

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata

from aerodft.adapters.recording import (
    MAGIC,
    RECORD_HEAD,
    RECORDING_KEY,
    Channel,
    ChannelMessage,
    ChunkBuffer,
    Registry,
    encode_records,
)
from aerodft.adapters.recording.read import (
    ATTACHMENT_HEAD_BYTES,
    MOST_ATTACHMENTS,
    SegmentScan,
    attachment_head,
)
from aerodft.adapters.recording.write import COUNT_NAME, PROFILE, Annotator, Summary
from aerodft.errors import InputError, os_errors_as
from aerodft.version import SOFTWARE
from replay.recordings import Recording, messages_by_time

_MOST_METADATA_BYTES: Final = 4 << 20
_HEAD: Final = struct.Struct("<BQ")
_Metadata: TypeAlias = tuple[str, dict[str, str]]  # name, and values by key
_DAMAGED: Final = (McapError, struct.error, ValueError, OverflowError)

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class FileAttachment:
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
        """Pieces of the attachment's data.

        Raises:
            InputError: It cannot be read, or is not all there any more.
        """
        with os_errors_as("the file cannot be read", where=self.path), self.path.open("rb") as file:
            file.seek(self.offset)
            left = self.data_bytes
            while left:
                piece = file.read(min(left, _CHUNK_BYTES))
                if not piece:
                    raise InputError("the file became shorter while it was read", where=self.path)
                left -= len(piece)
                yield piece


def merge_segments(recording: Recording, path: Path) -> "MergedRecordingWriter":
    """Write all messages, metadata and attachments of a recording as one file, with chunks, checksums and an index.

    What viewers draw over the images is made of the poses and measurements, see ``Annotator``.

    At a time it holds those chunks that overlap in time, and one attachment. What is not in it, ``recording.left_out``
    says afterwards.

    Args:
        recording: The recording.
        path: The file.

    Returns:
        The file as it was written: how many messages and attachments are in it.

    Raises:
        InputError: A segment cannot be read, or has more attachments than can be held.
        OSError: The file cannot be written.
    """
    segments = [*recording.data, *(each for each in recording.images if each not in recording.data)]
    metadata, attachments = _metadata_and_attachments(segments)
    with path.open("wb") as file, MergedRecordingWriter(file, metadata) as merged:
        for attachment in chain(attachments, _sidecar_files(recording)):
            merged.attach(attachment)
        annotator = Annotator(recording.station)
        for message in _by_time(segments):
            merged.add(message)
            for beside in annotator.messages(message):
                merged.add(beside)
            del message  # of megabytes: not to be held while the next one is read
        recording.damaged_messages += annotator.damaged_messages
    return merged


def _by_time(segments: list[SegmentScan]) -> Iterator[ChannelMessage]:
    """The messages of all segments by log time; of the same time, in order of the segments. Opens each when due."""
    waiting: list[tuple[int, int, ChannelMessage | None]] = [
        (min(chunk.start_ns for chunk in segment.chunks), number, None)
        for number, segment in enumerate(segments)
        if segment.chunks
    ]
    heapq.heapify(waiting)
    streams = [messages_by_time(segment) for segment in segments]
    while waiting:
        due_ns, number, message = waiting[0]
        if message is not None:
            waiting[0] = (due_ns, number, None)
            yield message
        message = next(streams[number], None)
        if message is None:
            heapq.heappop(waiting)
        else:
            heapq.heapreplace(waiting, (message.log_ns, number, message))


def _metadata_and_attachments(
    segments: list[SegmentScan],
) -> tuple[list[tuple[str, dict[str, str]]], list[FileAttachment]]:
    """The metadata of all segments, each once, and their attachments; damaged records are left out with a warning."""
    metadata: dict[str, _Metadata] = {}
    attachments: list[FileAttachment] = []
    for segment in segments:
        for opcode, offset, length in _extra_records(segment.path):
            try:
                if opcode == Opcode.ATTACHMENT:
                    begin = _read_bytes(segment.path, offset, min(length, ATTACHMENT_HEAD_BYTES))
                    head = attachment_head(begin, length)
                    attachments.append(FileAttachment(head.about, segment.path, offset + head.data_at, head.data_bytes))
                elif length <= _MOST_METADATA_BYTES:  # a larger one is nobody's configuration
                    record = Metadata.read(ReadDataStream(BytesIO(_read_bytes(segment.path, offset, length))))
                    if record.name == COUNT_NAME:  # of chunks that are not in the file
                        continue
                    record.metadata.pop(RECORDING_KEY, None)  # which chunks of a merged file do not carry
                    key = repr((record.name, sorted(record.metadata.items())))
                    metadata.setdefault(key, (record.name, record.metadata))
            except _DAMAGED:
                _log.warning("%s: a damaged record at byte %d is left out", segment.path, offset)
            if len(attachments) > MOST_ATTACHMENTS:
                raise InputError(f"more than {MOST_ATTACHMENTS} attachments", where=segment.path)
    return list(metadata.values()), attachments


def _sidecar_files(recording: Recording) -> Iterator[FileAttachment]:
    """The files beside the segments."""
    if not recording.folder.is_dir():
        return
    for path in sorted(recording.folder.iterdir()):
        if path.is_file() and path.suffix != ".mcap" and not path.name.startswith("."):
            kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
            at_ns = recording.start_ns
            about = Attachment(create_time=at_ns, log_time=at_ns, name=path.name, media_type=kind, data=b"")
            yield FileAttachment(about, path, 0, path.stat().st_size)


def _read_bytes(path: Path, offset: int, length: int) -> bytes:
    """``length`` bytes of a file from an offset.

    Raises:
        InputError: The file cannot be read.
    """
    with os_errors_as("the recording cannot be read", where=path), path.open("rb") as file:
        file.seek(offset)
        return file.read(length)


def _extra_records(path: Path) -> Iterator[tuple[int, int, int]]:
    """Metadata and attachments of a file, as far as it is whole: opcode, where the content begins, and its length."""
    with os_errors_as("the recording cannot be read", where=path):
        size = path.stat().st_size
        with path.open("rb") as file:
            file.seek(len(MAGIC))
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                opcode, length = _HEAD.unpack(head)
                begin = file.tell()
                if begin + length > size:
                    return
                if opcode in {Opcode.METADATA, Opcode.ATTACHMENT}:
                    yield opcode, begin, length
                file.seek(begin + length)


_CHUNK_BYTES: Final = 1 << 20
_DATA_SIZE: Final = struct.Struct("<Q")
_CRC: Final = struct.Struct("<I")


class MergedRecordingWriter:
    """Writes the file; it is whole once the context is left.

    The recorder's own layout: the stock writer holds a large image five times.

    Args:
        file: Empty, open for writing.
        metadata: Keys and values, by name.

    Attributes:
        messages: Messages written so far.
        attachments: Attachments written so far.

    Raises:
        OSError: From all methods: the file cannot be written.
    """

    def __init__(self, file: BinaryIO, metadata: Iterable[_Metadata]) -> None:
        self.messages = self.attachments = 0
        self._file = file
        self._registry = Registry()
        self._summary = Summary(PROFILE, SOFTWARE, metadata, self._registry.schemas, self._registry.channels)
        self._compressor = zstandard.ZstdCompressor()  # nobody waits for it: a sixth smaller than what is recorded live
        self._buffer = ChunkBuffer()
        self._ids: dict[int, int] = {}
        self._channels: list[Channel] = []  # an id stays one object's as long as the object is kept
        file.write(self._summary.header)

    def attach(self, found: "FileAttachment") -> None:
        """Write an attachment, of any size, piece by piece; before the first message.

        Raises:
            InputError: It cannot be read.
        """
        offset, about = self._file.tell(), found.about
        empty = encode_records(about)[RECORD_HEAD.size :]
        head = empty[: -_DATA_SIZE.size - _CRC.size] + _DATA_SIZE.pack(found.data_bytes)
        length, crc = len(head) + found.data_bytes + _CRC.size, zlib.crc32(head)
        self._file.write(RECORD_HEAD.pack(Opcode.ATTACHMENT, length) + head)
        for piece in found.pieces():
            self._file.write(piece)
            crc = zlib.crc32(piece, crc)
        self._file.write(_CRC.pack(crc))
        self._summary.attach(offset, RECORD_HEAD.size + length, about, found.data_bytes)
        self.attachments += 1

    def add(self, message: ChannelMessage) -> None:
        """Add a message; segments that have the same channel share it."""
        channel = self._ids.get(id(message.channel))
        if channel is None:
            channel = self._ids[id(message.channel)] = self._registered(message.channel)
            self._channels.append(message.channel)
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
            self._file.write(self._summary.footer(self._file.tell()))

    def _registered(self, found: Channel) -> int:
        identity = self._registry.find(found)
        if identity is None:
            self._buffer.define(self._registry.register(found))
            identity = len(self._registry.channels)
        return identity

    def _close_chunk(self) -> None:
        chunk = self._buffer.build(self._compressor)
        self._buffer = ChunkBuffer()
        offset = self._file.tell()
        for part in (chunk.head, chunk.content, chunk.indexes):
            self._file.write(part)
        self._summary.add(offset, chunk)
