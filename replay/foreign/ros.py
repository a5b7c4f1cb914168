"""Fields of ROS messages (ROS 1, and CDR as ROS 2 writes it), read in place by ``rosbags``."""

import struct
from functools import cache
from typing import Any, Final

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from aerodft.conventions import SECOND_NS
from aerodft.model import FloatArray, ImageArray

# Fields up to the last one that is read; what follows is not looked at. A text is declared as its bytes, which have the
# same form on the wire: `rosbags` leaves them in place, however long they claim to be.
_STAMP: Final = "{seconds} sec\nuint32 nanosec\nuint8[] frame_id\n"
_HEADER: Final = "{sequence}" + _STAMP
_LENS: Final = "uint8[] distortion_model\nfloat64[] d\nfloat64[9] k\n"
_FRAME: Final = (
    "uint8 framing_status\nuint8 magic\nuint8 len\nuint8 incompat_flags\nuint8 compat_flags\nuint8 seq\nuint8 sysid\n"
    "uint8 compid\nuint32 msgid\nuint16 checksum\nuint64[] payload64\nuint8[] signature\n"
)
_IMAGES: Final = {
    ("sensor_msgs", "CompressedImage"): f"{_HEADER}uint8[] format\nuint8[] data\n",
    ("foxglove", "CompressedImage"): f"{_STAMP}uint8[] data\nuint8[] format\n",
    ("foxglove", "CompressedVideo"): f"{_STAMP}uint8[] data\nuint8[] format\n",
}
_NUMBERS: Final = {
    ("sensor_msgs", "CameraInfo"): f"{_HEADER}uint32 height\nuint32 width\n{_LENS}",
    ("foxglove", "CameraCalibration"): f"{_STAMP}uint32 width\nuint32 height\n{_LENS}",
    ("mavros_msgs", "Mavlink"): f"{_HEADER}{_FRAME}",
}
_EIGHT_BYTES: Final = {"d": "f8", "k": "f8", "payload64": "u8"}
_ROS1_NAMES: Final = {"sequence": "uint32 header_seq\n", "seconds": "uint32"}
_ROS2_NAMES: Final = {"sequence": "", "seconds": "int32"}
_PLAIN_CDR: Final = (0, 1)  # kinds of encapsulation (DDS-XTypes 1.3, 7.6.3.1.2): big and little endian
_PLAIN_CDR2: Final = (6, 7)
_ENCAPSULATION_BYTES: Final = 4
_MAX_NUMBERS: Final = 1000  # of a sequence beside images: a lens has a dozen, a frame's payload 33
_MAX_TEXT_BYTES: Final = 1 << 16


def read_ros_fields(message_type: tuple[str, str], data: bytes, *, is_ros1: bool) -> Any:  # noqa: ANN401 - by its type
    """Read the fields of a message, as attributes by their names in lower case.

    Sequences are arrays ``(n,)``; images and texts are bytes that share the message's memory, see `text_of`.

    Args:
        message_type: Package and name: CompressedImage, CameraInfo, ...
        data: The message.
        is_ros1: ROS 1; else CDR.

    Raises:
        ValueError: The message ends before a field, or claims more than such a message has.
    """
    content, kind = memoryview(data), 1
    if not is_ros1:
        kind = data[1] if len(data) >= _ENCAPSULATION_BYTES else -1
        if kind not in _PLAIN_CDR + _PLAIN_CDR2:
            raise ValueError("no plain CDR")
        content = content[_ENCAPSULATION_BYTES:]
    store = _typestore(message_type in _IMAGES, is_ros1, kind in _PLAIN_CDR2)
    definition = store.get_msgdef("/msg/".join(message_type))
    read_cdr = definition.deserialize_cdr_le if kind % 2 else definition.deserialize_cdr_be
    read = definition.deserialize_ros1 if is_ros1 else read_cdr
    try:
        fields, _ = read(content, 0, definition.cls, store)
    except (SerdeError, struct.error, ValueError, IndexError) as error:
        raise ValueError(f"no {message_type[1]}: {error}") from error
    for name in _EIGHT_BYTES.keys() & vars(fields).keys():
        setattr(fields, name, _as_sent(getattr(fields, name), ("<" if kind % 2 else ">") + _EIGHT_BYTES[name]))
    return fields


@cache
def _typestore(is_image: bool, is_ros1: bool, is_cdr2: bool) -> Typestore:  # noqa: FBT001 - the cache's key
    """Types of images, whose bytes are as many as they like, or of the other messages."""
    store = Typestore() if is_image else Typestore(max_sequence_length=_MAX_NUMBERS)
    for (package, name), fields in (_IMAGES if is_image else _NUMBERS).items():
        text = fields.format(**(_ROS1_NAMES if is_ros1 else _ROS2_NAMES))
        if is_cdr2:  # numbers of eight bytes are aligned to four, as their count before them is; `rosbags` aligns to 8
            text = text.replace("float64", "Eight").replace("uint64", "Eight")
            store.register(get_types_from_msg("uint8[8] content\n", f"{package}/msg/Eight"))
        store.register(get_types_from_msg(text, f"{package}/msg/{name}"))
    return store


def _as_sent(numbers: Any, dtype: str) -> FloatArray:  # noqa: ANN401 - an array, or CDR 2's objects of eight bytes
    """Numbers of eight bytes, ``(n,)``, in the byte order in which they were sent."""
    if isinstance(numbers, list):
        return np.frombuffer(b"".join(each.content.tobytes() for each in numbers), dtype)
    return np.asarray(numbers, dtype)


def stamp_ns_of(fields: Any) -> int:  # noqa: ANN401 - of every type that has a stamp
    """Stamp of a message, integer nanoseconds.

    Raises:
        ValueError: The name of its frame is no name.
    """
    _refuse_long(fields.frame_id)
    return int(fields.sec) * SECOND_NS + int(fields.nanosec)


def text_of(field: ImageArray) -> str:
    """Decode a text, ``(n,)`` bytes; letters that cannot be decoded are replaced.

    Raises:
        ValueError: It is longer than any name.
    """
    _refuse_long(field)
    return field.tobytes().rstrip(b"\0").decode(errors="replace")


def _refuse_long(text: ImageArray) -> None:
    if text.size > _MAX_TEXT_BYTES:
        raise ValueError(f"a text of {text.size} bytes")
