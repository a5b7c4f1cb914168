"""Segments: numbered MCAP files of one series, each readable up to its last chunk whatever happens.

The file under a segment is unbuffered, locked while it is written, and has room reserved for how it ends.
Blocks beyond the end of the file are allocated before they are needed. So a disk that fills up is known *before*
something is written, nothing is torn, and what belongs at the end has its place, whoever else fills the disk. Where the
file system cannot do that, the end has no guaranteed place; recovery then writes it.
"""

import ctypes
import errno
import fcntl
import logging
import os
import resource
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import orjson
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.records import Channel as ChannelRecord

from aerodft.adapters.recording.layout import (
    INDEX_ENTRY_BYTES,
    INDEX_HEAD_BYTES,
    MAGIC,
    EncodedChunk,
    Registry,
    encode_records,
)
from aerodft.version import SOFTWARE

_KEEP_SIZE = 1
_PIECE_BYTES = 1 << 20
_UNLIMITED = 1 << 62
_UNSUPPORTED = frozenset({errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL, errno.EPERM})


def pieces(descriptor: int, offset: int, length: int) -> Iterator[bytes]:
    """Part of a file, of any size, a megabyte at a time.

    Raises:
        OSError: It cannot be read.
    """
    for at in range(offset, offset + length, _PIECE_BYTES):
        yield os.pread(descriptor, min(_PIECE_BYTES, offset + length - at), at)


class SegmentFile:
    """A new file, open for appending.

    Attributes:
        path: Where.
        size: Bytes in it.
        most_bytes: What this process may write to it.

    Raises:
        OSError: From any method; it cannot be made, or what was written last is torn.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
        self.most_bytes = _UNLIMITED if limit == resource.RLIM_INFINITY else limit
        self._allocated: int | None = 0
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC  # appends where `cut` cut it
        self._descriptor = os.open(path, flags, 0o644)
        with suppress(OSError):  # a file system without locks: recovery cannot tell who writes there, nor can we
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def reserve(self, size: int, step: int) -> None:
        """Make sure that the file can grow to ``size``, and if possible by another ``step``.

        Raises:
            OSError: The disk is full, or the file too large for this process; the file is as it was.
        """
        if size > self.most_bytes:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
        if self._allocated is None or size <= self._allocated:
            return
        for wanted in (size + step, size):
            try:
                allocate(self._descriptor, self.size, wanted - self.size)
            except OSError as error:
                if error.errno in _UNSUPPORTED:
                    self._allocated = None
                    return
                if wanted == size:
                    raise
            else:
                self._allocated = wanted
                return

    def write(self, data: bytes) -> None:
        """Append."""
        rest = memoryview(data)
        while rest:
            written = os.write(self._descriptor, rest)
            self.size += written
            rest = rest[written:]

    def cut(self, size: int) -> None:
        """Cut the end off, what is allocated beyond it included."""
        os.ftruncate(self._descriptor, size)
        self.size = size
        self._allocated = None if self._allocated is None else size

    @property
    def is_gone(self) -> bool:
        """Whether somebody has deleted it: what is written to it then is lost."""
        return os.fstat(self._descriptor).st_nlink == 0

    def sync(self, *, size: bool = False) -> None:
        """Wait until the disk has the content, and where asked the size too."""
        (os.fsync if size else os.fdatasync)(self._descriptor)
        if self.is_gone:
            raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))

    def allow(self, mode: int) -> None:
        """Give it the permissions of another file."""
        os.fchmod(self._descriptor, mode & 0o777)

    def close(self) -> None:
        """Close it; what matters is synced before."""
        try:
            os.close(self._descriptor)
        except OSError as error:
            _log.warning("%s: closed with an error (%s)", self.path, error.strerror)


def allocate(descriptor: int, offset: int, length: int) -> None:
    """Allocate blocks for a part of a file without changing its size.

    Raises:
        OSError: There is no room, or the file system cannot.
    """
    if _fallocate is None:
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))
    if _fallocate(descriptor, _KEEP_SIZE, offset, length):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def free_bytes(folder: Path) -> int:
    """Free space for this user on a folder's disk.

    Raises:
        OSError: The folder is gone.
    """
    found = os.statvfs(folder)
    return found.f_bavail * found.f_frsize


def sync_folder(folder: Path) -> None:
    """Make new names in a folder survive a power cut.

    Raises:
        OSError: The folder is gone, or the disk fails.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _find_fallocate() -> "ctypes._NamedFuncPointer | None":
    try:
        function = ctypes.CDLL(None, use_errno=True).fallocate
    except (OSError, AttributeError):  # no such function: not Linux
        return None
    function.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_int64, ctypes.c_int64)
    function.restype = ctypes.c_int
    return function


