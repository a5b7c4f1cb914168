"""MAVLink frames out of whatever another tool wrapped them in."""

import base64
import binascii
import math
import struct
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega

from aerodft.adapters.recording import Channel
from aerodft.adapters.telemetry.mavlink import (
    MESSAGES,
    SIGNATURE,
    SIGNED,
    V1,
    V2,
    FrameCounts,
    FrameSpans,
    MessageClass,
    StreamFramer,
)
from aerodft.adapters.wire.payload import JsonValue, load_bounded_json
from aerodft.model import IntArray
from replay.foreign.messages import JSON, ROS1, RosFields, type_of

_BY_NAME: Final = {str(message.msgname): message for message in MESSAGES.values()}
_FLOATS: Final = ("float", "double")


class JsonPacker:
    """Packs messages that are JSON objects (as mavlink2rest and mavlink-server write them) into frames; counts them.

    Attributes:
        packed: Messages so far.
    """

    def __init__(self) -> None:
        self.packed = 0
        self._link = ardupilotmega.MAVLink(None)

    def pack(self, item: dict[str, Any]) -> bytes:
        """The frame of ``{"header": {...}, "message": {"type": "ATTITUDE", ...}}``.

        Raises:
            ValueError, KeyError, TypeError: It is no such object, or of a message or value that nobody knows.
        """
        header, fields = item.get("header") or {}, dict(item["message"])
        kind = _BY_NAME[fields.pop("type")]
        if "mavtype" in fields:  # a word of their language; the field is called ``type``
            fields["type"] = fields.pop("mavtype")
        values = [
            _value(fields.get(name, 0 if not count else []), wire_type, count)
            for name, wire_type, count in zip(kind.fieldnames, kind.fieldtypes, _counts(kind), strict=True)
        ]
        self._link.srcSystem = int(header.get("system_id", 1))
        self._link.srcComponent = int(header.get("component_id", 1))
        self._link.seq = int(header.get("sequence", self.packed)) & 0xFF
        frame = bytes(kind(*values).pack(self._link))
        self.packed += 1
        return frame


def _counts(kind: MessageClass) -> list[int]:
    """Array lengths (0: no array) in the order of ``fieldnames``."""
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    return [lengths[name] for name in kind.fieldnames]


def _value(value: JsonValue, wire_type: str, count: int) -> JsonValue:
    if wire_type == "char":
        text = "".join(map(str, value)) if isinstance(value, list) else str(value or "")
        return text.encode()[: max(count, 1)]
    if count:
        values = list(value or [])[:count]
        return [_number(each, wire_type) for each in values] + [0] * (count - len(values))
    return _number(value, wire_type)


def _number(value: JsonValue, wire_type: str) -> int | float:
    if isinstance(value, dict):
        value = value["type"] if "type" in value else value["bits"]
    if value is None:
        return math.nan if wire_type in _FLOATS else 0
    if isinstance(value, str):
        return sum(_constant(name.strip()) for name in value.split("|") if name.strip())
    return float(value) if wire_type in _FLOATS else int(value)


def _constant(name: str) -> int:
    value = getattr(ardupilotmega, name, None)
    if not isinstance(value, int):
        raise ValueError(f"no constant {name}")  # noqa: TRY004 - of the text, not of its type
    return value


_V1_HEAD: Final = struct.Struct("<BBBBBB")
_V2_HEAD: Final = struct.Struct("<BBBBBBB")
_GOOD: Final = 1  # mavros: the frame's checksum was right
_DEPTH: Final = 3
_BYTE: Final = 255
_PIECE_BYTES: Final = 1 << 18
_MOST_BYTES: Final = 4 << 20  # of a message: a link's are of kilobytes


