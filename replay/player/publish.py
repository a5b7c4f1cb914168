"""Recordings on the bus again: original payloads on original keys; stamps as they were, or all moved alike.

Where stamps are moved by one amount, everything else in a payload stays as it was, byte by byte. MAVLink may go out on
a link again too, for a ground station: the frames as they were, not one byte changed.
"""

import logging
import re
import struct
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache
from typing import Final, cast

import orjson
import zenoh
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError, Message

from aerodft.adapters.images import FramePixels, PacketDecoder, encode_jpeg
from aerodft.adapters.recording import Channel, ChannelMessage
from aerodft.adapters.telemetry.mavlink import V1, V2, Transport
from aerodft.adapters.wire.events import IMAGE_SCHEMA, encode_image
from aerodft.adapters.wire.keys import Keys, key_part
from aerodft.adapters.wire.measurement import MEASUREMENT_SCHEMA, MEASUREMENTS_SCHEMA, split_measurements
from aerodft.adapters.wire.payload import JsonValue, load_bounded_json, load_payload
from aerodft.adapters.wire.pose import HEIGHT_SWITCH_SCHEMA, POSE_SCHEMA
from aerodft.adapters.wire.status import CALIBRATION_SCHEMA, CAMERA_MOTION_SCHEMA, STATUS_SCHEMA
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, NoAnswerError
from aerodft.model import Image, StampClock
from replay.foreign import (
    CDR,
    JSON,
    NANOSECONDS,
    PROTOBUF,
    ROS1,
    SECONDS,
    AnyRecording,
    ChannelKind,
    ForeignRecording,
    FrameReader,
    kind_of,
    read_encoded_image,
)
from replay.player.player import TimelineMessage
from replay.recordings import ENCODED_IMAGE_SCHEMAS, JPEG_SCHEMA, VIDEO_SCHEMA, Recording, channels_of, jpeg_of

Shift = Callable[[bytes, int], bytes]
_STAMP: Final = re.compile(rb'("(?:stamp|arrival|since|moved|compared)_ns"\s*:\s*")(\d{1,20})(")')
_INSTANT: Final = re.compile(rb"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(\.\d{1,9})?Z")
_TIMESTAMP: Final = "google.protobuf.Timestamp"
_FIRST_FIELD: Final = re.compile(rb"^\s*([A-Za-z_/0-9]+)\s+\w+", re.MULTILINE)
_COMMENT: Final = re.compile(rb"#.*$", re.MULTILINE)
_HEADERS: Final = (b"Header", b"std_msgs/Header", b"std_msgs/msg/Header")
_TIMES: Final = (b"time", b"builtin_interfaces/Time", b"builtin_interfaces/msg/Time")
_STAMP_BYTES: Final = 8
_keys_of = lru_cache(maxsize=64)(Keys)


def shift_stamps(payload: bytes, shift_ns: int) -> bytes:
    """One of aerodft's own JSON payloads, with every stamp, also those in sentences, ``shift_ns`` later."""
    if not shift_ns:
        return payload
    moved = _STAMP.sub(lambda found: b"%s%d%s" % (found[1], int(found[2]) + shift_ns, found[3]), payload)
    if b"Z" not in moved:  # two thirds of the time would go into the search for years among digits
        return moved
    return _INSTANT.sub(lambda found: _instant(found[1], found[2] or b"", shift_ns), moved)


def _instant(whole: bytes, fraction: bytes, shift_ns: int) -> bytes:
    rest_ns = int(fraction[1:].ljust(9, b"0") or 0) + shift_ns
    try:
        moment = datetime.fromisoformat(whole.decode()) + timedelta(seconds=rest_ns // SECOND_NS)
    except (ValueError, OverflowError):
        return whole + fraction + b"Z"
    digits = b".%09d" % (rest_ns % SECOND_NS)
    return moment.isoformat(timespec="seconds").encode() + digits[: len(fraction)] + b"Z"


def shift_of(channel: Channel) -> Shift | None:
    """Shift of the stamps in another tool's messages; None where nobody knows where they are."""
    if channel.encoding == PROTOBUF:
        return _protobuf_shift(channel)
    if channel.encoding == JSON:
        return _shift_json
    if channel.encoding in {CDR, ROS1}:
        return _ros_shift(channel)
    return None


def _protobuf_shift(channel: Channel) -> Shift | None:
    pool = descriptor_pool.DescriptorPool()
    try:
        for file in descriptor_pb2.FileDescriptorSet.FromString(channel.schema_data).file:
            pool.Add(file)
        kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel.schema))
    except (DecodeError, KeyError, TypeError, ValueError):
        return None

    def shift(data: bytes, shift_ns: int) -> bytes:
        try:
            message = kind.FromString(data)
            _shift_message(message, shift_ns)
        except (DecodeError, ValueError):  # the latter: a stamp that cannot be moved so far
            return data
        return bytes(message.SerializeToString())

    return shift


