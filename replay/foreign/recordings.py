"""Recordings by their path: aerodft's own, and other tools' (any MCAP file with MAVLink in it, and images).

Which channels of another tool's are telemetry, images and camera is stated, else as they tell; telemetry and images
are sources of the pipeline.
"""

import heapq
import logging
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from PIL import Image as PillowImage

from aerodft.adapters.config.station import Topics
from aerodft.adapters.images import FramePixels, Losses, PacketDecoder, StillPixels
from aerodft.adapters.recording import Channel, ChannelMessage
from aerodft.adapters.recording.read import ChannelFilter, SegmentScan, content_bytes, scan_segment
from aerodft.adapters.telemetry.mavlink import FrameCounts, StreamFramer
from aerodft.adapters.wire.payload import LATEST_NS
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, NoAnswerError, Reason
from aerodft.model import Camera, Event, Image, RawBlock, StampClock, WireProtocol
from aerodft.service import ArrivalLimiter, first_arrival_ns
from replay.foreign.messages import (
    JSON,
    ChannelKind,
    EncodedImage,
    FrameReader,
    kind_of,
    read_camera,
    read_encoded_image,
)
from replay.recordings import (
    Recording,
    channels_of,
    is_mcap,
    is_within,
    messages_by_time,
    messages_of,
    segment_order,
)

_SHOWN: Final = 12
_TO_THE_VEHICLE: Final = ("in", "to", "sink")
_TRIED: Final = 200  # messages of a channel that are looked through for frames
_MOST_BYTES: Final = 1 << 16
_LOOKS: Final = (3, 12, 48)  # so many messages are looked at together
_MOST_LOOKED_THROUGH: Final = 500  # channels
_ENOUGH: Final = 3
_APART_NS: Final = SECOND_NS  # what recorders put off writing
_MOST_HELD_BYTES: Final = 96 << 20  # by streams of one topic each: a chunk is held by every one of them
_IMAGE_KINDS: Final = (ChannelKind.IMAGES, ChannelKind.VIDEO)
_OWN_SCHEMAS: Final = "aerodft."


def _image_topics(where: object, channels: Mapping[str, Channel], stated: Topics) -> tuple[str | None, str | None]:
    """The topics of the images and of their camera, each None where there is none.

    Args:
        where: The recording's name in messages.
        channels: By topic.
        stated: What is known beforehand.

    Raises:
        InputError: A stated topic is not there, or several could be the images.
    """
    listed = _channel_list(channels)
    for option, topics in (("mavlink", stated.mavlink), ("images", stated.images), ("camera", stated.camera)):
        for topic in topics:
            if topic not in channels:
                raise InputError(f"no topic {topic} ({option})", where=where, got=listed, expected="one of these")

    def one(option: str, found: Sequence[str]) -> str | None:
        if len(found) > 1:
            hint = f"say which: `topics` {option}={found[0]}"
            raise InputError(f"several topics of {option}", where=where, got=", ".join(found), hint=hint)
        return found[0] if found else None

    kinds = {topic: kind_of(channel) for topic, channel in channels.items()}
    images = [topic for topic, kind in kinds.items() if kind in _IMAGE_KINDS]
    cameras = [topic for topic, kind in kinds.items() if kind is ChannelKind.CAMERA]
    camera = stated.camera or (cameras if len(cameras) == 1 else ())
    return one("images", stated.images or images), one("camera", camera)


def _channel_list(channels: Mapping[str, Channel]) -> str:
    """The channels for a sentence: topic, schema and encoding of each."""
    shown = [
        f"{topic} ({', '.join(part for part in (channel.schema, channel.encoding) if part) or 'no schema'})"
        for topic, channel in sorted(channels.items())
    ]
    more = f" and {len(shown) - _SHOWN} more" if len(shown) > _SHOWN else ""
    return f"{', '.join(shown[:_SHOWN])}{more}" if shown else "no channel"


