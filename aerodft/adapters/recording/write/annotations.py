"""What viewers such as Foxglove draw over a recording's images: probes with their values, the camera's way, numbers."""

import logging
from collections import Counter, OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import orjson
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.TextAnnotation_pb2 import TextAnnotation
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import DecodeError
from google.protobuf.timestamp_pb2 import Timestamp

from aerodft.adapters.recording.channels import Channel, ChannelMessage, protobuf_channel
from aerodft.adapters.wire.events import IMAGE_SCHEMA, decode_image
from aerodft.adapters.wire.keys import Keys
from aerodft.adapters.wire.measurement import MEASUREMENT_SCHEMA, MEASUREMENTS_SCHEMA, split_measurements
from aerodft.adapters.wire.pose import POSE_SCHEMA, decode_pose
from aerodft.conventions import SECOND_NS
from aerodft.dft import recorded_kind
from aerodft.errors import InputError
from aerodft.model import Status

_log = logging.getLogger(__name__)

_CAMERA_SCHEMA: Final = str(CameraCalibration.DESCRIPTOR.full_name)
_ENU: Final = "enu"
_MOST_IMAGES: Final = 10_000  # whose measurements are still to come
_MOST_DRAWN: Final = 100  # images to which measurements may be added
_LINE, _TEXT, _BEHIND = Color(r=0.94, g=0.89, b=0.26, a=1), Color(r=1, g=1, b=1, a=1), Color(a=0.7)
_THICKNESS_PX, _FONT_PX = 3.0, 22.0


class Annotator:
    """Makes messages for viewers of those of a recording, in their order.

    Topics: ``aerodft/STATION/annotations`` with lines and values of all probes at the stamp of their image, by which
    viewers lay them on it; ``aerodft/STATION/number/PROBE`` with ``value``, ``std``, ``status`` and, as ``low`` and
    ``high``, the 95 % interval; ``aerodft/STATION/transform`` from the camera's axes to the station's.

    Args:
        station: Its name.
    """

    def __init__(self, station: str) -> None:
        self._keys = Keys(station)
        self._frame = "camera"
        self._stamps_ns: OrderedDict[int, int] = OrderedDict()  # of images, by index
        self._drawn: OrderedDict[int, dict[str, dict[str, Any]]] = OrderedDict()  # of images, by index and probe
        self._annotations = protobuf_channel(self._keys.annotations, ImageAnnotations)
        self._transform = protobuf_channel(self._keys.transform, FrameTransform)
        self._numbers: dict[str, Channel] = {}
        self._damaged: Counter[str] = Counter()  # messages, by topic

    def messages(self, message: ChannelMessage) -> list[ChannelMessage]:
        """What viewers need beside a message; nothing beside most, nor beside a damaged one (the first is said)."""
        try:
            return list(self._drawn_from(message))
        except (InputError, KeyError, TypeError, ValueError):
            topic = message.channel.topic
            if topic not in self._damaged:
                _log.warning("%s: a message is damaged; it is kept as it is, and nothing is drawn of it", topic)
            self._damaged[topic] += 1
            return []

    def channels(self, probes: Iterable[str]) -> tuple[Channel, ...]:
        """All that ``messages`` sends where these probes are measured."""
        return (self._annotations, self._transform, *map(self._number, probes))

    @property
    def damaged_messages(self) -> int:
        """How many messages were damaged so far."""
        return self._damaged.total()

    def _drawn_from(self, message: ChannelMessage) -> Iterator[ChannelMessage]:
        schema = message.channel.schema
        if schema == _CAMERA_SCHEMA:
            self._frame = _frame_of(message.data) or self._frame
        elif schema == IMAGE_SCHEMA:
            image = decode_image(message.data)
            self._stamps_ns[image.index] = image.stamp_ns
            if len(self._stamps_ns) > _MOST_IMAGES:
                self._stamps_ns.popitem(last=False)
        elif schema == POSE_SCHEMA:
            yield from self._transforms(message)
        elif schema == MEASUREMENTS_SCHEMA:
            yield from self._measured(message, [orjson.loads(each) for _, each in split_measurements(message.data)])
        elif schema == MEASUREMENT_SCHEMA:
            yield from self._measured(message, [orjson.loads(message.data)])

    def _transforms(self, message: ChannelMessage) -> Iterator[ChannelMessage]:
        sample = decode_pose(message.data)
        if sample.pose is None:
            return
        w, x, y, z = sample.pose.wxyz.tolist()
        east_m, north_m, up_m = sample.pose.position_enu_m.tolist()
        transform = FrameTransform(
            timestamp=_timestamp(sample.stamp_ns),
            parent_frame_id=_ENU,
            child_frame_id=self._frame,
            translation=Vector3(x=east_m, y=north_m, z=up_m),
            rotation=Quaternion(w=w, x=x, y=y, z=z),
        )
        yield ChannelMessage(message.log_ns, self._transform, bytes(transform.SerializeToString()), 0)

    def _measured(self, message: ChannelMessage, items: Sequence[dict[str, Any]]) -> Iterator[ChannelMessage]:
        for item in items:
            yield ChannelMessage(message.log_ns, self._number(item["name"]), _number_payload(item), 0)
        for image in dict.fromkeys(item["image"] for item in items if item["image"] is not None and _pixels(item)):
            yield self._drawing(message, image, [item for item in items if item["image"] == image and _pixels(item)])

    def _drawing(self, message: ChannelMessage, image: int, items: Sequence[dict[str, Any]]) -> ChannelMessage:
        """All that was measured in an image so far: a viewer keeps the last message of a stamp alone."""
        seen = self._drawn.setdefault(image, {})
        seen.update({item["name"]: item for item in items})
        if len(self._drawn) > _MOST_DRAWN:
            self._drawn.popitem(last=False)
        stamp = _timestamp(self._stamps_ns.get(image, int(items[0]["stamp_ns"])))
        drawn = ImageAnnotations(
            points=[_line(item, stamp) for item in seen.values()], texts=[_text(item, stamp) for item in seen.values()]
        )
        return ChannelMessage(message.log_ns, self._annotations, bytes(drawn.SerializeToString()), 0)

    def _number(self, probe: str) -> Channel:
        if probe not in self._numbers:
            self._numbers[probe] = Channel(topic=self._keys.number(probe), encoding="json")
        return self._numbers[probe]


