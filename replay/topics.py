"""Which channels of another tool's recording are telemetry, images and camera: as stated, else as they tell."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

from aerodft.adapters.config.inputs import Topics
from aerodft.adapters.foreign.frames import FrameReader
from aerodft.adapters.foreign.kinds import JSON, Kind, kind_of
from aerodft.adapters.mcap.places import ReadChannel, SegmentScan
from aerodft.errors import InputError
from replay.segments import channels_of, messages_of

_SHOWN: Final = 12
_TO_THE_VEHICLE: Final = ("in", "to", "sink")
_TRIED: Final = 200  # messages of a channel that are looked through for frames
_ENOUGH: Final = 3
_PICTURES: Final = (Kind.IMAGES, Kind.VIDEO)


@dataclass(frozen=True, slots=True, kw_only=True)
class Roles:
    """What each topic of a recording is.

    Attributes:
        mavlink: Topics of telemetry.
        images: Topic of the images; None where there are none.
        camera: Topic of the camera's calibration; None where there is none.
        location: Topic of positions, likewise.
    """

    mavlink: tuple[str, ...]
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
        InputError: A stated topic is not there, or several could be the telemetry or the images.
    """
    channels = {channel.topic: channel for each in segments for channel in channels_of(each).values()}
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

    mavlink = stated.mavlink or _telemetry(where, segments, channels, kinds)
    cameras = [topic for topic, kind in kinds.items() if kind is Kind.CAMERA]
    return Roles(
        mavlink=mavlink,
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


def _telemetry(
    where: object,
    segments: Sequence[SegmentScan],
    channels: Mapping[str, ReadChannel],
    kinds: Mapping[str, Kind | None],
) -> tuple[str, ...]:
    """The topics of the vehicle's telemetry: by what they are called, else by what their messages hold."""
    found = [topic for topic, kind in kinds.items() if kind is Kind.MAVLINK]
    if not found:
        found = [topic for topic, kind in kinds.items() if kind is None and _holds_frames(segments, topic)]
    heard = [topic for topic in found if topic.rsplit("/", 1)[-1].rsplit("_", 1)[-1] not in _TO_THE_VEHICLE] or found
    raw = [topic for topic in heard if channels[topic].encoding != JSON] or heard  # JSON repeats what is there raw
    if len(raw) > 1:
        hint = f"say which: --topic mavlink={raw[0]}, once for each that is to be taken"
        raise InputError("several topics hold MAVLink", where=where, got=", ".join(raw), hint=hint)
    return tuple(raw)


def _holds_frames(segments: Sequence[SegmentScan], topic: str) -> bool:
    frames = 0
    reader: FrameReader | None = None
    messages = messages_of(segments, wanted=lambda channel: channel.topic == topic)
    for message in islice(messages, _TRIED):
        reader = reader or FrameReader(message.channel)
        frames += len(reader.frames(message.data))
        if frames >= _ENOUGH:
            return True
    return False
