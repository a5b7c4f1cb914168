"""Inputs and outputs as the messages of a recording's data file; many of them as columns, laid into a chunk at once."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.opcode import Opcode

from aerodft.adapters.recording.channels import Channel, ChannelMessage, json_channel, protobuf_channel, raw_channel
from aerodft.adapters.recording.layout import MESSAGE_HEAD, RECORD_HEAD, ChunkBuffer
from aerodft.adapters.wire.events import IMAGE_SCHEMA, OBSERVATION_SCHEMA, encode_images, encode_observation
from aerodft.adapters.wire.keys import Keys
from aerodft.adapters.wire.measurement import MEASUREMENTS_SCHEMA, encode_batch
from aerodft.adapters.wire.packed_json import PackedBytes, encode_payloads
from aerodft.adapters.wire.pose import HEIGHT_SWITCH_SCHEMA, POSE_SCHEMA, encode_height_switch, encode_poses
from aerodft.adapters.wire.status import (
    CALIBRATION_SCHEMA,
    CAMERA_MOTION_SCHEMA,
    STATUS_SCHEMA,
    StationStatus,
    encode_camera_motion,
    encode_estimate,
    encode_status,
)
from aerodft.conventions import SECOND_NS
from aerodft.geometry import LENS_MODELS
from aerodft.jit import njit
from aerodft.model import (
    CalibrationEstimate,
    Camera,
    CameraMotionEstimate,
    HeightSwitch,
    Image,
    ImageArray,
    IntArray,
    PoseBatch,
    VideoPacket,
    WireProtocol,
    image_indices,
)
from aerodft.service import Batches, StepOutputs

_RECORD_HEAD, _MESSAGE_HEAD = RECORD_HEAD.size, MESSAGE_HEAD.size
_OPCODE = int(Opcode.MESSAGE)


@dataclass(frozen=True, slots=True, eq=False)
class MessageRows:
    """``n`` messages in the order of writing.

    Attributes:
        channels: Theirs.
        channel: ``(n,)`` which of these.
        log_ns: ``(n,)``.
        sequence: ``(n,)``.
        texts: ``(n,)`` payloads.
    """

    channels: tuple[Channel, ...]
    channel: IntArray
    log_ns: IntArray
    sequence: IntArray
    texts: PackedBytes

    def __len__(self) -> int:
        return len(self.channel)

    @property
    def sizes(self) -> IntArray:
        """``(n,)`` bytes of the payloads."""
        return self.texts.stop - self.texts.start

    def message(self, row: int) -> ChannelMessage:
        """One of them."""
        channel, log_ns = self.channels[self.channel[row]], int(self.log_ns[row])
        return ChannelMessage(log_ns, channel, self.texts.text(row), int(self.sequence[row]))

    def lay(self, first: int, stop: int, ids: IntArray, buffer: ChunkBuffer) -> None:
        """Add some of them to a chunk, by the channels' ids ``(channels,)``."""
        rows = slice(first, stop)
        sizes, channel_ids, log_ns = self.sizes[rows], ids[self.channel[rows]], self.log_ns[rows]
        begin = buffer.content_bytes
        out = buffer.more(int(sizes.sum()) + (_RECORD_HEAD + _MESSAGE_HEAD) * len(sizes))
        offset = np.empty(len(sizes), dtype=np.int64)
        heads = np.stack([channel_ids, self.sequence[rows], log_ns, self.texts.start[rows], sizes])
        _lay(np.frombuffer(self.texts.data, dtype=np.uint8), heads, np.frombuffer(out, dtype=np.uint8), offset)
        buffer.add_rows(channel_ids, log_ns, begin + offset)


def warm_up() -> None:
    """Compile now what would hold up the first messages of something live."""
    one = np.ones(1, dtype=np.int64)
    half = one[:, None] / 2
    written = encode_payloads(one[:, None], lambda _: {"stamp_ns": "1", "value": 0.5}, {"stamp_ns": one}, half)
    for texts in (written, PackedBytes(bytes(written.data), written.start, written.stop)):  # as written, and as read
        MessageRows((raw_channel(WireProtocol.MAVLINK, ""),), one - 1, one, one, texts).lay(0, 1, one, ChunkBuffer())


