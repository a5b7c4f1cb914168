"""A series of segments: rolls over by size and time, flushes and syncs by time, and outlives a disk that fails.

What the disk may not have yet is kept as the chunks that were written. After a failure the torn end of the segment is
cut off, and they are written again into a new one: a single failure costs nothing, a full disk what comes until there
is room again, and that is counted.
"""

import logging
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aerodft.adapters.recording.channels import Channel, ChannelMessage, id_channel
from aerodft.adapters.recording.layout import ChunkBuffer, EncodedChunk, Registry, compressor
from aerodft.adapters.recording.write.records import MessageRows
from aerodft.adapters.recording.write.segment import Segment, free_bytes, sync_folder
from aerodft.conventions import SECOND_NS

FLUSH_S = 0.25  # chunks are closed at least every 0.5 s, also where whoever calls `tend` comes late
RETRY_S = 0.05  # after the second failure in a row, then twice as long each time
SYNC_S = 1.0
_CHUNK_BYTES = 1 << 20
_LEAST_CHUNK_BYTES = 4096  # with less room than that a segment is full
_MESSAGE_BYTES = 64  # what a message takes beside its data, in chunk and index, generously
_LONGEST_RETRY_S = 1.0
_MOST_TRIES = 12  # that are waited for where nothing may be lost: seven seconds
_HELD_BYTES = 32 << 20  # of chunks that wait for a disk that fails
_CLOSING_S = 0.5  # that a failing disk has to take the last of them
_UNSYNCED_BYTES = 32 << 20  # beyond it, writing waits for the disk
_RESUME_BYTES = 512 << 10  # less room is not worth a segment

_MUCH_BYTES = 8 << 20  # chunks that the disk may not have are kept: of a flight computed again 30 MB a second

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentedWriterSettings:
    """Settings of a series of segments.

    Attributes:
        folder: Where.
        stem: First part of the file names.
        metadata: Keys and values, by name, that every segment carries.
        channels: Known from the start.
        recording: Id of the recording, which every chunk carries.
        lossless: Whether to wait for a disk that fails instead of losing what comes meanwhile.
        compress: Whether chunks are compressed.
        segment_bytes: Size beyond which a new segment begins.
        segment_s: Length of time, by log times, after which a new segment begins.
        spare_bytes: Room that is allocated ahead.
    """

    folder: Path
    stem: str
    metadata: Mapping[str, dict[str, str]] = field(default_factory=dict)
    channels: tuple[Channel, ...] = ()
    recording: str
    lossless: bool
    compress: bool
    segment_bytes: int
    segment_s: float
    spare_bytes: int


