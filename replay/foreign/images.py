"""Compressed images, video packets and cameras out of the messages that other tools record."""

import base64
import binascii
import logging
from datetime import timedelta
from functools import cache
from typing import Any, Final, NamedTuple

import orjson
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from google.protobuf.message import DecodeError

from aerodft.adapters.recording import Channel
from aerodft.adapters.timestamps import OLDEST_NS, iso_to_unix_ns
from aerodft.adapters.wire.payload import LATEST_NS, MOST_PICTURE_BYTES, load_bounded_json
from aerodft.conventions import SECOND_NS
from aerodft.model import Camera, LensModel
from replay.foreign.formats import CDR, JSON, PROTOBUF, ROS1, Kind, RosFields, kind_of, type_of

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
    if kind_of(channel) not in {Kind.IMAGES, Kind.VIDEO}:
        if not data.startswith(_STILL_MAGICS):
            raise ValueError("neither a known schema nor a JPEG or PNG")
        return _encoded_image(None, data, "jpeg" if data.startswith(_STILL_MAGICS[0]) else "png")
    if channel.encoding == PROTOBUF:
        return _of_protobuf(channel, data)
    if channel.encoding == JSON:
        return _of_json(data)
    if channel.encoding not in {CDR, ROS1}:
        raise ValueError(f"encoding {channel.encoding!r} is not read")
    fields = RosFields(data, is_ros1=channel.encoding == ROS1)
    if type_of(channel.schema)[0] == "sensor_msgs":
        stamp_ns, name = fields.header_ns(), fields.text()
        return _encoded_image(stamp_ns, fields.raw(), name)
    stamp_ns, _ = fields.time_ns(), fields.text()
    return _encoded_image(stamp_ns, fields.raw(), fields.text())


def _of_protobuf(channel: Channel, data: bytes) -> EncodedImage:
    parser = CompressedVideo if kind_of(channel) is Kind.VIDEO else CompressedImage
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


def json_stamp_ns(stamp: Any) -> int | None:  # noqa: ANN401 - whatever somebody writes
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


_BROWN = {"plumb_bob": 5, "rational_polynomial": 8, "": 0}
_MOST = 100  # numbers that are looked at: megabytes of them are four times as much as a tuple
_FISHEYE = {"fisheye_opencv", "kannala_brandt", "equidistant", "fisheye"}


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
    fields = RosFields(data, is_ros1=channel.encoding == ROS1)
    if type_of(channel.schema)[0] == "sensor_msgs":
        fields.header_ns()
        height_px, width_px = fields.integer(), fields.integer()
    else:
        fields.time_ns(), fields.text()
        width_px, height_px = fields.integer(), fields.integer()
    return width_px, height_px, fields.text(), fields.floats(), fields.floats(9)


def _camera(
    name: str, width_px: int, height_px: int, model: str, distortion: tuple[float, ...], matrix: tuple[float, ...]
) -> Camera:
    fx_px, _, cx_px, _, fy_px, cy_px, *_ = matrix
    if model in _FISHEYE:
        lens, coefficients = LensModel.FISHEYE, distortion[:4]
    elif model in _BROWN:
        lens, coefficients = LensModel.BROWN, distortion[: _BROWN[model]]
    else:
        raise ValueError(f"lens model {model!r}")
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
