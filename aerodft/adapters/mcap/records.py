"""Inputs and outputs as the messages of a recording's data file."""

from collections.abc import Iterator, Sequence
from operator import itemgetter
from typing import NamedTuple, TypeAlias

import numpy as np
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix

from aerodft.adapters.codec import estimate, events, height, measurement, pose, status, steadiness
from aerodft.adapters.codec.keys import Keys
from aerodft.adapters.codec.pose_encoder import PoseEncoder
from aerodft.adapters.mcap.channels import Channel, json_channel, protobuf_channel, raw_channel
from aerodft.adapters.mcap.foxglove import location_fix
from aerodft.adapters.mcap.message_rows import MessageRows
from aerodft.adapters.mcap.row_parts import Record, RowParts
from aerodft.adapters.texts import Texts
from aerodft.conventions import SECOND_NS
from aerodft.dft.answers import ImageAnswers
from aerodft.model.arrays import IntArray
from aerodft.model.batch import Batch
from aerodft.model.calibration import CalibrationEstimate, SteadinessEstimate
from aerodft.model.height import HeightSwitch
from aerodft.model.image_rows import image_indices
from aerodft.model.pose_columns import POSED, Posed
from aerodft.service.batches import Batches
from aerodft.service.made import AnsweredImages, Made
from aerodft.service.ports import Output

_FIX_PERIOD_NS = SECOND_NS // 5
_SEQUENCE_MASK = 0xFFFFFFFF
_AT_ONCE = 160  # ticks
_PER_IMAGE = 3  # messages at most: pose, position, answers


def image_sequence(index: int) -> int:
    """The message sequence of an image's stamps and of its JPEG, by which the two find each other."""
    return index & _SEQUENCE_MASK


class Outputs(NamedTuple):
    """What was made on one tick."""

    now_ns: int
    items: tuple[Output, ...]


class Span(NamedTuple):
    """The inputs of some ticks, and what was made on them."""

    batches: Batches
    made: Made

    def parts(self) -> "Iterator[Span]":
        """It, cut into spans of moderate size: a second of messages is some megabytes."""
        for first in range(0, len(self.batches), _AT_ONCE):
            stop = min(first + _AT_ONCE, len(self.batches))
            yield Span(self.batches[first:stop], self.made.between(first, stop))


Tick: TypeAlias = Batch | Outputs | status.StationStatus
Work: TypeAlias = Tick | Span