def _mavlink_topics(where: object, segments: Sequence[SegmentScan], channels: Mapping[str, Channel]) -> tuple[str, ...]:
    """The topics that hold MAVLink: by what they are called, else by what their messages hold."""
    kinds = {topic: kind_of(channel) for topic, channel in channels.items()}
    found = [topic for topic, kind in kinds.items() if kind is ChannelKind.MAVLINK]
    if found:
        return tuple(found)
    unknown = [topic for topic, kind in kinds.items() if kind is None]
    if len(unknown) > _MOST_LOOKED_THROUGH:
        warning = "%s: MAVLink is looked for in %d of %d topics; `topics` mavlink=... says which has it"
        _log.warning(warning, where, _MOST_LOOKED_THROUGH, len(unknown))
    return tuple(_with_frames(segments, unknown[:_MOST_LOOKED_THROUGH]))


def _telemetry_topics(where: object, channels: Mapping[str, Channel], framed: Sequence[str]) -> tuple[str, ...]:
    """Which of the topics with MAVLink has the vehicle's telemetry.

    Raises:
        InputError: Several could have it.
    """
    heard = [topic for topic in framed if topic.rsplit("/", 1)[-1].rsplit("_", 1)[-1] not in _TO_THE_VEHICLE]
    raw = [topic for topic in heard or framed if channels[topic].encoding != JSON]  # JSON repeats what is there raw
    found = raw or heard or framed
    if len(found) > 1:
        hint = f"say which: `topics` mavlink={found[0]}, once for each that is to be taken"
        raise InputError("several topics hold MAVLink", where=where, got=", ".join(found), hint=hint)
    return tuple(found)


def _with_frames(segments: Sequence[SegmentScan], topics: Sequence[str]) -> list[str]:
    """The topics whose first messages hold MAVLink frames, in order; reads no further than it must."""
    found, tried, open_topics = set[str](), Counter[str](), set(topics)
    readers: dict[str, FrameReader] = {}
    unwrapped: dict[str, bytes] = defaultdict(bytes)
    for message in messages_of(segments, wanted=lambda channel: channel.topic in open_topics):
        topic = message.channel.topic
        if topic not in open_topics:  # of the chunk in which it was closed
            continue
        if topic not in readers:
            readers[topic] = FrameReader(message.channel)
        unwrapped[topic] += readers[topic].unwrapped(message.data)[:_MOST_BYTES]
        tried[topic] += 1
        is_last = tried[topic] >= _TRIED or len(unwrapped[topic]) >= _MOST_BYTES
        if is_last or tried[topic] in _LOOKS:
            if _count_frames(unwrapped[topic]) >= _ENOUGH:
                found.add(topic)
            elif not is_last:
                continue
            open_topics.remove(topic)
            del unwrapped[topic]
            if not open_topics:
                break
    return [topic for topic in topics if topic in found or _count_frames(unwrapped.get(topic, b"")) >= _ENOUGH]


def _count_frames(data: bytes) -> int:
    framer = StreamFramer()
    return len(framer.push(data)) + len(framer.flush())


_log = logging.getLogger(__name__)