def _frame_of(data: bytes) -> str:
    try:
        return str(CameraCalibration.FromString(data).frame_id)
    except DecodeError:
        return ""


def _pixels(item: dict[str, Any]) -> list[Point2]:
    return [Point2(x=u, y=v) for u, v in item["pixels"] if u is not None and v is not None]


def _line(item: dict[str, Any], stamp: Timestamp) -> PointsAnnotation:
    points = _pixels(item)
    kind = recorded_kind(item["kind"])
    lines = PointsAnnotation.LINE_LIST if kind.in_pairs else PointsAnnotation.LINE_STRIP
    lines = PointsAnnotation.LINE_LOOP if kind.is_closed else lines
    return PointsAnnotation(
        timestamp=stamp,
        type=lines if len(points) > 1 else PointsAnnotation.POINTS,
        points=points,
        outline_color=_LINE,
        thickness=_THICKNESS_PX,
    )


def _text(item: dict[str, Any], stamp: Timestamp) -> TextAnnotation:
    points = _pixels(item)
    middle = Point2(x=sum(each.x for each in points) / len(points), y=sum(each.y for each in points) / len(points))
    return TextAnnotation(
        timestamp=stamp,
        position=middle,
        text=label(item),
        font_size=_FONT_PX,
        text_color=_TEXT,
        background_color=_BEHIND,
    )


def label(item: dict[str, Any]) -> str:
    """A measurement in one line: its value with its interval, or its status.

    Args:
        item: As ``aerodft.measurement/1``.
    """
    if item["status"] != Status.OK:
        return f"{item['name']}: {item['status']}"
    if item["value"] is None:
        return str(item["name"])
    low, high = item["ci95"] or (item["value"], item["value"])
    return f"{item['name']}: {item['value']:.2f} {item['unit']} [{low:.2f} ... {high:.2f}] 95 %"


def _number_payload(item: dict[str, Any]) -> bytes:
    low, high = item["ci95"] or (None, None)
    keys = {key: item[key] for key in ("value", "std", "unit", "status", "stamp_ns")}
    return orjson.dumps({**keys, "low": low, "high": high})


def _timestamp(stamp_ns: int) -> Timestamp:
    return Timestamp(seconds=stamp_ns // SECOND_NS, nanos=stamp_ns % SECOND_NS)