def _shift_message(message: Message, shift_ns: int) -> None:
    for descriptor, value in message.ListFields():
        if descriptor.message_type is None or descriptor.message_type.GetOptions().map_entry:
            continue
        for each in value if hasattr(value, "add") else [value]:
            if each.DESCRIPTOR.full_name == _TIMESTAMP:
                each.seconds, each.nanos = divmod(each.seconds * SECOND_NS + each.nanos + shift_ns, SECOND_NS)
            else:
                _shift_message(each, shift_ns)


def _shift_json(data: bytes, shift_ns: int) -> bytes:
    try:
        return shift_stamps(orjson.dumps(_shifted_json(load_bounded_json(data), shift_ns)), shift_ns)
    except (ValueError, TypeError, RecursionError):  # no JSON, or values beyond what it can hold once they are moved
        return data


def _shifted_json(item: JsonValue, shift_ns: int) -> JsonValue:
    if isinstance(item, list):
        return [_shifted_json(each, shift_ns) for each in item]
    if not isinstance(item, dict):
        return item
    whole = next((key for key in SECONDS if isinstance(item.get(key), int)), None)
    rest = next((key for key in NANOSECONDS if isinstance(item.get(key), int)), None)
    if whole is None or rest is None:
        return {key: _shifted_json(each, shift_ns) for key, each in item.items()}
    seconds, rest_ns = divmod(item[whole] * SECOND_NS + item[rest] + shift_ns, SECOND_NS)
    return item | {whole: seconds, rest: rest_ns}


def _ros_shift(channel: Channel) -> Shift | None:
    """The stamp of a ROS message that begins with a header or a time; None of others."""
    found = _FIRST_FIELD.search(_COMMENT.sub(b"", channel.schema_data))
    is_header = found is not None and found[1] in _HEADERS
    if found is None or not (is_header or found[1] in _TIMES):
        return None
    start = (4 if is_header else 0) if channel.encoding == ROS1 else 4

    def shift(data: bytes, shift_ns: int) -> bytes:
        order = ">" if channel.encoding == CDR and len(data) > 1 and data[1] % 2 == 0 else "<"
        stamp = struct.Struct(f"{order}II")
        if len(data) < start + _STAMP_BYTES:
            return data
        whole, rest = stamp.unpack_from(data, start)
        moved = divmod(whole * SECOND_NS + rest + shift_ns, SECOND_NS)
        if not 0 <= moved[0] < 1 << 32:
            return data
        return data[:start] + stamp.pack(*moved) + data[start + _STAMP_BYTES :]

    return shift


_PUBLISHED: Final = frozenset(
    {
        MEASUREMENT_SCHEMA,
        MEASUREMENTS_SCHEMA,
        POSE_SCHEMA,
        STATUS_SCHEMA,
        HEIGHT_SWITCH_SCHEMA,
        CALIBRATION_SCHEMA,
        CAMERA_MOTION_SCHEMA,
    }
)
_POLL_S: Final = 0.02
_MOST_NAMED: Final = 10  # topics
_STAMPED: Final = (_PUBLISHED | {IMAGE_SCHEMA}) - {MEASUREMENTS_SCHEMA}
_ENCODINGS: Final = {
    JSON: zenoh.Encoding.APPLICATION_JSON,
    PROTOBUF: zenoh.Encoding.APPLICATION_PROTOBUF,
    CDR: zenoh.Encoding.APPLICATION_CDR,
}

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class Published:
    """Counts of messages that went out, and of damaged ones that did not."""

    measurements: int = 0
    others: int = 0
    images: int = 0
    damaged: int = 0