class SegmentedWriter:
    """Writes ``{stem}_000.mcap``, ``{stem}_001.mcap``, ... from one thread at a time.

    Args:
        settings: How.
        first_records: What every segment begins with, so that it is valid from the beginning: by its number, and the
            log time of the message that it is opened for (None of the very first).

    Raises:
        OSError: The first segment cannot be written.
    """

    def __init__(
        self, settings: SegmentedWriterSettings, first_records: Callable[[int, int | None], Iterable[ChannelMessage]]
    ) -> None:
        self._settings = settings
        self._first_records = first_records
        self._registry = Registry()
        self._id_definition = self._registry.register(id_channel(settings.recording))
        for channel in settings.channels:
            self._registry.register(channel)
        self._compressor = compressor() if settings.compress else None
        self._buffer = ChunkBuffer()
        self._repeated = b""
        self._pending: deque[EncodedChunk] = deque()
        self._segments = self._done_chunks = self._done = self._own = self._lost = self._offered = 0
        self._failures = 0
        self._is_closing = False
        self._retry_s = 0.0
        self._room_bytes, self._until_ns = _CHUNK_BYTES, 0
        self._opened_for_ns: int | None = None
        self._flushed_s = time.monotonic()
        self._syncing = _Syncing(settings.stem)
        self._segment: Segment | None = None
        self._segment = self._reopen() or self._open()

    @property
    def offered(self) -> int:
        """Messages that were to be written, those that segments begin with included."""
        return self._offered + self._own

    @property
    def stored(self) -> int:
        """Messages that are in the files."""
        return self._done + (self._segment.messages if self._segment else 0)

    @property
    def own(self) -> int:
        """Number of messages that segments begin with."""
        return self._own

    @property
    def lost(self) -> int:
        """Messages that a failing disk cost."""
        return self._lost

    def write(
        self, channel: Channel, log_ns: int, data: bytes, sequence: int = 0, *, may_start_segment: bool = True
    ) -> None:
        """Add a message, or count it as lost.

        Args:
            channel: Its channel.
            log_ns: Its log time.
            data: Its payload.
            sequence: Its sequence number.
            may_start_segment: Whether a segment may begin with it; not with what can be read only after others.
        """
        self._offered += 1
        self._opened_for_ns = log_ns
        if self._segment is None and self._held_bytes > _HELD_BYTES:
            self._drain()
            if self._segment is None:
                self._lost += 1
                return
        identity = self._identity(channel)
        self._room_bytes -= len(data) + _MESSAGE_BYTES
        if self._room_bytes < 0 or log_ns >= self._until_ns:
            self._make_room(log_ns, len(data), may_start_segment=may_start_segment)
        self._buffer.add(identity, log_ns, data, sequence)

    def write_rows(self, rows: MessageRows) -> None:
        """Add messages, each as by ``write``; as many at once as fit into the chunk in progress."""
        ids = np.array([self._identity(channel) for channel in rows.channels], dtype=np.int64)
        taken = np.cumsum(rows.sizes + _MESSAGE_BYTES)
        row = 0
        while row < len(rows):
            ahead = int(taken[row - 1]) if row else 0
            stop = 0
            if self._segment is not None:
                stop = int(np.searchsorted(taken, ahead + self._room_bytes, side="right"))
                late = np.flatnonzero(rows.log_ns[row:stop] >= self._until_ns)
                stop = row + int(late[0]) if len(late) else stop
            if stop > row:
                rows.lay(row, stop, ids, self._buffer)
                self._offered += stop - row
                self._room_bytes -= int(taken[stop - 1]) - ahead
            if stop < len(rows):
                stop = max(stop, row)
                log_ns, channel, data, sequence = rows.message(stop)
                self.write(channel, log_ns, data, sequence)
                stop += 1
            row = stop

    def maintain(self) -> None:
        """Flush, sync and roll over where it is time; to be called at least every 0.1 s."""
        self._check_sync(wait=False)
        if self._buffer.messages and time.monotonic() >= self._flushed_s + FLUSH_S:
            self._flush()
        self._drain()
        if self._segment is not None and self._segment.unsynced:
            self._syncing.begin_where_due(self._segment)

    def close(self) -> None:
        """Finish the last segment."""
        self._is_closing = True
        self._flush()
        until_s = time.monotonic() + _CLOSING_S
        while self._segment is not None or self._pending:
            if self._segment is not None:
                self._finish(self._segment)
            self._drain()
            if self._segment is None and self._pending:
                if time.monotonic() > until_s:
                    break
                time.sleep(RETRY_S)
        self._lost += sum(chunk.messages for chunk in self._pending)
        self._pending.clear()
        self._syncing.close()

    @property
    def _goes_on(self) -> bool:
        """Whether more comes than what the open segment holds."""
        return not self._is_closing or bool(self._pending)

    @property
    def _held_bytes(self) -> int:
        return self._buffer.content_bytes + sum(len(chunk.content) for chunk in self._pending)

    def _identity(self, channel: Channel) -> int:
        """A channel's id; a new one is defined."""
        known = self._registry.find(channel)
        if known is not None:
            return known
        definition = self._registry.register(channel)
        self._buffer.define(definition)
        self._room_bytes -= 2 * len(definition)  # it also stands in the summary
        self._repeated += definition  # in the next chunk as well: one that is damaged must not cost all that follow
        return len(self._registry.channels)

    def _make_room(self, log_ns: int, size: int, *, may_start_segment: bool) -> None:
        """Close the chunk in progress, and the segment where the message would be too much for it."""
        segment, is_late = self._segment, log_ns >= self._until_ns
        needed = self._buffer.content_bytes + _MESSAGE_BYTES * self._buffer.messages + size + _LEAST_CHUNK_BYTES
        is_over = segment is not None and (
            segment.most_room_bytes < needed or (may_start_segment and (is_late or segment.room_bytes < needed))
        )
        if is_over or self._buffer.content_bytes + size > _CHUNK_BYTES:
            self._flush()
        if is_over and segment is self._segment and segment is not None and segment.has_content:
            self._finish(segment)
            if self._segment is None:
                self._retry_s = 0.0
                self._reopen()
        if is_late and may_start_segment:
            self._until_ns = log_ns + round(self._settings.segment_s * SECOND_NS)
        self._measure_room()
        self._room_bytes -= size

    def _flush(self) -> None:
        """Close the chunk in progress."""
        self._flushed_s = time.monotonic()
        buffer = self._buffer
        if not buffer.messages:
            return
        self._buffer, self._repeated = self._new_buffer(self._repeated), b""
        self._pending.append(buffer.build(self._compressor))
        self._drain()
        self._measure_room()

    def _new_buffer(self, definitions: bytes) -> ChunkBuffer:
        return ChunkBuffer(self._id_definition + definitions)

    def _drain(self) -> None:
        """Write the chunks that wait; after a failure into another segment."""
        while self._pending:
            segment = self._segment or self._reopen()
            if segment is None:
                if not self._settings.lossless or self._failures >= _MOST_TRIES:
                    return
                time.sleep(max(self._retry_s - time.monotonic(), 0.0))
                continue
            if segment.unsynced_bytes > _UNSYNCED_BYTES:
                self._check_sync(wait=True)
                if segment is not self._segment:
                    continue
            try:
                segment.append(self._pending[0])
            except OSError as error:
                is_hopeless = not segment.has_content and self._failures >= _MOST_TRIES
                self._give_up(segment, error, unsynced=False)
                if is_hopeless:
                    self._lost += self._pending.popleft().messages
            else:
                self._pending.popleft()
                self._failures = 0

    def _measure_room(self) -> None:
        """Update the size that the chunk in progress may have."""
        room_bytes = _CHUNK_BYTES if self._segment is None else min(_CHUNK_BYTES, self._segment.room_bytes)
        self._room_bytes = room_bytes - self._buffer.content_bytes

    def _check_sync(self, *, wait: bool) -> None:
        """See what became of the last sync."""
        if self._segment is None:
            return
        try:
            place = self._syncing.ended(wait=wait)
        except OSError as error:
            self._give_up(self._segment, error, unsynced=True)
        else:
            if place is not None:
                self._segment.synced(*place)

    def _finish(self, segment: Segment) -> None:
        """End a segment as it should; another one is open afterwards only where something had to be written again."""
        self._check_sync(wait=True)
        if segment is not self._segment:
            return
        written = False
        try:
            segment.end(goes_on=self._goes_on)
            written = True
            segment.close()
        except OSError as error:
            self._give_up(segment, error, unsynced=written)
        else:
            self._done_chunks += segment.chunks
            self._done += segment.messages
            self._segment = None

    def _open(self) -> Segment:
        settings = self._settings
        path = settings.folder / f"{settings.stem}_{self._segments:03d}.mcap"
        sizes = {"spare_bytes": settings.spare_bytes, "segment_bytes": settings.segment_bytes}
        before = self._done_chunks, self._done
        segment = Segment(path, self._registry, settings.metadata, before=before, **sizes)
        try:
            buffer = ChunkBuffer(self._registry.definitions)
            for record in self._first_records(self._segments, self._opened_for_ns):
                identity = self._registry.find(record.channel)
                if identity is None:
                    raise ValueError(f"{record.channel.topic} is not among the channels")
                buffer.add(identity, record.log_ns, record.data, record.sequence)
            chunk = buffer.build(self._compressor)
            segment.append(chunk)
            segment.sync()
            sync_folder(settings.folder)
        except OSError:
            segment.remove()
            raise
        segment.synced(*segment.place)
        self._segments += 1
        self._own += chunk.messages
        if self._buffer.messages:
            self._repeated = self._registry.definitions
        else:
            self._buffer, self._repeated = self._new_buffer(self._registry.definitions), b""
        self._until_ns = chunk.start_ns + round(settings.segment_s * SECOND_NS)
        return segment

    def _reopen(self) -> Segment | None:
        """Open another segment where it is time to try; None where it is not, or that fails."""
        if time.monotonic() < self._retry_s:
            return None
        try:
            if free_bytes(self._settings.folder) >= _RESUME_BYTES:
                self._segment = self._open()
                self._measure_room()
        except OSError as error:
            _log.debug("no segment can be opened: %s", error)
        if self._segment is None:
            self._delay()
        return self._segment

    def _delay(self) -> None:
        """Try again at once after a first failure, and ever later after others."""
        self._failures += 1
        wait_s = 0.0 if self._failures == 1 else min(RETRY_S * 2.0 ** (self._failures - 2), _LONGEST_RETRY_S)
        self._retry_s = time.monotonic() + wait_s

    def _give_up(self, segment: Segment, error: OSError, *, unsynced: bool) -> None:
        """Leave a segment behind; what it does not hold waits for another one.

        Args:
            segment: The one that is open.
            error: Why.
            unsynced: Whether what the disk may not have is written again too.
        """
        self._syncing.give_up()
        if segment.has_content:
            self._pending.extendleft(reversed(segment.abandon(goes_on=self._goes_on, unsynced=unsynced)))
            self._done += segment.messages
            self._done_chunks += 0 if segment.deleted else segment.chunks
            self._lost += segment.deleted
        else:
            self._segments -= 1
            self._own -= segment.messages
            segment.remove()
        self._segment = None
        self._delay()
        _log.error("%s: cannot be written (%s); going on in another segment", segment.path, error.strerror or error)


