"""The channels of recordings: those that are written, and those that a file defines.

Whatever a file claims, no more of its schemas and channels is kept than is believed.
"""

from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, Final, NamedTuple, TypeVar

from google.protobuf.message import Message
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import Schema
from mcap_protobuf.schema import build_file_descriptor_set

from aerodft.adapters.wire.schemas import schema_text

SENDER_KEY = "sender"
STATION_KEY = "station"
RECORDING_KEY = "recording"
"""Of the metadata of a segment, and of the channel that every chunk of a recording defines: the recording's id."""
DEFINITIONS: Final = (int(Opcode.SCHEMA), int(Opcode.CHANNEL))
"""What records of a schema and of a channel begin with."""

MOST_DEFINED_BYTES: Final = 16 << 20
"""Of a file's schemas and channels: those of a large robot take one; some kilobytes of zstd can claim gigabytes."""

_Value = TypeVar("_Value")


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One MCAP channel.

    Attributes:
        topic: Its name; for what is also on the bus, the same key expression.
        encoding: Of its messages: ``json``, ``protobuf``, ``mavlink``, ``dataflash``; others' ``cdr``, ``ros1``, ...
        schema: The schema's name; empty where there is none.
        schema_encoding: ``jsonschema``, ``protobuf``, ``ros2msg``, ...
        schema_data: The schema itself.
        metadata: Key and value pairs; of a channel that was read in order of the keys.
    """

    topic: str
    encoding: str
    schema: str = ""
    schema_encoding: str = ""
    schema_data: bytes = b""
    metadata: tuple[tuple[str, str], ...] = ()


class ChannelMessage(NamedTuple):
    """One message of a channel; ``log_ns`` is an input's arrival, or the tick that made an output."""

    log_ns: int
    channel: Channel
    data: bytes
    sequence: int = 0


def raw_channel(protocol: str, sender: str) -> Channel:
    """Raw telemetry frames of one sender, each a message as it came."""
    name = str(protocol)
    return Channel(topic=name, encoding=name, metadata=((SENDER_KEY, sender),))


def id_channel(recording: str) -> Channel:
    """A channel without messages that says of a chunk which recording it belongs to."""
    return Channel(topic="aerodft/recording", encoding="none", metadata=((RECORDING_KEY, recording),))


def is_raw(channel: Channel) -> bool:
    """Whether a channel is as ``raw_channel`` makes it, whatever the protocol."""
    return channel.topic == channel.encoding and SENDER_KEY in dict(channel.metadata)


def json_channel(topic: str, schema: str) -> Channel:
    """Payloads of one of the published JSON Schemas."""
    return Channel(
        topic=topic,
        encoding="json",
        schema=schema,
        schema_encoding="jsonschema",
        schema_data=schema_text(schema),
    )


def protobuf_channel(topic: str, message: type[Message]) -> Channel:
    """Messages of one protobuf type."""
    return Channel(
        topic=topic,
        encoding="protobuf",
        schema=message.DESCRIPTOR.full_name,
        schema_encoding="protobuf",
        schema_data=build_file_descriptor_set(message).SerializeToString(),
    )


class TooMuchDefinedError(ValueError):
    """Schemas and channels of more than ``MOST_DEFINED_BYTES``."""


class ForeignChunkError(ValueError):
    """A chunk that belongs to another recording."""


@dataclass(slots=True)
class Channels:
    """The channels of one file, as its schema and channel records make them known.

    Attributes:
        by_id: So far.
        records: Their records.
        schemas: Records of the schemas, by id.
        recording: Id of the recording that each chunk has to belong to; None where chunks need none.
    """

    by_id: dict[int, Channel] = field(default_factory=dict)
    records: dict[int, ChannelRecord] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    recording: str | None = None
    _owner: str | None = None
    _bytes: int = 0
    _bytes_before: int = 0
    _changes: list[tuple[dict[int, Any], int, Any]] = field(default_factory=list)

    def begin_chunk(self) -> None:
        """Note that a chunk begins, whose definitions ``undo_chunk`` takes back."""
        self._bytes_before, self._owner = self._bytes, None
        self._changes.clear()

    def check_owner(self) -> None:
        """See whether the chunk that is being read belongs to this recording, now that its definitions are known.

        Raises:
            ForeignChunkError: It belongs to another one, or to none.
        """
        if self.recording is not None and self._owner != self.recording:
            raise ForeignChunkError(f"it belongs to {f'recording {self._owner}' if self._owner else 'no recording'}")

    def add(self, record: Schema | ChannelRecord) -> None:
        """Take a schema or a channel, whose schema came before it; of one that is replaced no bytes are given back.

        Raises:
            TooMuchDefinedError: It is one too many.
            ForeignChunkError: It says that its chunk belongs to another recording.
        """
        if isinstance(record, ChannelRecord) and RECORDING_KEY in record.metadata:
            self._owner = record.metadata[RECORDING_KEY]
            self.check_owner()
        if isinstance(record, Schema):
            if record != self.schemas.get(record.id):
                self._put(record, self.schemas, record)
            return
        schema = self.schemas.get(record.schema_id)
        found = Channel(
            topic=record.topic,
            encoding=record.message_encoding,
            schema="" if schema is None else schema.name,
            schema_encoding="" if schema is None else schema.encoding,
            schema_data=b"" if schema is None else schema.data,
            metadata=tuple(sorted(record.metadata.items())),
        )
        if found != self.by_id.get(record.id) or record != self.records.get(record.id):
            self._put(record, self.by_id, found)
            self._replace(self.records, record.id, record)

    def copy(self) -> "Channels":
        """Equal channels, to be added to."""
        return Channels(dict(self.by_id), dict(self.records), dict(self.schemas), self.recording, None, self._bytes)

    def undo_chunk(self) -> None:
        """Take back what was added since the last chunk began."""
        for known, identity, before in reversed(self._changes):
            if before is None:
                del known[identity]
            else:
                known[identity] = before
        self._bytes = self._bytes_before
        self._changes.clear()

    def _put(self, record: Schema | ChannelRecord, known: dict[int, _Value], value: _Value) -> None:
        self._bytes += _size_of(record)
        if self._bytes > MOST_DEFINED_BYTES:
            raise TooMuchDefinedError(f"schemas and channels of more than {MOST_DEFINED_BYTES >> 20} MB in the file")
        self._replace(known, record.id, value)

    def _replace(self, known: dict[int, _Value], identity: int, value: _Value) -> None:
        self._changes.append((known, identity, known.get(identity)))
        known[identity] = value


def _size_of(record: Schema | ChannelRecord) -> int:
    if isinstance(record, Schema):
        return len(record.name) + len(record.encoding) + len(record.data)
    return sum(map(len, (record.topic, record.message_encoding, *record.metadata, *record.metadata.values())))


def definition(opcode: int, content: bytes) -> Schema | ChannelRecord:
    """A schema or a channel from its record.

    Raises:
        ValueError: It is damaged; others as the library has them.
    """
    stream = ReadDataStream(BytesIO(content))
    found: Schema | ChannelRecord = (Schema if opcode == Opcode.SCHEMA else ChannelRecord).read(stream)
    if isinstance(found, ChannelRecord) and "\0" in found.topic:
        raise ValueError("a topic with zeros")
    return found