def is_published(recording: AnyRecording, channel: Channel) -> bool:
    """Whether a channel is published: of aerodft's own what was made of the input, and of the input the images.

    A station that is live would take other inputs for its own.
    """
    return (
        not isinstance(recording, Recording) or channel.schema in _PUBLISHED or channel.schema in ENCODED_IMAGE_SCHEMAS
    )


class Republisher:
    """Publishes; an outlet of the player. A slow subscriber slows it down, nothing is dropped.

    Attributes:
        published: What went out so far.

    Args:
        session: Where to.
        on_measurement: Called with the recording, the probe and the payload of each measurement before it goes out.
    """

    def __init__(
        self,
        session: zenoh.Session,
        on_measurement: Callable[[AnyRecording, str, bytes], None] = lambda _recording, _probe, _payload: None,
    ) -> None:
        self.published = Published()
        self._on_measurement = on_measurement
        self._session = session
        self._publishers = PublisherPool(session)
        self._image_stamps: dict[int, tuple[int, bytes]] = {}
        self._shifts: dict[str, Shift | None] = {}
        self._videos: dict[int, VideoStills] = {}

    def wait_for_link(self, timeout_s: float) -> bool:
        """Wait until another peer or a router is connected; False after ``timeout_s``."""
        info = self._session.info
        return _wait_until(lambda: bool(info.peers_zid() or info.routers_zid()), timeout_s)

    def wait_for_subscriber(self, recordings: Iterable[AnyRecording], timeout_s: float) -> bool:
        """Wait until somebody subscribes to anything of a recording's station; False after ``timeout_s``."""
        publishers = [self._session.declare_publisher(f"{Keys(each.station).root}/**") for each in recordings]
        try:
            return _wait_until(lambda: any(map(is_matched, publishers)), timeout_s)
        finally:
            for publisher in publishers:
                publisher.undeclare()

    @property
    def has_listeners(self) -> bool:
        """Whether anybody has subscribed to something that was published."""
        return self._publishers.has_listeners

    def send(self, item: TimelineMessage, shift_ns: int) -> None:
        """Publish a message, if it is one to be published; a damaged one is left out and counted."""
        if isinstance(item.recording, ForeignRecording):
            self._send_foreign(item, item.recording, shift_ns)
            return
        try:
            self._send_own(item, shift_ns)
        except InputError as error:
            if not self.published.damaged:
                at = f"{item.message.channel.topic} at {item.log_ns} ns"
                _log.warning("%s: damaged payloads are left out: %s: %s", item.recording.name, at, error)
            self.published.damaged += 1

    def _send_own(self, item: TimelineMessage, shift_ns: int) -> None:
        message, keys = item.message, _keys_of(item.recording.station)
        schema, name = message.channel.schema, ""
        if schema in _STAMPED:  # refuses what is none
            name_key = "name" if schema == MEASUREMENT_SCHEMA else "schema"
            name, _ = load_payload(
                message.data, schema, lambda payload: (str(payload[name_key]), int(payload["stamp_ns"]))
            )
        if schema == IMAGE_SCHEMA:
            self._image_stamps[id(item.recording)] = (message.sequence, shift_stamps(message.data, shift_ns))
        elif schema == JPEG_SCHEMA:
            sequence, stamps = self._image_stamps.get(id(item.recording), (None, None))
            self._put_jpeg(keys.image, jpeg_of(message.data), stamps if sequence == message.sequence else None)
        elif schema == VIDEO_SCHEMA:
            still = self._videos.setdefault(id(item.recording), VideoStills()).still(message)
            sequence, stamps = self._image_stamps.get(id(item.recording), (None, None))
            if still is not None and sequence == message.sequence:
                self._put_jpeg(keys.image, still, stamps)
        elif schema == MEASUREMENTS_SCHEMA:
            for each, payload in split_measurements(message.data):
                self._put_measurement(item.recording, each, keys.measurement(each), shift_stamps(payload, shift_ns))
        elif schema == MEASUREMENT_SCHEMA:
            self._put_measurement(item.recording, name, message.channel.topic, shift_stamps(message.data, shift_ns))
        elif schema in _PUBLISHED:
            self._put_json(message.channel.topic, shift_stamps(message.data, shift_ns))
            self.published.others += 1

    def _put_measurement(self, recording: AnyRecording, name: str, key: str, payload: bytes) -> None:
        self._on_measurement(recording, name, payload)
        self._put_json(key, payload)
        self.published.measurements += 1

    def close(self) -> None:
        """Withdraw what was declared."""
        self._publishers.close()

    def _send_foreign(self, item: TimelineMessage, recording: ForeignRecording, shift_ns: int) -> None:
        """Send another tool's message on its own topic, and a JPEG as a station's image beside it."""
        channel, data = item.message.channel, item.message.data
        if shift_ns and channel.topic not in recording.framed:  # frames stay as they were
            shift = self._shift(channel)
            data = data if shift is None else shift(data, shift_ns)
        key = "/".join(key_part(part) for part in channel.topic.split("/") if part) or "%"
        self._publishers.put(key, data, _ENCODINGS.get(channel.encoding, zenoh.Encoding.ZENOH_BYTES))
        if item.is_step and kind_of(channel) is ChannelKind.IMAGES:
            self._put_foreign_image(item, data, shift_ns)
        else:
            self.published.others += 1

    def _put_foreign_image(self, item: TimelineMessage, data: bytes, shift_ns: int) -> None:
        try:
            picture = read_encoded_image(item.message.channel, data)
        except ValueError as error:
            if not self.published.damaged:
                _log.warning("%s: images that are none: %s", item.message.channel.topic, error)
            self.published.damaged += 1
            return
        stamp_ns = picture.stamp_ns or item.log_ns + shift_ns
        image = Image(
            index=item.message.sequence, stamp_ns=stamp_ns, arrival_ns=item.log_ns + shift_ns, clock=StampClock.HOST
        )
        if picture.data.startswith(b"\xff\xd8"):
            self._put_jpeg(Keys(item.recording.station).image, picture.data, encode_image(image))

    def _shift(self, channel: Channel) -> Shift | None:
        if channel.topic not in self._shifts:
            found = self._shifts[channel.topic] = shift_of(channel)
            unknown = sum(shift is None for shift in self._shifts.values())
            if found is None and unknown <= _MOST_NAMED:
                more = "; further ones are not named" if unknown == _MOST_NAMED else ""
                _log.warning("%s: nobody knows where its stamps are; published as recorded%s", channel.topic, more)
        return self._shifts[channel.topic]

    def _put_json(self, key: str, payload: bytes) -> None:
        self._publishers.put(key, payload, zenoh.Encoding.APPLICATION_JSON)

    def _put_jpeg(self, key: str, jpeg: bytes, stamps: bytes | None) -> None:
        self._publishers.put(key, jpeg, zenoh.Encoding.IMAGE_JPEG, stamps)
        self.published.images += 1