@njit
def _lay(data: ImageArray, heads: IntArray, out: ImageArray, offset: IntArray) -> None:
    """Write message records; ``heads (5, n)`` are channel ids, sequences, log times, payloads' beginnings and sizes."""
    position = 0
    for row in range(len(offset)):
        offset[row] = position
        channel, sequence, log_ns = heads[0, row], heads[1, row], heads[2, row]
        start, size = heads[3, row], heads[4, row]
        out[position] = _OPCODE
        _put(out, position + 1, 8, size + _MESSAGE_HEAD)
        at = position + _RECORD_HEAD
        _put(out, at, 2, channel)
        _put(out, at + 2, 4, sequence)
        _put(out, at + 6, 8, log_ns)
        _put(out, at + 14, 8, log_ns)
        at += _MESSAGE_HEAD
        payload, text = out[at : at + size], data[start : start + size]
        for k in range(size):  # in a tenth of the time that one part takes for the other
            payload[k] = text[k]
        position = at + size


@njit
def _put(out: ImageArray, at: int, size: int, value: int) -> None:
    """A whole number, the lowest byte first."""
    for k in range(size):
        out[at + k] = (value >> (8 * k)) & 0xFF


_FIX_PERIOD_NS: Final = SECOND_NS // 5
_SEQUENCE_MASK: Final = 0xFFFFFFFF
_PER_IMAGE: Final = 3  # messages at most: pose, position, measurements


def image_sequence(index: int) -> int:
    """The message sequence of an image's stamps, its JPEG and its pose, by which they find each other."""
    return index & _SEQUENCE_MASK


