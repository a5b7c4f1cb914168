"""Inputs and outputs as the messages of a recording's data file."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeAlias

from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix

from aerodft.adapters.codec import estimate, events, height, measurement, pose, status, steadiness
from aerodft.adapters.codec.keys import Keys
from aerodft.adapters.mcap.channels import Channel, json_channel, protobuf_channel, raw_channel
from aerodft.adapters.mcap.foxglove import location_fix
from aerodft.conventions import SECOND_NS
from aerodft.dft.answers import ImageAnswers
from aerodft.model.batch import Batch
from aerodft.model.estimate import CalibrationEstimate
from aerodft.model.height import HeightSwitch
from aerodft.model.pose import PoseSample
from aerodft.model.steadiness import SteadinessEstimate
from aerodft.model.telemetry import RawBlock, WireProtocol
from aerodft.service.ports import Estimate, Output

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
        self._poses = pose.PoseEncoder()
        self._measurements = measurement.MeasurementEncoder(self._poses)
        self._fixed_ns = 0

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels that every data file has from the start."""
        return self._image, self._pose, self._measured, self._status, self._location

    def of_inputs(self, batch: Batch) -> list[Record]:
        """All inputs of a tick, in order of arrival."""
        records = [record for block in batch.raw for record in self._frames(block)]
        for image in batch.images:
            data = events.encode_image(image)
            records.append(Record(image.arrival_ns, self._image, data, image_sequence(image.index)))
        for seen in batch.observations:
            channel = self._observed.get(seen.name)
            if channel is None:
                channel = json_channel(self._keys.observation(seen.name), events.OBSERVATION_SCHEMA)
                self._observed[seen.name] = channel
            records.append(Record(seen.arrival_ns, channel, events.encode_observation(seen)))
        records.sort(key=lambda record: record.log_ns)
        return records

    def of(self, works: Sequence[Work]) -> Iterator[Record]:
        """All records of some ticks' inputs and outputs, in their order; poses and answers are written together."""
        items = [item for work in works if isinstance(work, Outputs) for item in work.items]
        poses = iter(self._poses.encode([item for item in items if isinstance(item, PoseSample)]))
        answers = iter(self._measurements.images([item for item in items if isinstance(item, ImageAnswers)]))
        for work in works:
            if isinstance(work, Batch):
                yield from self.of_inputs(work)
            elif isinstance(work, Outputs):
                for item in work.items:
                    if isinstance(item, ImageAnswers):
                        yield Record(work.now_ns, self._measured, next(answers))
                    elif isinstance(item, PoseSample):
                        yield Record(work.now_ns, self._pose, next(poses))
                        yield from self._fixes(item, work.now_ns)
                    elif isinstance(item, HeightSwitch):
                        yield self._of_height_switch(item, work.now_ns)
                    elif isinstance(item, Estimate):
                        yield self._of_estimate(item, work.now_ns)
            else:
                yield self.of_status(work)

    def _fixes(self, sample: PoseSample, now_ns: int) -> Iterator[Record]:
        """A few times a second a position for maps."""
        if abs(now_ns - self._fixed_ns) >= _FIX_PERIOD_NS and (fix := location_fix(sample, self._frame)) is not None:
            self._fixed_ns = now_ns
            yield Record(now_ns, self._location, fix)

    def _of_estimate(self, value: CalibrationEstimate | SteadinessEstimate, now_ns: int) -> Record:
        """What a live calibration found, or a watched camera's attitude, at the tick that it was learned on."""
        if isinstance(value, SteadinessEstimate):
            return Record(now_ns, self._steadiness, steadiness.encode_steadiness(value))
        return Record(now_ns, self._calibration, estimate.encode_estimate(value))

    def _of_height_switch(self, value: HeightSwitch, now_ns: int) -> Record:
        """That heights are of another source, at the tick that it was found on."""
        return Record(now_ns, self._height, height.encode_height_switch(value))

    def of_status(self, value: status.StationStatus) -> Record:
        """A station's state."""
        return Record(value.stamp_ns, self._status, status.encode_status(value))

    def _frames(self, block: RawBlock) -> Iterator[Record]:
        sender = (block.protocol, block.sender)
        channel = self._senders.get(sender)
        if channel is None:
            channel = self._senders[sender] = raw_channel(*sender)
        data = block.data
        for arrival_ns, start, size in zip(
            block.arrival_ns.tolist(), block.offset.tolist(), block.length.tolist(), strict=True
        ):
            yield Record(arrival_ns, channel, data[start : start + size])