def _wait_until(is_so: Callable[[], bool], timeout_s: float) -> bool:
    end_s = time.monotonic() + timeout_s
    while not is_so():
        if time.monotonic() >= end_s:
            return False
        time.sleep(_POLL_S)
    return True


_MOST: Final = 1000  # declared; a file may claim any number of channels, and each costs 4 kB and a message to all peers
_CHECK_COUNT: Final = 64  # of them at a time, until somebody has subscribed


class PublisherPool:
    """Publishes on any number of keys; a slow subscriber slows it down, nothing is dropped.

    Args:
        session: Where to.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: dict[str, zenoh.Publisher] = {}
        self._publishers: list[zenoh.Publisher] = []
        self._any_key: zenoh.Publisher | None = None  # stands for the keys beyond those that are declared
        self._sent, self._next_check, self._has_heard = 0, 0, False

    @property
    def has_listeners(self) -> bool:
        """Whether anybody has subscribed to something that was published."""
        self._has_heard = self._has_heard or any(map(is_matched, self._publishers))
        return self._has_heard

    def put(self, key: str, payload: bytes, encoding: zenoh.Encoding, attachment: bytes | None = None) -> None:
        """Publish."""
        publisher = self._declared.get(key)
        if publisher is None and len(self._declared) < _MOST:
            publisher = self._declared[key] = self._declare(key, encoding)
        if publisher is not None:
            publisher.put(payload, attachment=attachment)
        else:
            self._any_key = self._any_key or self._declare("**", encoding)
            congestion = zenoh.CongestionControl.BLOCK
            self._session.put(key, payload, encoding=encoding, congestion_control=congestion, attachment=attachment)
        self._sent += 1
        if self._sent % _CHECK_COUNT == 0 and not self._has_heard:  # some of the keys, the next ones at the next check
            self._next_check %= len(self._publishers)
            some = self._publishers[self._next_check : self._next_check + _CHECK_COUNT]
            self._next_check += len(some)
            self._has_heard = any(map(is_matched, some))

    def close(self) -> None:
        """Withdraw what was declared."""
        for publisher in self._publishers:
            publisher.undeclare()
        self._declared.clear()
        self._publishers.clear()

    def _declare(self, key: str, encoding: zenoh.Encoding) -> zenoh.Publisher:
        publisher = self._session.declare_publisher(
            key, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK
        )
        self._publishers.append(publisher)
        return publisher


def is_matched(publisher: zenoh.Publisher) -> bool:
    """Whether somebody has subscribed to a publisher's key."""
    # zenoh's annotation says bool, what comes is a MatchingStatus, and that is always true.
    return cast("zenoh.MatchingStatus", publisher.matching_status).matching


