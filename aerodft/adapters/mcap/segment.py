"""Segments: numbered MCAP files of one series, each readable up to its last chunk whatever happens."""

import logging
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from aerodft.adapters.codec.wire import SOFTWARE
from aerodft.adapters.mcap.ending import Summary
from aerodft.adapters.mcap.file import SegmentFile
from aerodft.adapters.mcap.layout import BuiltChunk, Registry

METADATA_NAME = "aerodft"
CONFIG_NAME = "config"
PROFILE = "x-aerodft"

_log = logging.getLogger(__name__)


class Segment:
    """One MCAP file, open for writing.

    Attributes:
        path: The file.
        deleted: Messages that went with the file, where ``abandon`` found it deleted.

    Args:
        path: A file that does not exist yet.
        registry: Channels, which it shares with the other segments of its series.
        metadata: Keys and values, by name, that every segment carries.
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
        spare_bytes: int,
        segment_bytes: int,
    ) -> None:
        self.path = path
        self.deleted = 0
        self._registry = registry
        self._spare_bytes = spare_bytes
        self._summary = Summary(PROFILE, SOFTWARE, metadata.items(), registry.schemas, registry.channels)
        self._file = SegmentFile(path)
        self._segment_bytes = segment_bytes
        self._unsynced: list[BuiltChunk] = []
        self._chunks = 0
        self._whole = self._synced = 0
        try:
            self._file.write(self._summary.beginning)
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
        """Whether it holds more than what every segment begins with."""
        return self._chunks > 1

    @property
    def unsynced(self) -> tuple[BuiltChunk, ...]:
        """What is in the file, but perhaps not on the disk yet."""
        return tuple(self._unsynced)

    @property
    def unsynced_bytes(self) -> int:
        """How much that is."""
        return self._whole - self._synced

    @property
    def room_bytes(self) -> int:
        """By how much the file should grow, its end included; less than nothing where it is too large."""
        return 0 if self._summary.is_full else min(self._segment_bytes - self._needed(0), self.most_room_bytes)

    @property
    def most_room_bytes(self) -> int:
        """By how much it may grow at the very most."""
        return min(2 * self._segment_bytes, self._file.most_bytes) - self._needed(0)

    def reserve(self, bytes_more: int) -> None:
        """Make sure that there is room for so much, and for the end of the file behind it."""
        self._file.reserve(self._needed(bytes_more), self._spare_bytes)

    def append(self, chunk: BuiltChunk) -> None:
        """Add a chunk; it is readable as soon as this returns."""
        offset = self._whole
        for part in (chunk.head, chunk.content, chunk.indexes):
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
        """What a sync that begins now will have synced, as ``synced`` takes it."""
        return len(self._unsynced), self._whole

    def end(self) -> None:
        """Write index and footer."""
        self._file.write(self._summary.ending(self._whole))

    def close(self) -> None:
        """Wait until the disk has it all, and close the file."""
        self._file.cut(self._file.size)  # gives back what was allocated beyond
        self._file.sync_all()
        self._file.close()

    def abandon(self, *, unsynced: bool) -> tuple[BuiltChunk, ...]:
        """Cut off what is torn, end the file as well as it goes, and close it.

        Args:
            unsynced: Also cut off what the disk may not have.

        Returns:
            The chunks that were cut off.
        """
        cut: tuple[BuiltChunk, ...] = ()
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
            self._summary.forget(end)
        if self._file.is_gone:
            self.deleted = self._summary.messages
        try:
            self._file.write(self._summary.ending(end))
            self._file.sync_all()
            end = self._file.size
        except OSError:
            _log.warning("%s: has no index; `aerodft recover` adds it", self.path)
        with suppress(OSError):
            self._file.cut(end)
        self._file.close()
        return cut

    def remove(self) -> None:
        """Close and delete a file that holds nothing yet."""
        self._file.close()
        with suppress(OSError):
            self.path.unlink()

    def _needed(self, bytes_more: int) -> int:
        return self._whole + bytes_more + self._summary.most_bytes(len(self._registry.definitions))
