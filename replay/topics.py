"""Which channels of another tool's recording are telemetry, images and camera: as stated, else as they tell."""

import logging
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from aerodft.adapters.config.inputs import Topics
from aerodft.adapters.foreign.frames import FrameReader
from aerodft.adapters.foreign.kinds import JSON, Kind, kind_of
from aerodft.adapters.mavlink.framing import StreamFramer
from aerodft.adapters.mcap.places import ReadChannel, SegmentScan
from aerodft.errors import InputError
from replay.segments import channels_of, messages_of

_SHOWN: Final = 12
_TO_THE_VEHICLE: Final = ("in", "to", "sink")
_TRIED: Final = 200  # messages of a channel that are looked through for frames
_MOST_BYTES: Final = 1 << 16
_LOOKS: Final = (3, 12, 48)  # so many messages are looked at together
_MOST_LOOKED_THROUGH: Final = 500  # channels
_ENOUGH: Final = 3
_PICTURES: Final = (Kind.IMAGES, Kind.VIDEO)
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Roles:
    """What each topic of a recording is, as its channels tell.

    Attributes:
        images: Topic of the images; None where there are none.
        camera: Topic of the camera's calibration; None where there is none.
        location: Topic of positions, likewise.
    """

    images: str | None
    camera: str | None
    location: str | None


def roles_of(where: object, segments: Sequence[SegmentScan], stated: Topics) -> Roles:
    """Find out what a recording's topics are.

    Args:
        where: The recording's name in messages.
        segments: Its files.
        stated: What is known beforehand.

    Raises:
        InputError: A stated topic is not there, or several could be the images.
    """
    channels = _by_topic(segments)
    listed = described(channels)
    for option, topics in (("mavlink", stated.mavlink), ("images", stated.images), ("camera", stated.camera)):
        for topic in topics:
            if topic not in channels:
                raise InputError(f"no topic {topic} ({option})", where=where, got=listed, expected="one of these")
    kinds = {topic: kind_of(channel) for topic, channel in channels.items()}

    def one(option: str, given: Sequence[str], wanted: Sequence[Kind]) -> str | None:
        found = list(given) or [topic for topic, kind in kinds.items() if kind in wanted]
        if len(found) > 1:
            hint = f"say which: --topic {option}={found[0]}"
            raise InputError(f"several topics of {option}", where=where, got=", ".join(found), hint=hint)
        return found[0] if found else None

    cameras = [topic for topic, kind in kinds.items() if kind is Kind.CAMERA]
    return Roles(
        images=one("images", stated.images, _PICTURES),
        camera=one("camera", stated.camera or (cameras if len(cameras) == 1 else ()), ()),
        location=next((topic for topic, kind in kinds.items() if kind is Kind.LOCATION), None),
    )


def described(channels: Mapping[str, ReadChannel]) -> str:
    """The channels for a sentence: topic, schema and encoding of each."""
    shown = [
        f"{topic} ({', '.join(part for part in (channel.schema, channel.encoding) if part) or 'no schema'})"
        for topic, channel in sorted(channels.items())
    ]
    more = f" and {len(shown) - _SHOWN} more" if len(shown) > _SHOWN else ""
    return f"{', '.join(shown[:_SHOWN])}{more}" if shown else "no channel"


def framed_of(where: object, segments: Sequence[SegmentScan]) -> tuple[str, ...]:
    """The topics that hold MAVLink: by what they are called, else by what their messages hold.

    Args:
        where: The recording's name in messages.
        segments: Its files.
    """
    kinds = {topic: kind_of(channel) for topic, channel in _by_topic(segments).items()}
    found = [topic for topic, kind in kinds.items() if kind is Kind.MAVLINK]
    if found:
        return tuple(found)
    unknown = [topic for topic, kind in kinds.items() if kind is None]
    if len(unknown) > _MOST_LOOKED_THROUGH:
        said = "%s: MAVLink is looked for in %d of %d topics; --topic mavlink=... says which has it"
        _log.warning(said, where, _MOST_LOOKED_THROUGH, len(unknown))
    return tuple(_with_frames(segments, unknown[:_MOST_LOOKED_THROUGH]))


def telemetry_of(where: object, channels: Mapping[str, ReadChannel], framed: Sequence[str]) -> tuple[str, ...]:
    """Which of the topics with MAVLink has the vehicle's telemetry.

    Args:
        where: The recording's name in messages.
        channels: By topic.
        framed: The topics with MAVLink.

    Raises:
        InputError: Several could have it.
    """
    heard = [topic for topic in framed if topic.rsplit("/", 1)[-1].rsplit("_", 1)[-1] not in _TO_THE_VEHICLE]
    raw = [topic for topic in heard or framed if channels[topic].encoding != JSON]  # JSON repeats what is there raw
    found = raw or heard or framed
    if len(found) > 1:
        hint = f"say which: --topic mavlink={found[0]}, once for each that is to be taken"
        raise InputError("several topics hold MAVLink", where=where, got=", ".join(found), hint=hint)
    return tuple(found)


def _by_topic(segments: Sequence[SegmentScan]) -> dict[str, ReadChannel]:
    return {channel.topic: channel for each in segments for channel in channels_of(each).values()}


def _with_frames(segments: Sequence[SegmentScan], topics: Sequence[str]) -> list[str]:
    """Those of the topics whose first messages hold frames, in their order; reads no further than it must."""
    found, tried, open_topics = set[str](), Counter[str](), set(topics)
    readers: dict[str, FrameReader] = {}
    unwrapped: dict[str, bytes] = defaultdict(bytes)
    for message in messages_of(segments, wanted=lambda channel: channel.topic in open_topics):
        topic = message.channel.topic
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