class ForeignRecording:
    """Another tool's recording, open for reading; holds no file open.

    Attributes:
        path: The file, or the folder of files.
        segments: Its files.
        channels: By topic.
        images: Topic of the images; None where there are none.
        start_ns: Earliest log time.
        end_ns: Latest log time.

    Args:
        path: An MCAP file, or a folder of them.
        topics: What is known of its topics beforehand.

    Raises:
        InputError: There is none, it cannot be read, or it is not clear which topic has the images.
        NoAnswerError: It holds no message.
    """

    def __init__(self, path: Path, topics: Topics | None = None) -> None:
        self.path = path
        self.segments = tuple(map(scan_segment, mcap_files(path)))
        chunks = [chunk for segment in self.segments for chunk in segment.chunks]
        if not chunks:
            raise NoAnswerError("the recording holds no message", where=path)
        if not all(segment.is_whole for segment in self.segments):
            _log.warning("%s: was not finished; read as far as it is whole", path)
        self.start_ns = min(chunk.start_ns for chunk in chunks)
        self.end_ns = max(chunk.end_ns for chunk in chunks)
        self.channels = {channel.topic: channel for each in self.segments for channel in channels_of(each).values()}
        self._stated = topics or Topics()
        self.images, self._camera = _image_topics(path, self.channels, self._stated)

    @property
    def name(self) -> str:
        """The recording's path, for messages."""
        return str(self.path)

    @property
    def station(self) -> str:
        """Name of the station on the bus: the file's."""
        return self.path.stem

    def is_step(self, channel: Channel) -> bool:
        """Whether a channel's messages begin a step of a replay: images do, where there are none any message."""
        return self.images is None or channel.topic == self.images

    def holds_mavlink(self, channel: Channel) -> bool:
        """Whether a channel has the vehicle's MAVLink frames."""
        return channel.topic in self.mavlink

    def by_time(self, from_ns: int | None, to_ns: int | None, wanted: ChannelFilter) -> Iterator[ChannelMessage]:
        """Messages of log times in ``[from_ns, to_ns)``, in order of time."""
        streams = (_by_time(each, from_ns, to_ns, wanted) for each in self.segments)
        return heapq.merge(*streams, key=lambda message: message.log_ns)

    @cached_property
    def zero_ns(self) -> int:
        """Zero of people's seconds: the log time of the first image, without images the earliest one."""
        first = None if self.images is None else next(self.messages(self.images), None)
        return self.start_ns if first is None else first.log_ns

    @cached_property
    def framed(self) -> tuple[str, ...]:
        """Topics with MAVLink; found when somebody asks, since messages may have to be looked through."""
        return self._stated.mavlink or _mavlink_topics(self.path, self.segments, self.channels)

    @cached_property
    def mavlink(self) -> tuple[str, ...]:
        """Topics of the vehicle's telemetry.

        Raises:
            InputError: It is not clear which they are.
        """
        return self._stated.mavlink or _telemetry_topics(self.path, self.channels, self.framed)

    def messages(
        self, topic: str | None = None, *, from_ns: int | None = None, to_ns: int | None = None
    ) -> Iterator[ChannelMessage]:
        """Messages as they were written, log times in ``[from_ns, to_ns)``; None for all topics."""

        def wanted(channel: Channel) -> bool:
            return topic is None or channel.topic == topic

        messages = messages_of(self.segments, from_ns=from_ns, to_ns=to_ns, wanted=wanted)
        return filter(lambda message: message.log_ns <= LATEST_NS, messages)  # beyond it is damage

    def refusal_without(self, what: str) -> InputError:
        """The refusal of a recording that lacks a channel of some kind."""
        return InputError(
            f"no {what} in the recording",
            where=self.path,
            got=_channel_list(self.channels),
            expected=f"a topic with {what}",
            hint="`topics` says which topic is what",
        )

    def camera(self) -> Camera | None:
        """The camera that was recorded with the images; None where there is none.

        Raises:
            InputError: It is damaged, or of a lens model that is not known.
        """
        if self._camera is None:
            return None
        message = next(self.messages(self._camera), None)
        if message is None:
            return None
        try:
            return read_camera(message.channel, message.data)
        except ValueError as error:
            raise InputError(
                "the camera cannot be read", where=f"{self.path}, {message.channel.topic}", got=error
            ) from error


def _by_time(
    segment: SegmentScan, from_ns: int | None, to_ns: int | None, is_wanted: ChannelFilter
) -> Iterator[ChannelMessage]:
    """One file's messages by log time, also where a converter wrote one topic after the other."""
    if all(one.end_ns <= other.start_ns + _APART_NS for one, other in pairwise(segment.chunks)):
        return messages_of([segment], from_ns=from_ns, to_ns=to_ns, wanted=is_wanted)
    topics = {channel.topic for channel in channels_of(segment).values() if is_wanted(channel)}
    if len(topics) * max(map(content_bytes, segment.chunks), default=0) > _MOST_HELD_BYTES:
        warning = (
            "%s: %d topics that lie one behind the other are more than can be held; in order of time as far as they are"
        )
        _log.warning(warning, segment.path, len(topics))
        return (each for each in messages_by_time(segment, is_wanted) if is_within(each, from_ns, to_ns))

    def stream(topic: str) -> Iterator[ChannelMessage]:
        return messages_of([segment], from_ns=from_ns, to_ns=to_ns, wanted=lambda channel: channel.topic == topic)

    streams = map(stream, sorted(topics))
    return heapq.merge(*streams, key=lambda message: message.log_ns)


def mcap_files(path: Path) -> list[Path]:
    """The MCAP files that a path means, in order.

    Raises:
        InputError: There is none.
    """
    if path.is_file():
        return [path]
    paths = sorted(path.glob("*.mcap"), key=segment_order) if path.is_dir() else []
    if not paths:
        if not path.is_dir():
            raise InputError("no such file or folder", where=path)
        expected = "an MCAP file, or a folder of them"
        raise InputError("there is no recording", where=path, got="a folder without any", expected=expected)
    return paths


