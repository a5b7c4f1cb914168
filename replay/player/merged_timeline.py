"""Messages of several recordings merged in order of log time."""

import heapq
import logging
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from aerodft.adapters.recording import Channel
from aerodft.adapters.recording.read import ChannelFilter, ReadMessage, SegmentScan, content_bytes
from aerodft.adapters.wire.events import IMAGE_SCHEMA
from aerodft.conventions import SECOND_NS
from replay.foreign import ForeignRecording
from replay.recordings import Recording, channels_of, is_within, messages_by_time, messages_of

_APART_NS: Final = SECOND_NS  # what recorders put off writing
_MOST_HELD_BYTES: Final = 96 << 20  # by streams of one topic each: a chunk is held by every one of them
_log = logging.getLogger(__name__)
AnyRecording = Recording | ForeignRecording
RecordingFilter = Callable[[AnyRecording, Channel], bool]


class TimelineMessage(NamedTuple):
    """One message of one recording.

    Attributes:
        log_ns: Its log time.
        recording: Where it is from.
        message: The message.
        is_mark: Whether a step ends before it: an image, or where there are none any message.
    """

    log_ns: int
    recording: AnyRecording
    message: ReadMessage
    is_step: bool


def name_of(recording: AnyRecording) -> str:
    """A recording's path, for messages."""
    return str(recording.folder if isinstance(recording, Recording) else recording.path)


def is_image_step(recording: AnyRecording, channel: Channel) -> bool:
    """Whether a channel has a recording's images, or their stamps."""
    if isinstance(recording, Recording):
        return channel.schema == IMAGE_SCHEMA
    return channel.topic == recording.images


def timeline(
    recordings: Sequence[AnyRecording], from_ns: int | None, to_ns: int | None, wanted: RecordingFilter
) -> Iterator[TimelineMessage]:
    """All messages with log times in ``[from_ns, to_ns)``; of equal ones the first recording's come first.

    Args:
        recordings: Each in its own order.
        from_ns: None for the start.
        to_ns: None for the end.
        wanted: Whose messages; the images' stamps come in any case.

    Raises:
        InputError: A file cannot be read.
    """
    return heapq.merge(
        *(_timeline_messages(each, from_ns, to_ns, wanted) for each in recordings), key=lambda item: item.log_ns
    )


def _timeline_messages(
    recording: AnyRecording, from_ns: int | None, to_ns: int | None, wanted: RecordingFilter
) -> Iterator[TimelineMessage]:
    has_images = isinstance(recording, Recording) or recording.images is not None
    for message in _messages(recording, from_ns, to_ns, wanted):
        is_step = not has_images or is_image_step(recording, message.channel)
        yield TimelineMessage(message.log_ns, recording, message, is_step)


def _messages(
    recording: AnyRecording, from_ns: int | None, to_ns: int | None, wanted: RecordingFilter
) -> Iterator[ReadMessage]:
    def is_wanted(channel: Channel) -> bool:
        return is_image_step(recording, channel) or wanted(recording, channel)

    if isinstance(recording, ForeignRecording):
        streams = (_by_time(each, from_ns, to_ns, is_wanted) for each in recording.segments)
        return heapq.merge(*streams, key=lambda message: message.log_ns)
    data = recording.messages(from_ns=from_ns, to_ns=to_ns, wanted=is_wanted)
    images = (
        message
        for message in recording.image_messages(from_ns=from_ns, to_ns=to_ns)
        if wanted(recording, message.channel)
    )
    # A picture comes after its image's stamps, which have the same log time.
    return heapq.merge(data, images, key=lambda message: message.log_ns)


def _by_time(
    segment: SegmentScan, from_ns: int | None, to_ns: int | None, is_wanted: ChannelFilter
) -> Iterator[ReadMessage]:
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

    def stream(topic: str) -> Iterator[ReadMessage]:
        return messages_of([segment], from_ns=from_ns, to_ns=to_ns, wanted=lambda channel: channel.topic == topic)

    streams = map(stream, sorted(topics))
    return heapq.merge(*streams, key=lambda message: message.log_ns)
