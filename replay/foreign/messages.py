"""What a channel of another tool's recording holds, and its images and cameras: Foxglove's, ROS's, or plain files."""

import base64
import binascii
import logging
import math
import re
import struct
from collections.abc import Iterator, Sequence
from datetime import timedelta
from enum import StrEnum
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
import orjson
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from google.protobuf.message import DecodeError
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
from aerodft.adapters.timestamps import OLDEST_NS, iso_to_unix_ns
from aerodft.adapters.wire.payload import LATEST_NS, MOST_PICTURE_BYTES, JsonValue, load_bounded_json
from aerodft.conventions import SECOND_NS
from aerodft.geometry import LENS_MODELS
from aerodft.model import Camera, IntArray
from replay.foreign.ros import read_ros_fields, stamp_ns_of, text_of

JSON, PROTOBUF, CDR, ROS1 = "json", "protobuf", "cdr", "ros1"
_READABLE: Final = frozenset({JSON, PROTOBUF, CDR, ROS1})


class ChannelKind(StrEnum):
    """Kinds of channels, by their messages."""

    MAVLINK = "MAVLink"
    IMAGES = "images"
    VIDEO = "video"
    CAMERA = "camera"
    LOCATION = "location"


_MAVROS: Final = ("mavros_msgs", "Mavlink")
_BY_TYPE: Final = {
    ("foxglove", "CompressedImage"): ChannelKind.IMAGES,
    ("sensor_msgs", "CompressedImage"): ChannelKind.IMAGES,
    ("foxglove", "CompressedVideo"): ChannelKind.VIDEO,
    ("foxglove", "CameraCalibration"): ChannelKind.CAMERA,
    ("sensor_msgs", "CameraInfo"): ChannelKind.CAMERA,
    ("foxglove", "LocationFix"): ChannelKind.LOCATION,
    ("sensor_msgs", "NavSatFix"): ChannelKind.LOCATION,
    _MAVROS: ChannelKind.MAVLINK,
}
_FOXGLOVE: Final = {"foxglove", "foxglove_msgs", "ros_foxglove_msgs"}
_MAVLINK_ENCODINGS: Final = re.compile(r"(application/|x-)?mavlink([_ .-]?(v?[12](\.0)?|raw))?", re.IGNORECASE)
# What mavlink-server and the recorders beside it call a link's messages: raw frames, or each as a JSON object.
_MAVLINK_TOPICS: Final = re.compile(r"/?(.*/)?mavlink(_raw|/raw)?(/(in|out|from|to|raw))?", re.IGNORECASE)


def type_of(schema: str) -> tuple[str, str]:
    """Package and name of a message type, in whatever notation: ``foxglove_msgs/msg/X`` is ``foxglove.X``."""
    *before, name = [part for part in re.split(r"[./:]+", schema) if part and part != "msg"] or [""]
    package = before[0] if before else ""
    return ("foxglove" if package in _FOXGLOVE else package), name


def kind_of(channel: Channel) -> ChannelKind | None:
    """Kind of a channel; None where nothing tells, or in an encoding that is not read."""
    if _MAVLINK_ENCODINGS.fullmatch(channel.encoding) or _MAVLINK_ENCODINGS.fullmatch(channel.schema):
        return ChannelKind.MAVLINK
    kind = _BY_TYPE.get(type_of(channel.schema))
    if kind is not None:
        return kind if channel.encoding in _READABLE else None
    # A topic per message repeats what mavlink/out has: mavlink/1/1/ATTITUDE and its like are not telemetry.
    return ChannelKind.MAVLINK if _MAVLINK_TOPICS.fullmatch(channel.topic) else None


SECONDS: Final = ("sec", "secs", "seconds")
NANOSECONDS: Final = ("nsec", "nsecs", "nanosec", "nanos")
"""What the parts of a stamp are called in JSON."""