class _Syncing:
    """Waits for the disk in a thread of its own, so that who writes goes on meanwhile; one segment at a time.

    Args:
        stem: What the thread is called after.
    """

    def __init__(self, stem: str) -> None:
        self._began_s = time.monotonic()  # of the last sync; before that of this
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix=f"sync-{stem}")
        self._running: tuple[Future[None], int, int] | None = None

    def begin_where_due(self, segment: Segment) -> None:
        """Sync a segment where it is time, or much of it is not synced yet, unless the last sync still goes on."""
        now_s = time.monotonic()
        is_due = now_s >= self._began_s + SYNC_S or segment.unsynced_bytes > _MUCH_BYTES
        if is_due and self._running is None:
            self._began_s = now_s
            self._running = (self._thread.submit(segment.sync), *segment.place)

    def ended(self, *, wait: bool) -> tuple[int, int] | None:
        """Place that a sync which has ended since the last call reached, as ``Segment.place``; else None.

        Args:
            wait: Whether to wait for one that goes on.

        Raises:
            OSError: It failed.
        """
        if self._running is None:
            return None
        future, chunks, size = self._running
        if not (wait or future.done()):
            return None
        self._running = None
        future.result()
        return chunks, size

    def give_up(self) -> None:
        """Wait for a sync that goes on, whatever becomes of it."""
        with suppress(OSError):  # one failure is enough
            self.ended(wait=True)

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown()