_fallocate = _find_fallocate()


# What a chunk takes in the summary without its channels, and what each of them takes there and in the statistics.
_CHUNK_SUMMARY_BYTES, _CHANNEL_SUMMARY_BYTES, _FIXED_SUMMARY_BYTES = 90, 10, 4096
_CRC_BYTES = 4
MOST_INDEX_BYTES: Final = 8 << 20
"""Of chunks in a summary: three hours of ours. Readers hold it in memory, and believe no more of it than twice that."""


class Summary:
    """Summary section of a file: places of its chunks, and counts of their messages.

    Args:
        profile: Of the header.
        library: Of the header.
        metadata: Keys and values, by name.
        schemas: Records of the schemas by id; what is added later is seen.
        channels: Records of the channels by id; what is added later is seen.
    """

    def __init__(
        self,
        profile: str,
        library: str,
        metadata: Iterable[tuple[str, dict[str, str]]],
        schemas: dict[int, Schema],
        channels: dict[int, ChannelRecord],
    ) -> None:
        self._schemas = schemas
        self._channels = channels
        self._indexes: list[ChunkIndex] = []
        self._counts: list[dict[int, int]] = []
        self._metadata_indexes: list[MetadataIndex] = []
        self._attachment_indexes: list[AttachmentIndex] = []
        self.messages = 0
        self.header = MAGIC + encode_records(Header(profile=profile, library=library))
        for name, values in metadata:
            record = encode_records(Metadata(name=name, metadata=values))
            self._metadata_indexes.append(MetadataIndex(offset=len(self.header), length=len(record), name=name))
            self.header += record
        self._bytes = _FIXED_SUMMARY_BYTES + sum(40 + len(index.name) for index in self._metadata_indexes)

    @property
    def is_full(self) -> bool:
        """Whether no more chunks should be added."""
        return self._bytes > MOST_INDEX_BYTES

    def most_bytes(self, definitions: int) -> int:
        """Upper bound of ``footer``'s length, with that many bytes of definitions."""
        return self._bytes + definitions + _CHANNEL_SUMMARY_BYTES * len(self._channels)

    def add(self, offset: int, chunk: EncodedChunk) -> None:
        """Take note of a chunk that is in the file."""
        self._indexes.append(_chunk_index(offset, chunk))
        self._counts.append(chunk.counts)
        self._bytes += index_bytes(chunk)
        self.messages += chunk.messages

    @property
    def indexes(self) -> list[ChunkIndex]:
        """The index of the chunks, in order."""
        return self._indexes

    def attach(self, offset: int, length: int, attachment: Attachment, data_bytes: int) -> None:
        """Take note of an attachment that is in the file, in a record of ``length`` bytes, ``data_bytes`` its own."""
        self._attachment_indexes.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                log_time=attachment.log_time,
                create_time=attachment.create_time,
                data_size=data_bytes,
                name=attachment.name,
                media_type=attachment.media_type,
            )
        )

    def forget(self, from_offset: int) -> None:
        """Drop the chunks from an offset on, which are cut off."""
        while self._indexes and self._indexes[-1].chunk_start_offset >= from_offset:
            del self._indexes[-1]
            self.messages -= sum(self._counts.pop().values())

    def footer(self, position: int) -> bytes:
        """All that comes behind the last chunk, which ends at ``position``."""
        data_end = encode_records(DataEnd(data_section_crc=0))
        start = position + len(data_end)
        groups: list[tuple[Opcode, bytes]] = [
            (Opcode.SCHEMA, encode_records(*self._schemas.values())),
            (Opcode.CHANNEL, encode_records(*self._channels.values())),
            (Opcode.STATISTICS, encode_records(self._statistics())),
            (Opcode.CHUNK_INDEX, encode_records(*self._indexes)),
            (Opcode.ATTACHMENT_INDEX, encode_records(*self._attachment_indexes)),
            (Opcode.METADATA_INDEX, encode_records(*self._metadata_indexes)),
        ]
        content, offsets = b"", b""
        for opcode, group in groups:
            if group:
                place = SummaryOffset(group_opcode=opcode, group_start=start + len(content), group_length=len(group))
                offsets += encode_records(place)
                content += group
        footer = Footer(summary_start=start, summary_offset_start=start + len(content), summary_crc=0)
        checked = content + offsets + encode_records(footer)[:-_CRC_BYTES]
        footer.summary_crc = zlib.crc32(checked)
        return b"".join((data_end, content, offsets, encode_records(footer), MAGIC))

    def _statistics(self) -> Statistics:
        totals: Counter[int] = Counter()
        for counts in self._counts:
            totals.update(counts)
        return Statistics(
            attachment_count=len(self._attachment_indexes),
            channel_count=len(self._channels),
            channel_message_counts=totals,
            chunk_count=len(self._indexes),
            message_count=self.messages,
            message_start_time=min((each.message_start_time for each in self._indexes), default=0),
            message_end_time=max((each.message_end_time for each in self._indexes), default=0),
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self._schemas),
        )


