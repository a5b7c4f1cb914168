"""What an MCAP file holds, and where: found without reading its messages."""

from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Channel, Schema

from aerodft.adapters.mcap.definitions import with_defined


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
    """

    by_id: dict[int, ReadChannel] = field(default_factory=dict)
    _schemas: dict[int, Schema] = field(default_factory=dict)
    _bytes: int = 0

    def add_schema(self, schema: Schema) -> None:
        """Take a schema record.

        Raises:
            TooMuchDefinedError: It is one too many.
        """
        if schema != self._schemas.get(schema.id):
            self._bytes = with_defined(self._bytes, schema)
            self._schemas[schema.id] = schema

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
            self._bytes = with_defined(self._bytes, channel)
            self.by_id[channel.id] = found

    def copy(self) -> "Channels":
        """The same, to be added to."""
        return Channels(dict(self.by_id), dict(self._schemas), self._bytes)


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
