"""A recording's segments as one MCAP file, in order of log time, with what lies beside them attached."""

import heapq
import mimetypes
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from itertools import accumulate, islice
from pathlib import Path
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata

from aerodft.adapters.mcap.attachments import HEAD_BYTES, MOST_ATTACHMENTS, attachment_head
from aerodft.adapters.mcap.layout import MAGIC
from aerodft.adapters.mcap.places import SegmentScan
from aerodft.adapters.mcap.reading import ChunkReader, ReadMessage, Wanted
from aerodft.errors import InputError
from replay.merged_file import Attached, MergedFile
from replay.recording import Recording

_MOST_HELD_BYTES: Final = 48 << 20  # while a chunk is unpacked
_MOST_WAITING_BYTES: Final = 16 << 20  # while something is written
_MESSAGE_BYTES: Final = 300  # what a message takes in memory besides its payload
_MOST_METADATA_BYTES: Final = 4 << 20
_HEAD: Final = struct.Struct("<BQ")
_DAMAGED: Final = (McapError, struct.error, ValueError, OverflowError)


@dataclass(frozen=True, slots=True)
class Merged:
    """What went into the file.

    Attributes:
        messages: Of all segments.
        attachments: Of the segments, and files beside them.
    """

    messages: int
    attachments: int


def merge_segments(recording: Recording, path: Path) -> Merged:
    """Write all messages, metadata and attachments of a recording as one file, with chunks, checksums and an index.

    At a time it holds those chunks that overlap in time, and one attachment. What is not in it, ``recording.left_out``
    says afterwards.

    Args:
        recording: The recording.
        path: The file.

    Raises:
        InputError: A segment cannot be read.
        OSError: The file cannot be written.
    """
    segments = [*recording.data, *(each for each in recording.images if each not in recording.data)]
    with path.open("wb") as file, MergedFile(file, _metadata(segments)) as merged:
        for attachment in _attachments(recording, segments):
            merged.attach(attachment)
        for message in _by_time(segments):
            merged.add(message)
            del message  # of megabytes: not to be held while the next one is read
    return Merged(merged.messages, merged.attachments)


def _by_time(segments: list[SegmentScan]) -> Iterator[ReadMessage]:
    """The messages of all segments by log time; of the same time, in order of the segments. Opens each when due."""
    waiting: list[tuple[int, int, ReadMessage | None]] = [
        (min(chunk.start_ns for chunk in segment.chunks), number, None)
        for number, segment in enumerate(segments)
        if segment.chunks
    ]
    heapq.heapify(waiting)
    streams = [nearly_sorted(segment) for segment in segments]
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


def nearly_sorted(segment: SegmentScan, wanted: Wanted | None = None) -> Iterator[ReadMessage]:
    """One segment's messages by log time, else as they were written; chunks that overlap are held together.

    Where these are too much to be held, what is earliest of it goes out: a file need not be in order.

    Args:
        segment: The file.
        wanted: Whose messages; None for everybody's.

    Raises:
        InputError: It cannot be read.
    """
    reader = ChunkReader(segment.channels.copy(), left_out=segment.left_out)
    starts = [chunk.start_ns for chunk in segment.chunks]
    later = [*list(accumulate(reversed(starts), min))[-2::-1], None]
    held = _Held()
    for chunk, limit_ns in zip(segment.chunks, later, strict=True):
        for message in reader.messages((chunk,), wanted):
            held.add(message)
            del message
            while held.bytes > _MOST_HELD_BYTES:
                yield held.pop()
        while held.is_due(limit_ns) or held.bytes > _MOST_WAITING_BYTES:
            yield held.pop()


class _Held:
    """Messages by log time, of the same time in the order in which they came."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, ReadMessage]] = []
        self._count = self.bytes = 0

    def is_due(self, limit_ns: int | None) -> bool:
        """Whether there is one from before the limit."""
        return bool(self._heap) and (limit_ns is None or self._heap[0][0] < limit_ns)

    def add(self, message: ReadMessage) -> None:
        heapq.heappush(self._heap, (message.log_ns, self._count, message))
        self._count += 1
        self.bytes += len(message.data) + _MESSAGE_BYTES

    def pop(self) -> ReadMessage:
        message = heapq.heappop(self._heap)[2]
        self.bytes -= len(message.data) + _MESSAGE_BYTES
        return message


def _metadata(segments: list[SegmentScan]) -> list[tuple[str, dict[str, str]]]:
    """The metadata of all segments, each once."""
    found: dict[str, tuple[str, dict[str, str]]] = {}
    for segment in segments:
        for offset, length in _places(segment.path, Opcode.METADATA):
            if length > _MOST_METADATA_BYTES:
                continue  # nobody's configuration
            with suppress(*_DAMAGED):
                record = Metadata.read(ReadDataStream(BytesIO(_begun(segment.path, offset, length))))
                found.setdefault(repr((record.name, sorted(record.metadata.items()))), (record.name, record.metadata))
    return list(found.values())


def _attachments(recording: Recording, segments: list[SegmentScan]) -> Iterator[Attached]:
    """Those of the segments, and the files beside them."""
    for segment in segments:
        for offset, length in islice(_places(segment.path, Opcode.ATTACHMENT), MOST_ATTACHMENTS):
            with suppress(*_DAMAGED):
                yield _attached(segment.path, offset, length)
    if not recording.folder.is_dir():
        return
    for path in sorted(recording.folder.iterdir()):
        if path.is_file() and path.suffix != ".mcap" and not path.name.startswith("."):
            kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
            at_ns = recording.start_ns
            about = Attachment(create_time=at_ns, log_time=at_ns, name=path.name, media_type=kind, data=b"")
            yield Attached(about, path, 0, path.stat().st_size)


def _attached(path: Path, offset: int, length: int) -> Attached:
    """A file's attachment, from its record.

    Raises:
        ValueError: It is damaged; others as the library has them.
    """
    head = attachment_head(_begun(path, offset, min(length, HEAD_BYTES)), length)
    return Attached(head.about, path, offset + head.data_at, head.data_bytes)


def _begun(path: Path, offset: int, length: int) -> bytes:
    """So many bytes of a file.

    Raises:
        InputError: They cannot be.
    """
    try:
        with path.open("rb") as file:
            file.seek(offset)
            return file.read(length)
    except OSError as error:
        raise InputError("the recording cannot be read", where=path, got=error.strerror) from error


def _places(path: Path, kind: Opcode) -> Iterator[tuple[int, int]]:
    """Where the contents of a file's records of a kind begin, as far as it is whole, and their lengths."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            file.seek(len(MAGIC))
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                opcode, length = _HEAD.unpack(head)
                begin = file.tell()
                if begin + length > size:
                    return
                if opcode == kind:
                    yield begin, length
                file.seek(begin + length)
    except OSError as error:
        raise InputError("the recording cannot be read", where=path, got=error.strerror) from error
