"""A series of segments: rolls over at a size, flushes and syncs by time, and outlives a full disk."""

import logging
import time
from collections.abc import Callable
from pathlib import Path

from aerodft.adapters.mcap.channels import Channel
from aerodft.adapters.mcap.segment import Segment, sync_folder

FLUSH_S = 0.5
SYNC_S = 1.0
RETRY_S = 5.0

_log = logging.getLogger(__name__)


class Series:
    """Writes ``{stem}_000.mcap``, ``{stem}_001.mcap``, ... from one thread at a time.

    A disk that fails or is full costs messages, never the caller: the torn end is cut off, the loss is counted, and a
    new segment is tried every ``RETRY_S``.

    Args:
        folder: Where.
        stem: First part of the file names.
        station: For the files' metadata.
        compress: Whether chunks are compressed.
        segment_bytes: Size at which a new segment begins.
        first_messages: Written at the start of every segment, so that it is valid from the beginning.

    Raises:
        OSError: The first segment cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        stem: str,
        station: str,
        *,
        compress: bool,
        segment_bytes: int,
        first_messages: Callable[[Segment], None],
    ) -> None:
        self._folder = folder
        self._stem = stem
        self._station = station
        self._compress = compress
        self._segment_bytes = segment_bytes
        self._first_messages = first_messages
        self._segments = 0
        self._done = 0
        self._lost = 0
        self._retry_s = 0.0
        self._flushed_s = self._synced_s = time.monotonic()
        self._segment: Segment | None = self._open()

    @property
    def stored(self) -> int:
        """Messages that are in the files."""
        return self._done + (self._segment.messages if self._segment else 0)

    @property
    def lost(self) -> int:
        """Messages that a failing disk cost."""
        return self._lost

    def write(self, channel: Channel, log_ns: int, data: bytes, sequence: int = 0) -> None:
        """Add a message, or count it as lost."""
        segment = self._segment or self._reopened()
        if segment is None:
            self._lost += 1
            return
        try:
            segment.write(channel, log_ns, data, sequence)
        except OSError as error:
            self._give_up(segment, error)

    def tend(self) -> None:
        """Flush, sync and roll over where it is time; to be called at least every ``FLUSH_S``."""
        segment, now_s = self._segment, time.monotonic()
        if segment is None or now_s < self._flushed_s + FLUSH_S:
            return
        try:
            if segment.unflushed:
                segment.flush()
                self._flushed_s = now_s
            if now_s >= self._synced_s + SYNC_S:
                segment.sync()
                self._synced_s = now_s
            if segment.size_bytes >= self._segment_bytes:
                segment.finish()
                self._done += segment.messages
                self._segment = None
                self._segment = self._open()
        except OSError as error:
            self._give_up(segment, error)

    def close(self) -> None:
        """Finish the last segment."""
        segment = self._segment
        if segment is None:
            return
        try:
            segment.finish()
            self._done += segment.messages
            self._segment = None
        except OSError as error:
            self._give_up(segment, error)

    def _open(self) -> Segment:
        path = self._folder / f"{self._stem}_{self._segments:03d}.mcap"
        segment = Segment(path, self._station, number=self._segments, compress=self._compress)
        self._segments += 1
        try:
            self._first_messages(segment)
            segment.flush()
            segment.sync()
            sync_folder(self._folder)
        except OSError:
            segment.abandon()
            raise
        return segment

    def _reopened(self) -> Segment | None:
        if time.monotonic() < self._retry_s:
            return None
        try:
            self._segment = self._open()
        except OSError:
            self._retry_s = time.monotonic() + RETRY_S
            return None
        _log.warning("recording again: %s", self._segment.path)
        return self._segment

    def _give_up(self, segment: Segment, error: OSError) -> None:
        if segment is self._segment:
            self._done += segment.messages
            self._lost += segment.abandon()
        self._segment = None
        self._retry_s = time.monotonic() + RETRY_S
        _log.error("%s: cannot be written (%s); what comes now is lost until it can", segment.path, error.strerror)
