"""What an MCAP file holds, and where: found without reading its messages."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from aerodft.adapters.recording.channels import Channels

_MOST_IDS: Final = 500_000  # of channels, in the sets that chunks have: these are megabytes in a claimed index


@dataclass(slots=True)
class ChannelSets:
    """The sets of channels that chunks have: few that differ, each of which is kept once."""

    _known: dict[frozenset[int], frozenset[int]] = field(default_factory=dict)
    _ids: int = 0

    def of(self, ids: Iterable[int]) -> frozenset[int] | None:
        """The set of these ids; None, for what is not known, where there are none, or more than can be held."""
        found = frozenset(ids)
        if found not in self._known and self._ids + len(found) <= _MOST_IDS:
            self._known[found] = found
            self._ids += len(found)
        return self._known.get(found) or None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkPlace:
    """A whole chunk in a file, or some messages that stand in no chunk.

    Attributes:
        path: The file.
        offset: Where the content begins: of the chunk record, or of the first message record.
        length: Bytes of it.
        start_ns: Earliest log time in it.
        end_ns: Latest.
        channels: Ids of the channels that have messages in it; None where that is not known.
        is_bare: Whether these are messages without a chunk.
    """

    path: Path
    offset: int
    length: int
    start_ns: int
    end_ns: int
    channels: frozenset[int] | None = None
    is_bare: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentScan:
    """What a segment holds.

    Attributes:
        path: The file.
        chunks: Its whole chunks, in order.
        station: From its metadata; None where it has none.
        is_whole: Whether it ends as it should.
        texts: The configuration that it carries: files by name; empty where it carries none.
        channels: Those that are known before a chunk is read: all of them where ``is_indexed``.
        is_indexed: Whether the file's own index was used.
        left_out: Where damaged chunks begin that were met so far; readers share it.
    """

    path: Path
    chunks: tuple[ChunkPlace, ...]
    station: str | None
    is_whole: bool
    channels: Channels = field(default_factory=Channels)
    is_indexed: bool = False
    texts: dict[str, str] = field(default_factory=dict)
    left_out: set[int] = field(default_factory=set, compare=False, repr=False)
