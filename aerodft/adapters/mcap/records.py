"""Inputs and outputs as the messages of a recording's data file."""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix

from aerodft.adapters.codec import estimate, events, height, measurement, pose, status, steadiness
from aerodft.adapters.codec.keys import Keys
from aerodft.adapters.codec.pose_encoder import PoseEncoder
from aerodft.adapters.mcap.channels import Channel, json_channel, protobuf_channel, raw_channel
from aerodft.adapters.mcap.foxglove import location_fix
from aerodft.adapters.mcap.message_rows import MessageRows
from aerodft.adapters.texts import Texts
from aerodft.conventions import SECOND_NS
from aerodft.dft.answers import ImageAnswers
from aerodft.model.arrays import IntArray
from aerodft.model.batch import Batch
from aerodft.model.estimate import CalibrationEstimate
from aerodft.model.height import HeightSwitch
from aerodft.model.pose_columns import POSED, Posed
from aerodft.model.steadiness import SteadinessEstimate
from aerodft.model.telemetry import RawBlock, WireProtocol
from aerodft.service.feed import joined_blocks
from aerodft.service.ports import Output

_FIX_PERIOD_NS = SECOND_NS // 5
_SEQUENCE_MASK = 0xFFFFFFFF


class Record(NamedTuple):
    """One message to be written."""

    log_ns: int
    channel: Channel
    data: bytes
    sequence: int = 0


def image_sequence(index: int) -> int:
    """The message sequence of an image's stamps and of its JPEG, by which the two find each other."""
    return index & _SEQUENCE_MASK


class Outputs(NamedTuple):
    """What was made on one tick."""

    now_ns: int
    items: tuple[Output, ...]


_Head = tuple[int, int, int, int, int]  # work, log time, order, channel, sequence
_Part = tuple[IntArray, Texts]  # heads (5, n) and payloads
Work: TypeAlias = Batch | Outputs | status.StationStatus


class Records:
    """Makes records; remembers the channels of senders and observed probes. Used by one thread."""

    def __init__(self, keys: Keys, frame: str) -> None:
        self._keys = keys
        self._frame = frame
        self._senders: dict[tuple[WireProtocol, str], Channel] = {}
        self._observed: dict[str, Channel] = {}
        self._measured = json_channel(keys.measurements, measurement.IMAGE_SCHEMA)
        self._image = json_channel(keys.image, events.IMAGE_SCHEMA)
        self._pose = json_channel(keys.pose, pose.SCHEMA)
        self._calibration = json_channel(keys.calibration, estimate.SCHEMA)
        self._steadiness = json_channel(keys.steadiness, steadiness.SCHEMA)
        self._height = json_channel(keys.height, height.SCHEMA)
        self._status = json_channel(keys.status, status.SCHEMA)
        self._location = protobuf_channel(keys.location, LocationFix)
        self._poses = PoseEncoder()
        self._measurements = measurement.MeasurementEncoder(self._poses)
        self._fixed_ns = 0

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels that every data file has from the start."""
        return self._image, self._pose, self._measured, self._status, self._location

    def of(self, works: Sequence[Work]) -> MessageRows:
        """The messages of some ticks' inputs and outputs, in their order; poses and answers are written together.

        Inputs of a tick come in order of arrival, then its outputs.
        """
        rows = _Rows()
        self._add_frames(rows, works)
        for number, work in enumerate(works):
            if isinstance(work, Batch):
                self._add_inputs(rows, number, work)
            elif isinstance(work, Outputs):
                for item in work.items:
                    self._add_output(rows, number, work.now_ns, item)
            else:
                rows.add(number, self.of_status(work))
        return rows.made(self._poses.encode(rows.poses), self._measurements.images(rows.answers))

    def of_status(self, value: status.StationStatus) -> Record:
        """A station's state."""
        return Record(value.stamp_ns, self._status, status.encode_status(value))

    def _add_frames(self, rows: "_Rows", works: Sequence[Work]) -> None:
        """Raw telemetry, by sender."""
        senders: dict[tuple[WireProtocol, str], list[tuple[int, RawBlock]]] = {}
        for number, work in enumerate(works):
            if isinstance(work, Batch):
                for block in work.raw:
                    senders.setdefault((block.protocol, block.sender), []).append((number, block))
        for sender, numbered in senders.items():
            channel = self._senders.get(sender)
            if channel is None:
                channel = self._senders[sender] = raw_channel(*sender)
            rows.add_frames(channel, numbered)

    def _add_inputs(self, rows: "_Rows", number: int, batch: Batch) -> None:
        for image in batch.images:
            data = events.encode_image(image)
            rows.add(number, Record(image.arrival_ns, self._image, data, image_sequence(image.index)))
        for seen in batch.observations:
            channel = self._observed.get(seen.name)
            if channel is None:
                channel = json_channel(self._keys.observation(seen.name), events.OBSERVATION_SCHEMA)
                self._observed[seen.name] = channel
            rows.add(number, Record(seen.arrival_ns, channel, events.encode_observation(seen)))

    def _add_output(self, rows: "_Rows", number: int, now_ns: int, item: Output) -> None:
        if isinstance(item, ImageAnswers):
            rows.add_answers(number, now_ns, self._measured, item)
        elif isinstance(item, POSED):
            rows.add_pose(number, now_ns, self._pose, item)
            self._add_fix(rows, number, now_ns, item)
        elif isinstance(item, HeightSwitch):
            rows.add(number, Record(now_ns, self._height, height.encode_height_switch(item)))
        elif isinstance(item, SteadinessEstimate):
            rows.add(number, Record(now_ns, self._steadiness, steadiness.encode_steadiness(item)))
        elif isinstance(item, CalibrationEstimate):
            rows.add(number, Record(now_ns, self._calibration, estimate.encode_estimate(item)))

    def _add_fix(self, rows: "_Rows", number: int, now_ns: int, posed: Posed) -> None:
        """A few times a second a position for maps."""
        if abs(now_ns - self._fixed_ns) < _FIX_PERIOD_NS:
            return
        fix = location_fix(posed, self._frame)
        if fix is not None:
            self._fixed_ns = now_ns
            rows.add(number, Record(now_ns, self._location, fix))