def is_foreign(path: Path) -> bool:
    """Whether another tool's recording is there, rather than a folder that aerodft wrote.

    Raises:
        InputError: A file cannot be read.
    """
    if path.is_dir():
        return is_mcap(path) and next(path.glob("data_*.mcap"), None) is None
    return is_mcap(path) and not _is_own(path)


def open_recording(path: Path, topics: Topics | None = None) -> Recording | ForeignRecording:
    """Open whatever recording is there.

    Args:
        path: A recording's folder, an MCAP file, or a folder of MCAP files.
        topics: What is known of another tool's topics.

    Raises:
        InputError: There is none, or it cannot be read.
        NoAnswerError: It holds nothing.
    """
    return ForeignRecording(path, topics) if is_foreign(path) else Recording(path)


def _is_own(path: Path) -> bool:
    segment = scan_segment(path)
    segment.damaged_offsets.update(chunk.offset for chunk in segment.chunks)  # whoever reads on says what is damaged
    channels = channels_of(segment).values()
    return any(channel.schema.startswith(_OWN_SCHEMAS) for channel in channels)


AnyRecording: TypeAlias = Recording | ForeignRecording

_BATCH: Final = 4096
_BATCH_BYTES: Final = 1 << 18
_STILLS: Final = ("jpeg", "jpg", "png", "webp", "tiff")