_MOST_LETTERS: Final = 100  # of a format's name
_MOST_BESIDE: Final = 1 << 20  # bytes of a message that are not its image
_STILL_MAGICS: Final = (b"\xff\xd8\xff", b"\x89PNG")

_log = logging.getLogger(__name__)


class EncodedImage(NamedTuple):
    """An image, or one packet of a video.

    Attributes:
        stamp_ns: By the recording machine's clock; None where the message does not say.
        data: The compressed bytes.
        format: ``jpeg``, ``png``, ``h264``, ... as the message says it.
    """

    stamp_ns: int | None
    data: bytes
    format: str


def read_encoded_image(channel: Channel, data: bytes) -> EncodedImage:
    """The image or video packet of one message.

    Raises:
        ValueError: There is none in it.
    """
    if kind_of(channel) not in {ChannelKind.IMAGES, ChannelKind.VIDEO}:
        if not data.startswith(_STILL_MAGICS):
            raise ValueError("neither a known schema nor a JPEG or PNG")
        return _encoded_image(None, data, "jpeg" if data.startswith(_STILL_MAGICS[0]) else "png")
    if channel.encoding == PROTOBUF:
        return _of_protobuf(channel, data)
    if channel.encoding == JSON:
        return _of_json(data)
    if channel.encoding not in {CDR, ROS1}:
        raise ValueError(f"encoding {channel.encoding!r} is not read")
    fields = read_ros_fields(type_of(channel.schema), data, is_ros1=channel.encoding == ROS1)
    return _encoded_image(stamp_ns_of(fields), fields.data.tobytes(), text_of(fields.format))


def _of_protobuf(channel: Channel, data: bytes) -> EncodedImage:
    parser = CompressedVideo if kind_of(channel) is ChannelKind.VIDEO else CompressedImage
    try:
        message = parser.FromString(data)
    except DecodeError as error:
        raise ValueError(str(error)) from error
    stamp_ns, encoded = message.timestamp.seconds * SECOND_NS + message.timestamp.nanos, message.data
    if len(data) - len(encoded) > _MOST_BESIDE:
        raise ValueError("more than an image in the message")
    return _encoded_image(stamp_ns, encoded, message.format)