class RecordEncoder:
    """Makes records; remembers the channels of senders and observed probes. Used by one thread."""

    def __init__(self, keys: Keys, frame: str) -> None:
        self._keys = keys
        self._frame = frame
        self._senders: dict[tuple[str, str], Channel] = {}
        self._observed: dict[str, Channel] = {}
        self._measured = json_channel(keys.measurements, MEASUREMENTS_SCHEMA)
        self._image = json_channel(keys.image, IMAGE_SCHEMA)
        self._pose = json_channel(keys.pose, POSE_SCHEMA)
        self._calibration = json_channel(keys.calibration, CALIBRATION_SCHEMA)
        self._camera_motion = json_channel(keys.camera_motion, CAMERA_MOTION_SCHEMA)
        self._height = json_channel(keys.height, HEIGHT_SWITCH_SCHEMA)
        self._status = json_channel(keys.status, STATUS_SCHEMA)
        self._location = protobuf_channel(keys.location, LocationFix)
        self._fixed_ns = 0

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels that every data file has from the start."""
        return self._image, self._pose, self._measured, self._status, self._location

    def from_step(self, batches: Batches, outputs: StepOutputs) -> MessageRows:
        """The messages of some ticks: of each tick the inputs in order of arrival, then the outputs in their order."""
        rows = _TickRows(batches.now_ns)
        self._add_inputs(rows, batches)
        self._add_outputs(rows, outputs)
        return rows.sorted()

    def from_status(self, value: StationStatus) -> ChannelMessage:
        """A station's state."""
        return ChannelMessage(value.stamp_ns, self._status, encode_status(value))

    def _add_inputs(self, rows: "_TickRows", batches: Batches) -> None:
        """Add inputs; equal arrivals are ordered: frames, stamps of images, observations."""
        for block in sorted(batches.raw, key=lambda block: (block.protocol, block.sender)):
            sender = (block.protocol, block.sender)
            channel = self._senders.setdefault(sender, raw_channel(*sender))
            tick = np.searchsorted(batches.now_ns, block.arrival_ns)
            first_ns = block.arrival_ns[np.searchsorted(tick, tick)]  # of this sender in each tick: who was there first
            texts = PackedBytes(block.data, block.offset, block.offset + block.length)
            rows.add_inputs(channel, tick, block.arrival_ns, first_ns - block.arrival_ns, texts)
        images, observations = batches.images, batches.observations
        if images:
            sequence = image_indices(images) & _SEQUENCE_MASK
            order = np.ones_like(sequence)
            texts = encode_images(images)
            rows.add_inputs(self._image, batches.image_tick, batches.image_arrival_ns, order, texts, sequence)
        for name in dict.fromkeys(observation.name for observation in observations):
            if name not in self._observed:
                self._observed[name] = json_channel(self._keys.observation(name), OBSERVATION_SCHEMA)
            own = np.array([row for row, observation in enumerate(observations) if observation.name == name])
            texts = PackedBytes.from_texts([encode_observation(observations[row]) for row in own.tolist()])
            arrival_ns = np.array([observations[row].arrival_ns for row in own.tolist()])
            rows.add_inputs(self._observed[name], batches.observation_tick[own], arrival_ns, 2 + own, texts)

    def _add_outputs(self, rows: "_TickRows", outputs: StepOutputs) -> None:
        if outputs.images:
            poses = PoseBatch.concatenate([block.poses for block in outputs.images])
            tick = np.concatenate([block.tick for block in outputs.images])
            order = _PER_IMAGE * np.concatenate([block.order for block in outputs.images])
            sequence = np.concatenate([block.images for block in outputs.images]) & _SEQUENCE_MASK
            rows.add_outputs(self._pose, tick, order, encode_poses(poses), sequence)
            fixed = self._fixes_due(poses, rows.now_ns[tick], order)
            fixes = PackedBytes.from_texts(location_fixes(poses.rows(fixed), self._frame))
            rows.add_outputs(self._location, tick[fixed], order[fixed] + 1, fixes)
        for tick, order, batch in outputs.measured():
            rows.add_outputs(self._measured, tick, _PER_IMAGE * order + 2, encode_batch(batch))
        for single in outputs.singles:
            match single.content:
                case HeightSwitch():
                    channel, data = self._height, encode_height_switch(single.content)
                case CameraMotionEstimate():
                    channel, data = self._camera_motion, encode_camera_motion(single.content)
                case CalibrationEstimate():
                    channel, data = self._calibration, encode_estimate(single.content)
                case _:  # an observation is recorded as it came
                    continue
            tick, order = np.array([[single.tick], [_PER_IMAGE * single.order]])
            rows.add_outputs(channel, tick, order, PackedBytes.from_texts([data]))

    def _fixes_due(self, poses: PoseBatch, now_ns: IntArray, order: IntArray) -> IntArray:
        """Which of the poses ``(n,)`` are shown on maps: a few times a second one whose place is known."""
        rows = np.argsort(order)
        rows = rows[~np.isnan(poses.lat_lon_alt[rows, :2]).any(axis=1)]
        due = []
        for row, at_ns in zip(rows.tolist(), now_ns[rows].tolist(), strict=True):
            if abs(at_ns - self._fixed_ns) >= _FIX_PERIOD_NS:
                self._fixed_ns = at_ns
                due.append(row)
        return np.array(due, dtype=np.int64)