class Records:
    """Makes records; remembers the channels of senders and observed probes. Used by one thread."""

    def __init__(self, keys: Keys, frame: str) -> None:
        self._keys = keys
        self._frame = frame
        self._senders: dict[tuple[str, str], Channel] = {}
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
        self._image_templates = events.image_templates()
        self._fixed_ns = 0

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels that every data file has from the start."""
        return self._image, self._pose, self._measured, self._status, self._location

    def of(self, works: Sequence[Work]) -> Iterator[MessageRows]:
        """The messages of some ticks' inputs and outputs, in their order; poses and answers are written together.

        Inputs of a tick come in order of arrival, then its outputs.
        """
        ticks: list[Tick] = []
        for work in works:
            if isinstance(work, Span):
                yield self._of_ticks(ticks)
                ticks = []
                yield from map(self._of_span, work.parts())
            else:
                ticks.append(work)
        yield self._of_ticks(ticks)

    def _of_ticks(self, works: Sequence[Tick]) -> MessageRows:
        rows = RowParts()
        came = {number: work for number, work in enumerate(works) if isinstance(work, Batch)}
        self._add_inputs(rows, np.array(list(came)), Batches.of(list(came.values())))
        for number, work in enumerate(works):
            if isinstance(work, Outputs):
                self._add_outputs(rows, number, work)
            elif isinstance(work, status.StationStatus):
                rows.add(number, self.of_status(work))
        return self._made(rows)

    def _of_span(self, span: Span) -> MessageRows:
        """Each tick is two works: what came, and what was made of it."""
        rows = RowParts()
        now_ns = span.batches.now_ns
        self._add_inputs(rows, 2 * np.arange(len(now_ns)), span.batches)
        made: list[tuple[int, Outputs | AnsweredImages]] = [
            (tick, Outputs(int(now_ns[tick]), outputs)) for tick, outputs in span.made.apart.items()
        ]
        made += [(int(images.tick[0]), images) for images in span.made.together]
        for tick, each in sorted(made, key=itemgetter(0)):  # one position in so many seconds is for maps
            if isinstance(each, Outputs):
                self._add_outputs(rows, 2 * tick + 1, each)
            else:
                self._add_together(rows, 2 * each.tick + 1, now_ns[each.tick], each)
        return self._made(rows)

    def _made(self, rows: RowParts) -> MessageRows:
        return rows.made(self._poses.encode(rows.poses), self._measurements.images(rows.answers))

    def of_status(self, value: status.StationStatus) -> Record:
        """A station's state."""
        return Record(value.stamp_ns, self._status, status.encode_status(value))

    def _add_inputs(self, rows: RowParts, works: IntArray, batches: Batches) -> None:
        """What came in ticks that are these works ``(n,)``: frames by sender, the stamps of images, observations."""
        for block in batches.raw:
            sender = (block.protocol, block.sender)
            channel = self._senders.get(sender)
            if channel is None:
                channel = self._senders[sender] = raw_channel(*sender)
            rows.add_frames(channel, works[np.searchsorted(batches.now_ns, block.arrival_ns)], block)
        if batches.images:
            texts = events.encode_images(batches.images, self._image_templates)
            sequence = image_indices(batches.images) & _SEQUENCE_MASK
            log_ns = batches.image_arrival_ns
            rows.add_texts(self._image, works[batches.image_tick], log_ns, texts, sequence=sequence)
        ticks = batches.observation_tick.tolist()
        for tick, seen in zip(ticks, batches.observations, strict=True):
            channel = self._observed.get(seen.name)
            if channel is None:
                channel = json_channel(self._keys.observation(seen.name), events.OBSERVATION_SCHEMA)
                self._observed[seen.name] = channel
            rows.add(int(works[tick]), Record(seen.arrival_ns, channel, events.encode_observation(seen)))

    def _add_outputs(self, rows: RowParts, number: int, work: Outputs) -> None:
        now_ns, items = work
        for item in items:
            if isinstance(item, ImageAnswers):
                rows.add_answers(number, now_ns, self._measured, item)
            elif isinstance(item, POSED):
                rows.add_pose(number, now_ns, self._pose, item)
                fix = self._fix(now_ns, item)
                if fix is not None:
                    rows.add(number, Record(now_ns, self._location, fix))
            elif isinstance(item, HeightSwitch):
                rows.add(number, Record(now_ns, self._height, height.encode_height_switch(item)))
            elif isinstance(item, SteadinessEstimate):
                rows.add(number, Record(now_ns, self._steadiness, steadiness.encode_steadiness(item)))
            elif isinstance(item, CalibrationEstimate):
                rows.add(number, Record(now_ns, self._calibration, estimate.encode_estimate(item)))

    def _add_together(self, rows: RowParts, works: IntArray, now_ns: IntArray, images: AnsweredImages) -> None:
        """The same of many images: of each a pose, now and then a position, and its answers."""
        texts = [(self._pose, self._poses.encode_rows(images.poses))]
        if images.answers is not None:
            texts.append((self._measured, self._measurements.columns(images.answers)))
        first = rows.reserve(_PER_IMAGE * len(works))
        order = np.arange(first, first + _PER_IMAGE * len(works), _PER_IMAGE)
        for number, (channel, own) in enumerate(texts):
            rows.add_texts(channel, works, now_ns, own, order=order + 2 * number)
        fixes: dict[int, bytes] = {}
        row = self._next_due(now_ns, 0)
        while row < len(works):
            fix = self._fix(int(now_ns[row]), images.poses[row])
            if fix is not None:
                fixes[row] = fix
            row = self._next_due(now_ns, row + 1)
        at, found = np.array(list(fixes), dtype=np.int64), Texts.of(list(fixes.values()))
        rows.add_texts(self._location, works[at], now_ns[at], found, order=order[at] + 1)

    def _next_due(self, now_ns: IntArray, first: int) -> int:
        """Which of the ticks ``(n,)``, from the first on, is the next to have a position; behind them: none."""
        if first < len(now_ns) and now_ns[first] <= self._fixed_ns - _FIX_PERIOD_NS:
            return first
        return max(first, int(now_ns.searchsorted(self._fixed_ns + _FIX_PERIOD_NS)))

    def _fix(self, now_ns: int, posed: Posed) -> bytes | None:
        """A few times a second a position for maps."""
        if abs(now_ns - self._fixed_ns) < _FIX_PERIOD_NS:
            return None
        fix = location_fix(posed, self._frame)
        self._fixed_ns = self._fixed_ns if fix is None else now_ns
        return fix