class FrameReader:
    """The frames of one channel, in order; only those whose checksum is right.

    Raw bytes, also in a wrapping that holds them in one piece (protobuf, CDR, ...), are looked through for frames; a
    frame may be spread over messages. JSON holds them as base64, or each message as an object with its fields; the
    message type of mavros has their parts.
    """

    def __init__(self, channel: Channel) -> None:
        self._framer = StreamFramer()
        self._is_mavros = type_of(channel.schema) == ("mavros_msgs", "Mavlink")
        self._is_ros1 = channel.encoding == ROS1
        self._is_json = channel.encoding == JSON
        self._packer = JsonPacker()
        self.unreadable = 0

    @property
    def counts(self) -> FrameCounts:
        """Counts of the frames so far."""
        return self._framer.counts

    @property
    def is_packed(self) -> bool:
        """Whether frames had to be made from fields: they are not the bytes that were sent."""
        return self._packer.packed > 0

    def frames(self, data: bytes) -> list[bytes]:
        """The frames that are complete with this message."""
        unwrapped = self.unwrapped(data)
        return self._framer.push(unwrapped) if unwrapped else []

    def cuts(self, messages: Sequence[bytes]) -> Iterator[tuple[FrameSpans, IntArray]]:
        """The frames that are complete with these messages; and of each the message with which it is, ``(n,)``.

        In pieces: for each byte that could begin a frame a place is held.
        """
        unwrapped = [self.unwrapped(data) for data in messages]
        ends = np.cumsum(np.fromiter(map(len, unwrapped), dtype=np.int64, count=len(unwrapped)))
        joined = b"".join(unwrapped)
        for first in range(0, len(joined), _PIECE_BYTES):
            cut = self._framer.spans(joined[first : first + _PIECE_BYTES])
            yield cut, np.searchsorted(ends, first + cut.offset + cut.length - cut.known)

    def unwrapped(self, data: bytes) -> bytes:
        """A link's bytes in a message; nothing where it cannot be read."""
        if len(data) > _MOST_BYTES:
            self.unreadable += 1
            return b""
        try:
            if self._is_mavros:
                return _of_mavros(RosFields(data, is_ros1=self._is_ros1))
            if self._is_json:
                return self._of_json(data)
        except (ValueError, struct.error, KeyError, TypeError):
            self.unreadable += 1
            return b""
        return data

    def _of_json(self, data: bytes) -> bytes:
        item = load_bounded_json(data)
        if isinstance(item, dict) and isinstance(item.get("message"), dict):
            return self._packer.pack(item)
        return b"".join(_bytes_in(item, _DEPTH))


def _bytes_in(item: JsonValue, depth: int) -> Iterator[bytes]:
    """Bytes in base64 texts and lists of numbers anywhere in a JSON value."""
    if isinstance(item, str):
        try:
            yield base64.b64decode(item, validate=True)
        except binascii.Error:
            return
    elif isinstance(item, list) and item and all(isinstance(each, int) and 0 <= each <= _BYTE for each in item):
        yield bytes(item)
    elif isinstance(item, dict | list) and depth:
        for each in item.values() if isinstance(item, dict) else item:
            yield from _bytes_in(each, depth - 1)


def _of_mavros(fields: RosFields) -> bytes:
    """A frame from the parts of ``mavros_msgs/Mavlink``.

    Raises:
        ValueError: It is none, or its sender's check failed.
    """
    fields.header_ns()
    if fields.integer("B") != _GOOD:
        raise ValueError("not valid when it was received")
    magic, length, incompatible, compatible, sequence, system, component = (fields.integer("B") for _ in range(7))
    message_id, checksum = fields.integer(), fields.integer("H")
    payload = fields.raw(8)[:length]
    signature = fields.raw()
    if magic == V1:
        head = _V1_HEAD.pack(V1, length, sequence, system, component, message_id & 0xFF)
        return head + payload + checksum.to_bytes(2, "little")
    if magic != V2:
        raise ValueError("no MAVLink frame")
    head = _V2_HEAD.pack(V2, length, incompatible, compatible, sequence, system, component)
    tail = signature[:SIGNATURE] if incompatible & SIGNED else b""
    return head + message_id.to_bytes(3, "little") + payload + checksum.to_bytes(2, "little") + tail