class _TickRows:
    """Messages of some ticks, gathered in any order.

    Args:
        now_ns: ``(n,)`` when the ticks end.
    """

    def __init__(self, now_ns: IntArray) -> None:
        self.now_ns = now_ns
        self._channels: dict[Channel, int] = {}
        self._heads: list[IntArray] = [np.empty((5, 0), dtype=np.int64)]
        self._texts: list[PackedBytes] = [PackedBytes.from_texts([])]

    def add_inputs(
        self,
        channel: Channel,
        tick: IntArray,
        arrival_ns: IntArray,
        order: IntArray,
        texts: PackedBytes,
        sequence: IntArray | int = 0,
    ) -> None:
        """Add messages ``(m,)`` of one channel, logged at their arrival; ``order`` is among those of the same time."""
        self._add(channel, texts, (2 * tick, arrival_ns, order), sequence)

    def add_outputs(
        self, channel: Channel, tick: IntArray, order: IntArray, texts: PackedBytes, sequence: IntArray | int = 0
    ) -> None:
        """Add messages ``(m,)`` of one channel, logged at their ticks; ``order`` is among all outputs."""
        self._add(channel, texts, (2 * tick + 1, self.now_ns[tick], order), sequence)

    def sorted(self) -> MessageRows:
        """All messages: by tick, inputs before outputs, then by log time, then in their order."""
        heads = np.concatenate(self._heads, axis=1)
        rows = np.lexsort((heads[2], heads[1], heads[0]))
        _, log_ns, _, channel, sequence = heads[:, rows]
        return MessageRows(
            tuple(self._channels), channel, log_ns, sequence, PackedBytes.concatenated(self._texts, rows)
        )

    def _add(
        self, channel: Channel, texts: PackedBytes, keys: tuple[IntArray, IntArray, IntArray], sequence: IntArray | int
    ) -> None:
        """Add messages with what is put into order by: part of a tick, log time, order."""
        heads = np.empty((5, len(texts)), dtype=np.int64)
        heads[:3], heads[4] = keys, sequence
        heads[3] = self._channels.setdefault(channel, len(self._channels))
        self._heads.append(heads)
        self._texts.append(texts)


def compressed_image(image: Image, jpeg: bytes, frame: str) -> bytes:
    """A JPEG at the image's stamp as ``foxglove.CompressedImage``."""
    message = CompressedImage(timestamp=_timestamp(image.stamp_ns), frame_id=frame, data=jpeg, format="jpeg")
    return bytes(message.SerializeToString())


def compressed_video(packet: VideoPacket, frame: str) -> bytes:
    """An image of an H.264 stream at its stamp as ``foxglove.CompressedVideo``."""
    stamp = _timestamp(packet.stamp_ns)
    message = CompressedVideo(timestamp=stamp, frame_id=frame, data=packet.data, format="h264")
    return bytes(message.SerializeToString())


def camera_calibration(camera: Camera, stamp_ns: int) -> bytes:
    """A camera as ``foxglove.CameraCalibration``, its lens by the names of OpenCV's models where it is one."""
    names = LENS_MODELS[camera.lens].wire_names
    model, count = next(name for name in names if name[0] and name[1] >= len(camera.distortion))
    coefficients = camera.distortion + (0.0,) * (count - len(camera.distortion))
    matrix = (camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0)
    message = CameraCalibration(
        timestamp=_timestamp(stamp_ns),
        frame_id=camera.name,
        width=camera.width_px,
        height=camera.height_px,
        distortion_model=model,
        D=coefficients,
        K=matrix,
        R=np.eye(3).ravel(),
        P=(*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0),
    )
    return bytes(message.SerializeToString())


def location_fixes(poses: PoseBatch, frame: str) -> list[bytes]:
    """Places of the camera as ``foxglove.LocationFix``, altitude above mean sea level, NaN where it is not known."""
    places_deg, alt_msl_m = np.degrees(poses.lat_lon_alt[:, :2]), poses.lat_lon_alt[:, 2]
    covs = poses.pose.cov[:, :3, :3].reshape(-1, 9)
    columns = (poses.stamp_ns, *places_deg.T, alt_msl_m, covs, poses.has_pose)
    fixes = []
    for stamp_ns, lat_deg, lon_deg, altitude_m, cov_m2, has_pose in zip(*map(np.ndarray.tolist, columns), strict=True):
        message = LocationFix(
            timestamp=_timestamp(stamp_ns), frame_id=frame, latitude=lat_deg, longitude=lon_deg, altitude=altitude_m
        )
        if has_pose:
            message.position_covariance.extend(cov_m2)
            message.position_covariance_type = LocationFix.KNOWN
        fixes.append(bytes(message.SerializeToString()))
    return fixes


def _timestamp(stamp_ns: int) -> Timestamp:
    return Timestamp(seconds=stamp_ns // 1_000_000_000, nanos=stamp_ns % 1_000_000_000)
