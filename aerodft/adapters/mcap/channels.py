"""The channels of a recording: what each is called, how it is encoded, and the schema that it carries."""

from dataclasses import dataclass

from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from aerodft.adapters.codec.schemas import schema_text
from aerodft.model.telemetry import WireProtocol

SENDER_KEY = "sender"
STATION_KEY = "station"


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One MCAP channel.

    Attributes:
        topic: Its name; for what is also on the bus, the same key expression.
        encoding: ``json``, ``protobuf``, ``mavlink`` or ``dataflash``.
        schema_name: Empty where there is no schema.
        schema_encoding: ``jsonschema`` or ``protobuf``.
        schema: The schema itself.
        metadata: Key and value pairs.
    """

    topic: str
    encoding: str
    schema_name: str = ""
    schema_encoding: str = ""
    schema: bytes = b""
    metadata: tuple[tuple[str, str], ...] = ()


def raw_channel(protocol: WireProtocol, sender: str) -> Channel:
    """Raw telemetry frames of one sender, each a message as it came."""
    return Channel(topic=protocol.value, encoding=protocol.value, metadata=((SENDER_KEY, sender),))


def json_channel(topic: str, schema: str) -> Channel:
    """Payloads of one of the published JSON Schemas."""
    return Channel(
        topic=topic,
        encoding="json",
        schema_name=schema,
        schema_encoding="jsonschema",
        schema=schema_text(schema),
    )


def protobuf_channel(topic: str, message: type[Message]) -> Channel:
    """Messages of one protobuf type."""
    return Channel(
        topic=topic,
        encoding="protobuf",
        schema_name=message.DESCRIPTOR.full_name,
        schema_encoding="protobuf",
        schema=build_file_descriptor_set(message).SerializeToString(),
    )
