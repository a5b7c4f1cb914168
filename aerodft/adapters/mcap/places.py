"""What an MCAP file holds, and where: found without reading its messages."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from mcap.records import Channel, Schema

from aerodft.adapters.mcap.definitions import Ledger

_MOST_IDS: Final = 500_000  # of channels, in the sets that chunks have: these are megabytes in a claimed index


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadChannel:
    """A channel as it was found.

    Attributes:
        topic: Its name.
        encoding: Of its messages: ``json``, ``protobuf``, ``cdr``, ``ros1``, ``mavlink``, ...
        schema: The schema's name; empty where there is none.
        metadata: Key and value pairs.
        schema_encoding: ``jsonschema``, ``protobuf``, ``ros2msg``, ...
        schema_data: The schema itself.
    """

    topic: str
    encoding: str
    schema: str
    metadata: dict[str, str]
    schema_encoding: str = ""
    schema_data: bytes = b""


@dataclass(slots=True)
class Channels:
    """The channels of one file, as its schema and channel records make them known.

    Attributes:
        by_id: So far.
        ledger: Of what they take.
    """

    by_id: dict[int, ReadChannel] = field(default_factory=dict)
    ledger: Ledger = field(default_factory=Ledger)
    _schemas: dict[int, Schema] = field(default_factory=dict)

    def add_schema(self, schema: Schema) -> None:
        """Take a schema record.

        Raises:
            TooMuchDefinedError: It is one too many.
        """
        if schema != self._schemas.get(schema.id):
            self.ledger.put(self._schemas, schema, schema)

    def add(self, channel: Channel) -> None:
        """Take a channel record; its schema came before it.

        Raises:
            TooMuchDefinedError: It is one too many.
        """
        schema = self._schemas.get(channel.schema_id)
        found = ReadChannel(
            topic=channel.topic,
            encoding=channel.message_encoding,
            schema="" if schema is None else schema.name,
            metadata=channel.metadata,
            schema_encoding="" if schema is None else schema.encoding,
            schema_data=b"" if schema is None else schema.data,
        )
        if found != self.by_id.get(channel.id):
            self.ledger.put(self.by_id, found, channel)

    def copy(self) -> "Channels":
        """The same, to be added to."""
        return Channels(dict(self.by_id), self.ledger.copy(), dict(self._schemas))


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
