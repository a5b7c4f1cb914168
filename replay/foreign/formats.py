"""What a channel of another tool's recording holds, by encoding, schema and topic; and the fields of ROS messages."""

import re
import struct
from enum import StrEnum
from typing import Final

from aerodft.adapters.recording import Channel
from aerodft.conventions import SECOND_NS

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


_PLAIN_CDR: Final = (0, 1)
_PLAIN_CDR2: Final = (6, 7)
_ENCAPSULATION_BYTES: Final = 4
_MOST_NUMBERS: Final = 1000  # of a sequence that is read as numbers: a lens has a dozen
_MOST_TEXT_BYTES: Final = 1 << 16


class RosFields:
    """Reads from the front; every method raises ``ValueError`` where the message ends before the field.

    Args:
        data: The message.
        is_ros1: ROS 1: nothing is aligned, and a header begins with a sequence number.
    """

    def __init__(self, data: bytes, *, is_ros1: bool) -> None:
        self._data = data
        self._is_ros1 = is_ros1
        self._at = self._zero = 0 if is_ros1 else _ENCAPSULATION_BYTES
        self._order = "<"
        self._widest = 1 if is_ros1 else 8
        if not is_ros1:
            kind = data[1] if len(data) >= _ENCAPSULATION_BYTES else -1
            if kind not in _PLAIN_CDR + _PLAIN_CDR2:
                raise ValueError("no plain CDR")
            self._order = "<" if kind % 2 else ">"
            self._widest = 4 if kind in _PLAIN_CDR2 else 8

    def number(self, code: str) -> int | float:
        """One number, by its ``struct`` code."""
        (value,) = self._numbers(code, 1)
        return value

    def integer(self, code: str = "I") -> int:
        """One integer."""
        return int(self.number(code))

    def floats(self, count: int | None = None) -> tuple[float, ...]:
        """So many doubles; None for a sequence, which says itself how many."""
        count = self.integer() if count is None else count
        if count > _MOST_NUMBERS:
            raise ValueError(f"a sequence of {count} numbers")
        return self._numbers("d", count)

    def raw(self, item_bytes: int = 1) -> bytes:
        """A sequence of numbers as its bytes."""
        count = self.integer()
        if count:  # what is empty is not aligned
            self._align(item_bytes)
        return self._take(count * item_bytes)

    def text(self) -> str:
        """A string."""
        size = self.integer()
        if size > _MOST_TEXT_BYTES:
            raise ValueError(f"a text of {size} bytes")
        return self._take(size).rstrip(b"\0").decode(errors="replace")

    def time_ns(self) -> int:
        """Seconds and nanoseconds."""
        return self.integer("I" if self._is_ros1 else "i") * SECOND_NS + self.integer()

    def header_ns(self) -> int:
        """The stamp of a ``std_msgs/Header``, which is passed."""
        if self._is_ros1:
            self.integer()
        stamp_ns = self.time_ns()
        self.text()
        return stamp_ns

    def _numbers(self, code: str, count: int) -> tuple[float, ...]:
        size = struct.calcsize(f"={code}")
        if count:
            self._align(size)
        return struct.unpack(f"{self._order}{count}{code}", self._take(size * count))

    def _align(self, size: int) -> None:
        step = min(size, self._widest)
        self._at += -(self._at - self._zero) % step

    def _take(self, size: int) -> bytes:
        start, self._at = self._at, self._at + size
        if self._at > len(self._data):
            raise ValueError("it ends within a field")
        return self._data[start : self._at]