class ForeignTelemetry:
    """The MAVLink of a recording as a ``Source``; its arrival is the log time, made not decreasing.

    Args:
        recording: The recording.

    Raises:
        InputError: It has none.
    """

    def __init__(self, recording: ForeignRecording) -> None:
        if not recording.mavlink:
            raise recording.refusal_without("MAVLink")
        self._topics = [_TopicFrames(recording, topic) for topic in recording.mavlink]

    @property
    def counts(self) -> FrameCounts:
        """Counts of all topics' frames so far."""
        return sum((topic.counts for topic in self._topics), FrameCounts())

    def events(self) -> Iterator[Event]:
        """All frames in order, in blocks of bounded size."""
        return heapq.merge(*(topic.blocks() for topic in self._topics), key=first_arrival_ns)

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each kind of damage met so far; complete once ``events`` has ended."""
        return tuple(sentence for topic in self._topics for sentence in topic.warnings())


class _TopicFrames:
    """The frames of one topic."""

    def __init__(self, recording: ForeignRecording, topic: str) -> None:
        self._recording = recording
        self._topic = topic
        self._reader = FrameReader(recording.channels[topic])
        self._backwards = 0

    @property
    def counts(self) -> FrameCounts:
        return self._reader.counts

    def blocks(self) -> Iterator[RawBlock]:
        self._reader, self._backwards = FrameReader(self._recording.channels[self._topic]), 0
        last_ns, pace = 0, ArrivalLimiter()
        batches = _batches(self._recording.messages(self._topic))
        while messages := next(batches, None):
            stamps_ns = np.array([message.log_ns for message in messages], dtype=np.int64)
            arrivals_ns = np.maximum(np.maximum.accumulate(stamps_ns), last_ns)
            self._backwards += int(np.count_nonzero(stamps_ns < np.concatenate([[last_ns], arrivals_ns[:-1]])))
            last_ns = int(arrivals_ns[-1])
            for cut, message in self._reader.cuts([message.data for message in messages]):
                if len(message):
                    yield RawBlock(
                        protocol=WireProtocol.MAVLINK,
                        sender=self._topic,
                        arrival_ns=pace.limited(arrivals_ns[message]),
                        offset=cut.offset,
                        length=cut.length,
                        data=cut.data,
                        checked=True,
                    )
            del messages  # not to be held while the next ones are read

    def warnings(self) -> Iterator[str]:
        where, counts = f"{self._recording.path}, {self._topic}", self.counts
        if counts.bad_crc:
            yield f"{where}: {counts.bad_crc} damaged frames left out"
        if self._reader.unreadable:
            yield f"{where}: {self._reader.unreadable} messages hold no frame that could be read"
        if self._reader.is_packed:
            yield f"{where}: frames were made again from JSON, which has no signatures"
        if self._backwards:
            yield (
                f"{where}: the recording machine's clock stepped back ({self._backwards} messages stamped"
                " earlier than one before them); their arrival was held"
            )


def _batches(messages: Iterable[ChannelMessage]) -> Iterator[list[ChannelMessage]]:
    """Messages, some thousands together: of no more bytes than are quickly gone through."""
    batch: list[ChannelMessage] = []
    size = 0
    for message in messages:
        batch.append(message)
        size += len(message.data)
        del message
        if len(batch) >= _BATCH or size >= _BATCH_BYTES:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


class ForeignImages:
    """The images of a recording as a ``Source``; stamped by the recording machine's clock.

    Args:
        recording: The recording, with images.
        decode: False for stamps and sizes only.

    Raises:
        InputError: It has none.
    """

    def __init__(self, recording: ForeignRecording, *, decode: bool = True) -> None:
        if recording.images is None:
            raise recording.refusal_without("images")
        self._recording = recording
        self._topic = recording.images
        self._decode = decode

    def events(self) -> Iterator[Image]:
        """All images whose stamp is sound; what was left out is logged as a warning at the end."""
        losses, last_ns = Losses(), 0
        # Not a loop over the messages, which would hold on to the last one: megabytes.
        read = partial(self._image, _Decoder(decode=self._decode), losses)
        for image in map(read, enumerate(self._recording.messages(self._topic))):
            if image is not None and image.stamp_ns <= last_ns:
                losses[Losses.BACKWARDS] += 1
            elif image is not None:
                last_ns = image.stamp_ns
                yield image
        losses.report(self._where())

    def _image(self, decoder: "_Decoder", losses: Losses, indexed: tuple[int, ChannelMessage]) -> Image | None:
        """The image of a message; None, and counted, where there is none."""
        index, message = indexed
        try:
            encoded = read_encoded_image(message.channel, message.data)
            image = decoder.image(encoded, index, encoded.stamp_ns or message.log_ns, self._where(index))
        except ValueError as error:
            self._refuse_first(index, error)
            losses["that cannot be read"] += 1
            return None
        if image is None:
            losses["that cannot be decoded: damaged, or before the first key frame"] += 1
        return image

    def _where(self, index: int | None = None) -> str:
        return f"{self._recording.path}, {self._topic}" + ("" if index is None else f", image {index}")

    def _refuse_first(self, index: int, error: ValueError) -> None:
        """Refuse a recording by its first message: a fault in that is most likely one of all."""
        if index == 0:
            channel = self._recording.channels[self._topic]
            got = Reason(f"{channel.schema or 'no schema'} ({channel.encoding}): {error}")
            expected = "Foxglove's or ROS's CompressedImage, Foxglove's CompressedVideo, or a JPEG"
            raise InputError("the images cannot be read", where=self._where(), got=got, expected=expected) from error


class _Decoder:
    """Pictures to images: stills when somebody asks, video packet by packet."""

    def __init__(self, *, decode: bool) -> None:
        self._decode = decode
        self._video: PacketDecoder | None = None
        self._size_px: tuple[int, int] | None = None

    def image(self, encoded: EncodedImage, index: int, stamp_ns: int, where: str) -> Image | None:
        """The image; None where it cannot be decoded.

        Raises:
            ValueError: It is no picture, or in a format that nobody knows.
        """
        pixels: FramePixels | StillPixels | None
        if any(name in encoded.format for name in _STILLS) or not encoded.format:
            pixels, size_px = StillPixels(encoded.data, where) if self._decode else None, _size_of(encoded.data)
        else:
            self._video = self._video or PacketDecoder(encoded.format)
            if not self._decode and self._size_px is not None:
                pixels, size_px = None, self._size_px
            else:
                frame = self._video.decode(encoded.data)
                if frame is None:
                    return None
                pixels, size_px = FramePixels(frame) if self._decode else None, (frame.width, frame.height)
        self._size_px = size_px
        return Image(
            index=index,
            stamp_ns=stamp_ns,
            arrival_ns=stamp_ns,
            clock=StampClock.HOST,
            width_px=size_px[0],
            height_px=size_px[1],
            pixels=pixels,
        )


def _size_of(data: bytes) -> tuple[int, int]:
    try:
        with PillowImage.open(BytesIO(data)) as image:
            return image.size
    except (OSError, SyntaxError, PillowImage.DecompressionBombError) as error:
        raise ValueError("no image that could be read") from error