_PERIOD_NS: Final = SECOND_NS // 2  # as a live station does
_QUALITY: Final = 75


class VideoStills:
    """Decodes one recording's packets in order; where their times go back it begins anew, as a loop does."""

    def __init__(self) -> None:
        self._decoder: PacketDecoder | None = None
        self._last_ns = self._next_ns = 0

    def still(self, message: ChannelMessage) -> bytes | None:
        """A packet's image as JPEG; None where none is due, or where it cannot be decoded."""
        if message.log_ns < self._last_ns:  # what was seen last is no reference for what comes now
            self._decoder, self._next_ns = None, 0
        self._last_ns = message.log_ns
        try:
            packet = CompressedVideo.FromString(message.data)
            self._decoder = self._decoder or PacketDecoder(packet.format)
        except (DecodeError, ValueError):
            return None
        frame = self._decoder.decode(packet.data)
        if frame is None or message.log_ns < self._next_ns:
            return None
        self._next_ns = message.log_ns + _PERIOD_NS
        at_ns = message.log_ns
        return encode_jpeg(Image(index=0, stamp_ns=at_ns, arrival_ns=at_ns, pixels=FramePixels(frame)), _QUALITY)


def check_mavlink(recordings: tuple[AnyRecording, ...]) -> None:
    """Refuse recordings of which none has MAVLink.

    Raises:
        NoAnswerError: None has.
    """
    for each in recordings:
        segments = each.data if isinstance(each, Recording) else each.segments
        if any(each.holds_mavlink(channel) for one in segments for channel in channels_of(one).values()):
            return
    raise NoAnswerError("no MAVLink to send", where=recordings[0].name, expected="a recording with raw MAVLink frames")


class MavlinkOut:
    """Sends frames; an outlet of the player.

    Attributes:
        frames: Sent so far.

    Args:
        transport: Where to.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._readers: dict[tuple[int, str], FrameReader] = {}
        self.frames = 0

    def send(self, item: TimelineMessage, shift_ns: int) -> None:  # noqa: ARG002 - frames are never changed
        """Send the frames of a message, where it has any."""
        if not item.recording.holds_mavlink(item.message.channel):
            return
        for frame in self._frames(item):
            self._transport.write(frame)
            self.frames += 1

    def _frames(self, item: TimelineMessage) -> list[bytes]:
        data, channel = item.message.data, item.message.channel
        if isinstance(item.recording, Recording) or data[:1] in {bytes([V1]), bytes([V2])}:
            return [data]
        key = (id(item.recording), channel.topic)
        reader = self._readers.get(key)
        if reader is None:
            reader = self._readers[key] = FrameReader(channel)
        return reader.frames(data)