def index_bytes(chunk: EncodedChunk) -> int:
    """Upper bound of a chunk's share of the summary, in bytes."""
    return _CHUNK_SUMMARY_BYTES + _CHANNEL_SUMMARY_BYTES * len(chunk.counts)


def _chunk_index(offset: int, chunk: EncodedChunk) -> ChunkIndex:
    places: dict[int, int] = {}
    length = len(chunk.head) + len(chunk.content)
    position = offset + length
    first = position
    for channel_id, count in chunk.counts.items():
        places[channel_id] = position
        position += INDEX_HEAD_BYTES + INDEX_ENTRY_BYTES * count
    return ChunkIndex(
        message_start_time=chunk.start_ns,
        message_end_time=chunk.end_ns,
        chunk_start_offset=offset,
        chunk_length=length,
        message_index_offsets=places,
        message_index_length=position - first,
        compression=chunk.compression,
        compressed_size=len(chunk.content),
        uncompressed_size=chunk.content_bytes,
    )


COPIED_KEY: Final = "copied_images"
"""Of a recomputed recording's metadata: the list of the image segments that it holds copies of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CopiedSegment:
    """An image segment that a recomputed recording holds a copy of.

    Attributes:
        recording: Id of the recording that wrote it; None where the segment does not say it.
        chunks: How many chunks it held when it was copied.
        messages: How many messages it held then; None where nobody counted them.
    """

    recording: str | None
    chunks: int
    messages: int | None


def copied_metadata(copied: Sequence[CopiedSegment]) -> dict[str, str]:
    """The metadata entry that lists copied segments; empty for none."""
    listed = [[each.recording, each.chunks, each.messages] for each in copied]
    return {COPIED_KEY: orjson.dumps(listed).decode()} if listed else {}


def copied_segments(metadata: Mapping[str, str]) -> tuple[CopiedSegment, ...]:
    """The copied segments that a recording's metadata lists; empty where it lists none.

    Raises:
        ValueError: The list is damaged.
    """
    found = []
    for each in orjson.loads(metadata.get(COPIED_KEY, "[]")):
        match each:
            case [str() | None as recording, int() as chunks, int() | None as messages]:
                found.append(CopiedSegment(recording=recording, chunks=chunks, messages=messages))
            case _:
                raise ValueError("no list of copied segments")
    return tuple(found)


METADATA_NAME = "aerodft"
CONFIG_NAME = "config"
COUNT_NAME: Final = "aerodft.count"
"""Of the metadata before each chunk: how many chunks and messages the segments of the series hold before it. Where a
segment ends with one, the series goes on in another segment."""
RECOVERED_NAME: Final = "recovered"
"""Of the metadata of a segment that was made whole: what it lost."""
PROFILE = "x-aerodft"

_log = logging.getLogger(__name__)


def count_record(chunks: int, messages: int) -> bytes:
    """Record before a chunk, always of one length, with the numbers of chunks and messages before it."""
    return encode_records(
        Metadata(name=COUNT_NAME, metadata={"chunks": f"{chunks:012d}", "messages": f"{messages:015d}"})
    )


COUNT_BYTES: Final = len(count_record(0, 0))


class Segment:
    """One MCAP file, open for writing.

    Attributes:
        path: The file.
        deleted: Messages that went with the file, where ``abandon`` found it deleted.

    Args:
        path: A file that does not exist yet.
        registry: Channels, which it shares with the other segments of its series.
        metadata: Keys and values, by name, that every segment carries.
        before: How many chunks and messages earlier segments of the series hold.
        spare_bytes: Room that is allocated ahead, beyond what the end of the file needs.
        segment_bytes: Size that it should not exceed.

    Raises:
        OSError: From any method but ``abandon``, which must then be called.
    """

    def __init__(
        self,
        path: Path,
        registry: Registry,
        metadata: Mapping[str, dict[str, str]],
        *,
        before: tuple[int, int],
        spare_bytes: int,
        segment_bytes: int,
    ) -> None:
        self.path = path
        self.deleted = 0
        self._registry = registry
        self._before = before
        self._spare_bytes = spare_bytes
        self._summary = Summary(PROFILE, SOFTWARE, metadata.items(), registry.schemas, registry.channels)
        self._file = SegmentFile(path)
        self._segment_bytes = segment_bytes
        self._unsynced: list[EncodedChunk] = []
        self._chunks = 0
        self._whole = self._synced = 0
        try:
            self._file.write(self._summary.header)
            self._whole = self._synced = self._file.size
        except OSError:
            self.remove()
            raise

    @property
    def messages(self) -> int:
        """Messages in the file; none once somebody has deleted it."""
        return self._summary.messages - self.deleted

    @property
    def has_content(self) -> bool:
        """Whether the segment holds more than its own head."""
        return self._chunks > 1

    @property
    def unsynced(self) -> tuple[EncodedChunk, ...]:
        """Chunks that are in the file, but perhaps not on the disk yet."""
        return tuple(self._unsynced)

    @property
    def unsynced_bytes(self) -> int:
        """Size of the unsynced chunks."""
        return self._whole - self._synced

    @property
    def room_bytes(self) -> int:
        """Bytes by which the file should grow, its end included; negative where it is too large."""
        return 0 if self._summary.is_full else min(self._segment_bytes - self._needed(0), self.most_room_bytes)

    @property
    def most_room_bytes(self) -> int:
        """Bytes by which the file may grow at the very most."""
        return min(2 * self._segment_bytes, self._file.most_bytes) - self._needed(0)

    @property
    def chunks(self) -> int:
        """Chunks in the file."""
        return self._chunks

    def append(self, chunk: EncodedChunk) -> None:
        """Add a chunk; it is readable as soon as this returns."""
        count = self._count()
        self._file.reserve(self._needed(len(count) + chunk.size_bytes), self._spare_bytes)
        offset = self._whole + len(count)
        for part in (count, chunk.head, chunk.content, chunk.indexes):
            self._file.write(part)
        self._summary.add(offset, chunk)
        self._whole = self._file.size
        self._unsynced.append(chunk)
        self._chunks += 1

    def sync(self) -> None:
        """Wait until the disk has it; may run beside ``append``, in a thread of its own."""
        self._file.sync()

    def synced(self, chunks: int, size: int) -> None:
        """Take note that the disk has the first ``chunks`` of ``unsynced``, which end at ``size``."""
        del self._unsynced[:chunks]
        self._synced = size

    @property
    def place(self) -> tuple[int, int]:
        """Place up to which a sync that begins now will have synced, as ``synced`` takes it."""
        return len(self._unsynced), self._whole

    def end(self, *, goes_on: bool) -> None:
        """Write index and footer, and before them where the series ``goes_on`` in another segment."""
        self._file.write(self._ending(goes_on=goes_on))

    def close(self) -> None:
        """Wait until the disk has it all, and close the file."""
        self._file.cut(self._file.size)  # gives back what was allocated beyond
        self._file.sync(size=True)
        self._file.close()

    def abandon(self, *, goes_on: bool, unsynced: bool) -> tuple[EncodedChunk, ...]:
        """Cut off what is torn, end the file as well as it goes, and close it.

        Args:
            goes_on: Whether the series goes on in another segment, also where nothing is cut off.
            unsynced: Also cut off what the disk may not have.

        Returns:
            The chunks that were cut off.
        """
        cut: tuple[EncodedChunk, ...] = ()
        end = self._synced if unsynced else self._whole
        try:
            if self._file.size != end:  # else what is allocated beyond is there for the end
                self._file.cut(end)
        except OSError as error:
            _log.error("%s: what is torn cannot be cut off (%s)", self.path, error.strerror)
            self._file.close()
            return ()
        if unsynced:
            cut = tuple(self._unsynced)
            self._chunks -= len(cut)
            self._whole = end
            self._summary.forget(end)
        if self._file.is_gone:
            self.deleted = self._summary.messages
        try:
            self._file.write(self._ending(goes_on=goes_on or bool(cut)))
            self._file.sync(size=True)
            end = self._file.size
        except OSError:
            _log.warning("%s: has no index; `recover` adds it", self.path)
        with suppress(OSError):
            self._file.cut(end)
        self._file.close()
        return cut

    def remove(self) -> None:
        """Close and delete a file that holds nothing yet."""
        self._file.close()
        with suppress(OSError):
            self.path.unlink()

    def _ending(self, *, goes_on: bool) -> bytes:
        """Records behind the last chunk."""
        count = self._count() if goes_on else b""
        return count + self._summary.footer(self._whole + len(count))

    def _count(self) -> bytes:
        chunks, messages = self._before
        return count_record(chunks + self._chunks, messages + self._summary.messages)

    def _needed(self, bytes_more: int) -> int:
        return self._whole + bytes_more + COUNT_BYTES + self._summary.most_bytes(len(self._registry.definitions))
