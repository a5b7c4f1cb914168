"""A recording's segments as one MCAP file, in order of log time, with what lies beside them attached."""

import heapq
import logging
import mimetypes
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata

from aerodft.adapters.mcap.attachments import HEAD_BYTES, MOST_ATTACHMENTS, attachment_head
from aerodft.adapters.mcap.layout import MAGIC
from aerodft.adapters.mcap.places import SegmentScan
from aerodft.adapters.mcap.reading import ReadMessage
from aerodft.errors import InputError
from replay.merged_file import Attached, MergedFile
from replay.nearly_sorted import nearly_sorted
from replay.recording import Recording

_MOST_METADATA_BYTES: Final = 4 << 20
_HEAD: Final = struct.Struct("<BQ")
_DAMAGED: Final = (McapError, struct.error, ValueError, OverflowError)

_log = logging.getLogger(__name__)


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
        InputError: A segment cannot be read, or has more attachments than can be held.
        OSError: The file cannot be written.
    """
    segments = [*recording.data, *(each for each in recording.images if each not in recording.data)]
    metadata, attached = _carried(segments)
    with path.open("wb") as file, MergedFile(file, metadata) as merged:
        for attachment in chain(attached, _beside(recording)):
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


def _carried(segments: list[SegmentScan]) -> tuple[list[tuple[str, dict[str, str]]], list[Attached]]:
    """The metadata of all segments, each once, and their attachments; what is damaged is left out, and said."""
    metadata: dict[str, tuple[str, dict[str, str]]] = {}
    attached: list[Attached] = []
    for segment in segments:
        for opcode, offset, length in _places(segment.path):
            try:
                if opcode == Opcode.ATTACHMENT:
                    attached.append(_attached(segment.path, offset, length))
                elif length <= _MOST_METADATA_BYTES:  # a larger one is nobody's configuration
                    record = Metadata.read(ReadDataStream(BytesIO(_begun(segment.path, offset, length))))
                    key = repr((record.name, sorted(record.metadata.items())))
                    metadata.setdefault(key, (record.name, record.metadata))
            except _DAMAGED:
                _log.warning("%s: a damaged record at byte %d is left out", segment.path, offset)
            if len(attached) > MOST_ATTACHMENTS:
                raise InputError(f"more than {MOST_ATTACHMENTS} attachments", where=segment.path)
    return list(metadata.values()), attached


def _beside(recording: Recording) -> Iterator[Attached]:
    """The files beside the segments."""
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


def _places(path: Path) -> Iterator[tuple[int, int, int]]:
    """Metadata and attachments of a file, as far as it is whole: opcode, where the content begins, and its length."""
    try:
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
    except OSError as error:
        raise InputError("the recording cannot be read", where=path, got=error.strerror) from error
