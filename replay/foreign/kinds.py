"""What a channel of another tool's recording holds, as far as its encoding, schema and topic say."""

import re
from enum import StrEnum
from typing import Final

from aerodft.adapters.recording import Channel

JSON, PROTOBUF, CDR, ROS1 = "json", "protobuf", "cdr", "ros1"
_READABLE: Final = frozenset({JSON, PROTOBUF, CDR, ROS1})


class Kind(StrEnum):
    """What is in a channel's messages."""

    MAVLINK = "MAVLink"
    IMAGES = "images"
    VIDEO = "video"
    CAMERA = "camera"
    LOCATION = "location"


_BY_TYPE: Final = {
    ("foxglove", "CompressedImage"): Kind.IMAGES,
    ("sensor_msgs", "CompressedImage"): Kind.IMAGES,
    ("foxglove", "CompressedVideo"): Kind.VIDEO,
    ("foxglove", "CameraCalibration"): Kind.CAMERA,
    ("sensor_msgs", "CameraInfo"): Kind.CAMERA,
    ("foxglove", "LocationFix"): Kind.LOCATION,
    ("sensor_msgs", "NavSatFix"): Kind.LOCATION,
    ("mavros_msgs", "Mavlink"): Kind.MAVLINK,
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


def kind_of(channel: Channel) -> Kind | None:
    """What a channel holds; None where nothing says so, or in an encoding that is not read."""
    if _MAVLINK_ENCODINGS.fullmatch(channel.encoding) or _MAVLINK_ENCODINGS.fullmatch(channel.schema):
        return Kind.MAVLINK
    kind = _BY_TYPE.get(type_of(channel.schema))
    if kind is not None:
        return kind if channel.encoding in _READABLE else None
    # A topic per message repeats what mavlink/out has: mavlink/1/1/ATTITUDE and its like are not telemetry.
    return Kind.MAVLINK if _MAVLINK_TOPICS.fullmatch(channel.topic) else None