class _Rows:
    """Messages of some works, in any order."""

    def __init__(self) -> None:
        self.poses: list[Posed] = []
        self.answers: list[ImageAnswers] = []
        self._numbers: dict[int, int] = {}  # of channels, by identity
        self._channels: list[Channel] = []
        self._frames: list[_Part] = []
        self._texts: list[bytes] = []
        self._heads: tuple[list[_Head], list[_Head], list[_Head]] = ([], [], [])  # of texts, poses, answers
        self._count = 0

    def add(self, work: int, record: Record) -> None:
        """Add one of a work."""
        self._head(0, work, record.log_ns, record.channel, record.sequence)
        self._texts.append(record.data)

    def add_pose(self, work: int, log_ns: int, channel: Channel, posed: Posed) -> None:
        """Add one that is yet to be written."""
        self._head(1, work, log_ns, channel, 0)
        self.poses.append(posed)

    def add_answers(self, work: int, log_ns: int, channel: Channel, image: ImageAnswers) -> None:
        """Likewise."""
        self._head(2, work, log_ns, channel, 0)
        self.answers.append(image)

    def add_frames(self, channel: Channel, numbered: Sequence[tuple[int, RawBlock]]) -> None:
        """Add the frames of one sender, by the works that they came in."""
        works, blocks = zip(*numbered, strict=True)
        block = joined_blocks(list(blocks))
        work = np.repeat(works, [len(each.length) for each in blocks])
        same = np.zeros(len(work), dtype=np.int64)
        heads = np.stack([work, block.arrival_ns, same, same + self._number(channel), same])
        self._frames.append((heads, Texts(block.data, block.offset, block.offset + block.length)))

    def made(self, poses: Texts, answers: Texts) -> MessageRows:
        """All messages in their order, with what poses and answers come to."""
        parts = [
            (np.array(each, dtype=np.int64).reshape(-1, 5).T, texts)
            for each, texts in zip(self._heads, (Texts.of(self._texts), poses, answers), strict=True)
        ]
        heads = np.concatenate([head for head, _ in (*self._frames, *parts)], axis=1)
        order = np.lexsort((heads[2], heads[1], heads[0]))
        texts = Texts.joined([texts for _, texts in (*self._frames, *parts)], order)
        _, log_ns, _, channel, sequence = heads[:, order]
        return MessageRows(tuple(self._channels), channel, log_ns, sequence, texts)

    def _head(self, part: int, work: int, log_ns: int, channel: Channel, sequence: int) -> None:
        self._count += 1
        self._heads[part].append((work, log_ns, self._count, self._number(channel), sequence))

    def _number(self, channel: Channel) -> int:
        number = self._numbers.get(id(channel))
        if number is None:
            number = self._numbers[id(channel)] = len(self._channels)
            self._channels.append(channel)
        return number