def _of_json(data: bytes) -> EncodedImage:
    try:
        item = load_bounded_json(data, MOST_PICTURE_BYTES)
        header = item.get("header") or {}
        stamp = item.get("timestamp") or header.get("stamp")
        return _encoded_image(
            json_stamp_ns(stamp), base64.b64decode(item["data"], validate=True), item.get("format", "")
        )
    except (orjson.JSONDecodeError, binascii.Error, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def json_stamp_ns(stamp: JsonValue) -> int | None:
    """Seconds and nanoseconds in their usual names, or ISO 8601; None where it is neither.

    Raises:
        TypeError: They are no numbers.
    """
    if isinstance(stamp, str):
        try:
            return iso_to_unix_ns(stamp)
        except ValueError:
            return _without_zone_ns(stamp)
    if not isinstance(stamp, dict):
        return None
    whole = next((stamp[key] for key in SECONDS if key in stamp), None)
    rest = next((stamp[key] for key in NANOSECONDS if key in stamp), 0)
    return None if whole is None else int(whole) * SECOND_NS + int(rest)


def _without_zone_ns(text: str) -> int | None:
    """ISO 8601 without an offset, taken as UTC, which is said; None where it is no such time."""
    try:
        stamp_ns = iso_to_unix_ns(text, default_offset=timedelta())
    except ValueError:
        return None
    _say_utc_assumed()
    return stamp_ns


@cache
def _say_utc_assumed() -> None:
    """Say it once, not for each image."""
    _log.warning("stamps of images state no offset from UTC: UTC assumed")


def _encoded_image(stamp_ns: int | None, data: bytes, name: str) -> EncodedImage:
    if len(name) > _MOST_LETTERS:
        raise ValueError(f"a format whose name has {len(name)} letters")
    return EncodedImage(
        stamp_ns if stamp_ns is not None and OLDEST_NS <= stamp_ns <= LATEST_NS else None, data, name.lower()
    )


_MOST = 100  # numbers that are looked at: megabytes of them are four times as much as a tuple


def read_camera(channel: Channel, data: bytes) -> Camera:
    """The camera of one message; what it does not say (how well all this is known) is 0.

    Raises:
        ValueError: There is none in it, or one with another model of the lens.
    """
    try:
        values = _values(channel, data)
        width_px, height_px, model, distortion, matrix = values
        return _camera(channel.topic, int(width_px), int(height_px), str(model), tuple(distortion), tuple(matrix))
    except (DecodeError, orjson.JSONDecodeError, KeyError, TypeError, IndexError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def _values(channel: Channel, data: bytes) -> tuple[Any, ...]:
    """Width, height, model, distortion, matrix."""
    if channel.encoding == PROTOBUF:
        message = CameraCalibration.FromString(data)
        return message.width, message.height, message.distortion_model, message.D[:_MOST], message.K[:_MOST]
    if channel.encoding == JSON:
        item = load_bounded_json(data)
        matrix = item.get("K") or item.get("k") or []
        return item["width"], item["height"], item.get("distortion_model", ""), item.get("D") or item.get("d"), matrix
    fields = read_ros_fields(type_of(channel.schema), data, is_ros1=channel.encoding == ROS1)
    return fields.width, fields.height, text_of(fields.distortion_model), fields.d.tolist(), fields.k.tolist()


def _camera(
    name: str, width_px: int, height_px: int, model: str, distortion: tuple[float, ...], matrix: tuple[float, ...]
) -> Camera:
    fx_px, _, cx_px, _, fy_px, cy_px, *_ = matrix
    lenses = {name: (lens.model, count) for lens in LENS_MODELS.values() for name, count in lens.wire_names}
    if model not in lenses:
        raise ValueError(f"lens model {model!r}")
    lens, count = lenses[model]
    coefficients = distortion[:count]
    if not any(coefficients):
        coefficients = ()
    return Camera(
        name=name,
        width_px=width_px,
        height_px=height_px,
        fx_px=fx_px,
        fy_px=fy_px,
        cx_px=cx_px,
        cy_px=cy_px,
        lens=lens,
        distortion=coefficients,
    )


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
_FIRST_IMPOSSIBLE_ID: Final = 1 << 24  # MAVLink 2 has three bytes for them
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
        self._is_mavros = type_of(channel.schema) == _MAVROS
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
                return _of_mavros(read_ros_fields(_MAVROS, data, is_ros1=self._is_ros1))
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


def _of_mavros(fields: Any) -> bytes:  # noqa: ANN401 - the fields of a ROS message
    """Join a frame from the parts of ``mavros_msgs/Mavlink``.

    Raises:
        ValueError: It is none, or its sender's check failed.
    """
    if fields.framing_status != _GOOD:
        raise ValueError("not valid when it was received")
    addresses = fields.seq, fields.sysid, fields.compid
    payload, checksum = fields.payload64.tobytes()[: fields.len], fields.checksum.to_bytes(2, "little")
    if fields.magic == V1:
        head = _V1_HEAD.pack(V1, fields.len, *addresses, fields.msgid & 0xFF)
        return b"".join((head, payload, checksum))
    if fields.magic != V2 or fields.msgid >= _FIRST_IMPOSSIBLE_ID:
        raise ValueError("no MAVLink frame")
    head = _V2_HEAD.pack(V2, fields.len, fields.incompat_flags, fields.compat_flags, *addresses)
    signature = fields.signature.tobytes()[:SIGNATURE] if fields.incompat_flags & SIGNED else b""
    return b"".join((head, fields.msgid.to_bytes(3, "little"), payload, checksum, signature))
