"""A recording: a folder of MCAP segments with the configuration that it was made with, or one file with all of it."""

import heapq
import logging
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Final

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo

from aerodft.adapters.files import looks_like
from aerodft.adapters.recording import Channel, ChannelMessage
from aerodft.adapters.recording.read import (
    ChannelFilter,
    ChunkTable,
    Gap,
    Ownership,
    SegmentScan,
    scan_segment,
    unique_segments,
)
from aerodft.adapters.recording.write import CopiedSegment, image_sequence
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.adapters.wire.events import IMAGE_SCHEMA, decode_image
from aerodft.adapters.wire.measurement import MEASUREMENT_SCHEMA, MEASUREMENTS_SCHEMA, split_measurements
from aerodft.adapters.wire.pose import POSE_SCHEMA, decode_pose
from aerodft.adapters.wire.schemas import SCHEMAS
from aerodft.adapters.wire.status import STATUS_SCHEMA, unmeasured_of
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, NoAnswerError, located, os_errors_as
from aerodft.model import Image, PoseSample, StampClock, WireProtocol
from aerodft.version import SOFTWARE
from replay.recordings.segments import is_mcap, message_tables, messages_of, segment_order

_MOST_UNSYNCED_NS: Final = 2 * SECOND_NS  # a power cut costs one series so much more than another
_SHOWN = 3
_MOST_TEXT_BYTES = 4 << 20  # as of one that a file carries
_OWN = "aerodft."
JPEG_SCHEMA = str(CompressedImage.DESCRIPTOR.full_name)
VIDEO_SCHEMA = str(CompressedVideo.DESCRIPTOR.full_name)
ENCODED_IMAGE_SCHEMAS = frozenset({JPEG_SCHEMA, VIDEO_SCHEMA})
_MEASURED = frozenset({MEASUREMENT_SCHEMA, MEASUREMENTS_SCHEMA})

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """Known losses of a recording; of one that was recovered, those after that.

    Attributes:
        damaged_chunks: Chunks that were met and are damaged.
        missing_segments: Segments whose number is missing, or in whose place is another recording's.
        damaged_messages: Messages that were met and cannot be decoded.
        gaps: When something is missing, in order of time.
    """

    damaged_chunks: int = 0
    missing_segments: int = 0
    damaged_messages: int = 0
    gaps: tuple[Gap, ...] = ()

    @classmethod
    def joined(cls, parts: Iterable["LeftOut"]) -> "LeftOut":
        """Sums of what several recordings lack."""
        found = list(parts)
        return cls(
            damaged_chunks=sum(each.damaged_chunks for each in found),
            missing_segments=sum(each.missing_segments for each in found),
            damaged_messages=sum(each.damaged_messages for each in found),
            gaps=tuple(gap for each in found for gap in each.gaps),
        )

    def __bool__(self) -> bool:
        return bool(self.damaged_chunks or self.missing_segments or self.damaged_messages or self.gaps)

    @property
    def sentence(self) -> str:
        """Sentence on data that could not be read; empty where all could."""
        counts = {
            "damaged chunk": self.damaged_chunks,
            "missing segment": self.missing_segments,
            "damaged message": self.damaged_messages,
        }
        found = [f"{count} {what}{'s' * (count > 1)}" for what, count in counts.items() if count]
        times = [gap for gap in self.gaps if gap.from_ns is not None or gap.to_ns is not None]
        if times:
            more = f" and {len(times) - _SHOWN} more spans" if len(times) > _SHOWN else ""
            found.append(f"what was between {', '.join(map(_span, times[:_SHOWN]))}{more}")
        elif self.gaps and not found:
            found.append("what nobody knows the time of")
        return f"the recording is not whole, and so is what came of it: without {' and '.join(found)}" if found else ""

    def document(self) -> dict[str, object]:
        """Counts and times for a JSON document; stamps as decimal strings."""
        return {
            "damaged_chunks": self.damaged_chunks,
            "missing_segments": self.missing_segments,
            "damaged_messages": self.damaged_messages,
            "gaps": [
                {
                    "from_ns": None if gap.from_ns is None else str(gap.from_ns),
                    "to_ns": None if gap.to_ns is None else str(gap.to_ns),
                    "messages": gap.messages,
                }
                for gap in self.gaps
            ],
        }


def _span(gap: Gap) -> str:
    begin = "the beginning" if gap.from_ns is None else unix_ns_to_iso(gap.from_ns)
    end = "the end" if gap.to_ns is None else unix_ns_to_iso(gap.to_ns)
    return f"{begin} and {end}"


class Recording:
    """A recording, open for reading; holds no file open.

    Attributes:
        folder: Where it is: a folder, or a file.
        station: The station that made it.
        data: Its data segments, in order.
        images: Its image segments, in order; empty where there are none.
        start_ns: Earliest log time.
        end_ns: Latest log time.
        is_whole: Whether every segment was finished; else a recorder was killed and the end may be missing.
        damaged_messages: Messages that whoever read them could not decode, so far.

    Args:
        folder: The recording's folder; or one of its files, or one file that they were put together in.

    Raises:
        InputError: There is no recording there, or it cannot be read.
        NoAnswerError: It holds nothing.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._is_file = folder.is_file()
        if self._is_file and not is_mcap(folder):
            expected = "a recording's folder, or an MCAP file"
            raise InputError("there is no recording", where=folder, got=looks_like(folder), expected=expected)
        self.damaged_messages = 0
        self._ownership = Ownership(own=None, owners={})
        self._missing = {"data": 0, "images": 0}
        self._between: dict[str, list[Gap]] = {"data": [], "images": []}
        self.data = (scan_segment(folder),) if self._is_file else self._segments("data")
        self.images = self.data if self._is_file else self._segments("images")
        chunks = [chunk for segment in self.data for chunk in segment.chunks]
        if not chunks:
            raise NoAnswerError("the recording holds nothing", where=folder)
        self.station = next((segment.station for segment in self.data if segment.station), "")
        if not self._is_file:
            self._order_segments()
            self._between = self._find_gaps()
            chunks = [chunk for segment in self.data for chunk in segment.chunks]
        self.start_ns = min(chunk.start_ns for chunk in chunks)
        self.end_ns = max(chunk.end_ns for chunk in chunks)
        self.is_whole = all(segment.is_whole for segment in (*self.data, *self.images))
        if not self.is_whole:
            _log.warning("%s: was not finished; read as far as it is whole", folder)
        self._checked_schemas: set[str] = set()
        for schema in sorted({one.schema for each in self.data for one in each.channels.by_id.values()}):
            self._check_schema(schema)

    def _segments(self, stem: str) -> tuple[SegmentScan, ...]:
        return unique_segments([scan_segment(path) for path in _segment_paths(self.folder, stem)])

    def _check_schema(self, schema: str) -> None:
        """Warn once of payloads whose schema this version does not have: a newer one's, or damage."""
        self._checked_schemas.add(schema)
        if schema.startswith(_OWN) and schema not in SCHEMAS:
            _log.warning("%s: %s is unknown to %s, and left out: a newer version's?", self.folder, schema, SOFTWARE)

    def _order_segments(self) -> None:
        """Leave out segments of other recordings, put the rest into the order of recording, and name missing ones."""
        self._ownership = owners = Ownership.of(self.data, self.images)

        def own_of(segments: Sequence[SegmentScan], *, is_image: bool) -> tuple[SegmentScan, ...]:
            found = [each for each in segments if not owners.is_foreign(each, is_image=is_image)]
            for path in (each.path for each in segments if each not in found):
                owner = owners.owners[path]
                _log.warning("%s: belongs to recording %s, not to %s; it is left out", path, owner, owners.own)
            return _with_sized_gaps(owners.arrange(found))

        self.data, self.images = own_of(self.data, is_image=False), own_of(self.images, is_image=True)
        self._missing = {
            "data": _count_missing(self.folder, "data", self.data),
            "images": _count_missing(self.folder, "images", self.images, owners.min_images),
        }

    def _find_gaps(self) -> dict[str, list[Gap]]:
        """Proven gaps between and behind the segments, by series."""
        runs = list(self._ownership.runs(self.images))
        own = {each.recording for each in self.data}  # copied images were finished, or not, by another recorder
        images_closed = _was_closed([each for run in runs for each in run if each.recording in own])
        data_closed = _was_closed(self.data)
        after_images = []
        for run in runs:
            copy = self._ownership.copy_at(run[-1].number)
            messages = None if copy is None else copy.messages
            others = self.data if data_closed else ()
            after_images += _gap_at_end(run, others, others_closed=data_closed, messages=messages)
        return {
            "data": _gaps_between(self.data) + _gap_at_end(self.data, self.images, others_closed=images_closed),
            "images": _gaps_between(self.images) + after_images,
        }

    def copy_of(self, segment: SegmentScan) -> CopiedSegment:
        """What a recomputed recording has to know of an image segment that it copies."""
        recording = self._ownership.owner_of(segment)
        return CopiedSegment(recording=recording, chunks=len(segment.chunks), messages=segment.messages)

    @cached_property
    def zero_ns(self) -> int:
        """Zero of people's seconds: the stamp of the first image, without images the earliest log time.

        Raises:
            InputError: The image's record is damaged.
        """
        first = next(self.messages(wanted=lambda each: each.schema == IMAGE_SCHEMA), None)
        if first is None:
            return self.start_ns
        with located(self.folder):
            return decode_image(first.data).stamp_ns

    @cached_property
    def zero_utc_ns(self) -> int:
        """Zero of people's seconds for what is stamped in UTC: the first image by its pose, else ``zero_ns``.

        Raises:
            InputError: The pose's record is damaged.
        """
        first = next(_poses(self, None, None), None)
        if first is None:
            return self.zero_ns
        with located(self.folder):
            return decode_pose(first.data).stamp_ns

    @cached_property
    def unmeasured(self) -> dict[str, int]:
        """Images that came and were never measured, by cause, as the last statuses of the recording say."""
        found: dict[str, int] = {}
        recent = self.messages(from_ns=self.end_ns - _LATEST_NS, wanted=lambda each: each.schema == STATUS_SCHEMA)
        for message in recent:
            with suppress(InputError):  # a newer version's
                found |= unmeasured_of(message.data)
        return found

    def left_out(self, *, images: bool = False) -> LeftOut:
        """Known losses of the data so far; where asked, of the images too."""
        series = (self.data, self.images) if images and self.images is not self.data else (self.data,)
        segments = [segment for each in series for segment in each]
        stems = ("data", "images") if images else ("data",)
        gaps = [gap for each in series for gap in _gaps_within(each)]
        gaps += [gap for stem in stems for gap in self._between[stem]]
        return LeftOut(
            damaged_chunks=sum(each.damaged_chunks for each in segments),
            missing_segments=sum(self._missing[stem] for stem in stems),
            damaged_messages=self.damaged_messages,
            gaps=tuple(sorted(gaps, key=lambda gap: gap.from_ns or 0)),
        )

    def text(self, name: str) -> str | None:
        """A file beside the segments (``config.toml`` and the like); None where there is none.

        Raises:
            InputError: It cannot be read.
        """
        path = self.folder / name
        try:
            if not path.is_file():
                return self.data[0].texts.get(name)
            with path.open("rb") as file:
                data = file.read(_MOST_TEXT_BYTES + 1)
            if len(data) > _MOST_TEXT_BYTES:
                raise InputError(f"a configuration of more than {_MOST_TEXT_BYTES >> 20} MB", where=path)
            return data.decode()
        except (OSError, UnicodeDecodeError) as error:
            raise InputError("the file cannot be read", where=path, got=error) from error

    def messages(
        self, *, from_ns: int | None = None, to_ns: int | None = None, wanted: ChannelFilter | None = None
    ) -> Iterator[ChannelMessage]:
        """The messages of the data segments as they were written, log times in ``[from_ns, to_ns)``.

        Args:
            from_ns: None for the start.
            to_ns: None for the end.
            wanted: Whose messages; None for everybody's.
        """

        def is_data(channel: Channel) -> bool:
            if channel.schema not in self._checked_schemas:  # a file without an index tells its channels as it is read
                self._check_schema(channel.schema)
            return channel.schema not in ENCODED_IMAGE_SCHEMAS and (wanted is None or wanted(channel))

        is_looked_at = self._is_file or not all(segment.is_indexed for segment in self.data)
        return messages_of(self.data, from_ns=from_ns, to_ns=to_ns, wanted=is_data if is_looked_at else wanted)

    def tables(self, wanted: ChannelFilter) -> Iterator[ChunkTable]:
        """``messages`` as columns, a chunk's at a time."""
        return message_tables(self.data, wanted)

    def image_messages(self, *, from_ns: int | None = None, to_ns: int | None = None) -> Iterator[ChannelMessage]:
        """The images and video packets of the image segments, log times in ``[from_ns, to_ns)``."""
        return messages_of(
            self.images,
            from_ns=from_ns,
            to_ns=to_ns,
            wanted=lambda channel: channel.schema in ENCODED_IMAGE_SCHEMAS,
        )

    @property
    def name(self) -> str:
        """The recording's path, for messages."""
        return str(self.folder)

    def is_step(self, channel: Channel) -> bool:
        """Whether a channel's messages begin a step of a replay: images' stamps do."""
        return channel.schema == IMAGE_SCHEMA

    def holds_mavlink(self, channel: Channel) -> bool:
        """Whether a channel has MAVLink frames."""
        return channel.encoding == WireProtocol.MAVLINK

    def by_time(self, from_ns: int | None, to_ns: int | None, wanted: ChannelFilter) -> Iterator[ChannelMessage]:
        """Data and images of log times in ``[from_ns, to_ns)``; a picture comes after its image's stamps."""
        data = self.messages(from_ns=from_ns, to_ns=to_ns, wanted=wanted)
        images = filter(lambda message: wanted(message.channel), self.image_messages(from_ns=from_ns, to_ns=to_ns))
        return heapq.merge(data, images, key=lambda message: message.log_ns)

    def measurements(self, *, from_ns: int | None = None, to_ns: int | None = None) -> Iterator[bytes]:
        """The payloads of all measurements, in the order in which they were made; of log times in ``[from_ns, to_ns)``.

        Raises:
            InputError: Some of them cannot be told apart.
        """
        for message in self.messages(from_ns=from_ns, to_ns=to_ns, wanted=lambda each: each.schema in _MEASURED):
            if message.channel.schema == MEASUREMENT_SCHEMA:
                yield message.data
            else:
                with located(self.folder):
                    payloads = split_measurements(message.data)
                yield from (payload for _, payload in payloads)


def _gaps_within(segments: Sequence[SegmentScan]) -> Iterator[Gap]:
    """Proven gaps of the segments of one series; those at a segment's start or end reach to the neighbour there."""
    held = [segment for segment in segments if segment.chunks]
    for before, segment, after in zip([None, *held], held, [*held[1:], None], strict=False):
        for gap in segment.all_gaps():
            from_ns = before.end_ns if gap.from_ns is None and before is not None else gap.from_ns
            to_ns = after.start_ns if gap.to_ns is None and after is not None else gap.to_ns
            yield replace(gap, from_ns=from_ns, to_ns=to_ns)


def _missing(segment: SegmentScan, following: SegmentScan) -> tuple[int, int] | None:
    """Chunks and messages that a segment lacks, besides those that it knows of itself; None where no count says it."""
    if segment.is_recovered or segment.before is None or following.before is None:
        return None
    if not _is_next(segment, following):
        return None
    chunks, messages = (
        after - before for after, before in zip(segment.after or following.before, segment.before, strict=True)
    )
    chunks -= len(segment.chunks) + sum(gap.chunks or 0 for gap in segment.gaps)
    return chunks, messages - (segment.messages or 0) - sum(gap.messages or 0 for gap in segment.gaps)


def _with_sized_gaps(segments: Sequence[SegmentScan]) -> tuple[SegmentScan, ...]:
    """The segments of a series, gaps in which nobody knows how much is missing left out where counts say nothing is."""
    found = list(segments)
    for place, (segment, following) in enumerate(pairwise(segments)):
        unknown = [gap for gap in segment.gaps if gap.chunks is None]
        missing = _missing(segment, following) if unknown else None
        if missing is not None and (missing[0] <= 0 or len(unknown) == 1):
            sized = [replace(gap, chunks=missing[0], messages=missing[1]) for gap in unknown if missing[0] > 0]
            known = [gap for gap in segment.gaps if gap.chunks is not None]
            found[place] = replace(segment, gaps=(*known, *sized))
    return tuple(found)


def _gaps_between(segments: Sequence[SegmentScan]) -> list[Gap]:
    """Proven gaps between segments of one series, in order, by what they and their neighbours count."""
    gaps = []
    if segments and segments[0].number == 0 and (lost := _lost_at_start((0, 0), segments[0])) is not None:
        gaps.append(Gap(from_ns=None, to_ns=segments[0].start_ns, chunks=lost[0], messages=lost[1]))
    for segment, following in pairwise(segments):
        if not _is_next(segment, following):
            continue  # what is missing is named
        start_ns = next((each.start_ns for each in segments[segments.index(following) :] if each.chunks), None)
        if (lost := _lost_at_start(segment.after, following)) is not None:
            gaps.append(Gap(from_ns=segment.end_ns, to_ns=start_ns, chunks=lost[0], messages=lost[1]))
        if segment.is_recovered:  # what it lost was said
            continue
        missing = _missing(segment, following)
        if missing is None:
            if not segment.has_end:
                gaps.append(Gap(from_ns=segment.end_ns, to_ns=start_ns))
        elif min(missing) > 0 and not any(gap.chunks is None for gap in segment.gaps):  # else a count is damaged
            gaps.append(Gap(from_ns=segment.end_ns, to_ns=start_ns, chunks=missing[0], messages=missing[1]))
    return gaps


def _was_closed(segments: Sequence[SegmentScan]) -> bool:
    """Whether a series was finished, which its recorder does with both."""
    return bool(segments) and segments[-1].has_end and segments[-1].after is None


def _gap_at_end(
    segments: Sequence[SegmentScan],
    others: Sequence[SegmentScan],
    *,
    others_closed: bool,
    messages: int | None = None,
) -> list[Gap]:
    """The proven gap behind the last segment of a series; one at most.

    Args:
        segments: The series.
        others: The series that was recorded beside it.
        others_closed: Whether that one was finished.
        messages: How many messages the last segment is known to have held; None where the other series tells it.
    """
    if not segments or (segments[-1].after is None and (segments[-1].has_end or segments[-1].is_recovered)):
        return []
    end_ns = max((each.end_ns for each in segments if each.end_ns is not None), default=None)
    if segments[-1].after is not None:
        return [Gap(from_ns=end_ns, to_ns=None)]
    if messages is not None:
        lost = messages - (segments[-1].messages or 0) - sum(gap.messages or 0 for gap in segments[-1].gaps)
        return [Gap(from_ns=end_ns, to_ns=None, messages=lost)] if lost > 0 else []
    others_ns = max((each.end_ns for each in others if each.end_ns is not None), default=0)
    if others_closed or others_ns > (end_ns or 0) + _MOST_UNSYNCED_NS:
        return [Gap(from_ns=end_ns, to_ns=others_ns if others_closed and others_ns > (end_ns or 0) else None)]
    return []


def _lost_at_start(counted: tuple[int, int] | None, following: SegmentScan) -> tuple[int, int] | None:
    """Chunks and messages that a segment lacks at its start, before which so many were; None where nobody knows."""
    is_said = following.is_recovered or any(gap.from_ns is None for gap in following.gaps)
    if is_said or counted is None or following.before is None:
        return None
    chunks, messages = (held - before for held, before in zip(following.before, counted, strict=True))
    return (chunks, messages) if min(chunks, messages) > 0 else None  # every chunk holds messages


def _is_next(segment: SegmentScan, following: SegmentScan) -> bool:
    """Whether a segment has the next number, and not another recording's id: images of several may be copied."""
    ids = {segment.recording, following.recording} - {None}
    return segment.number is not None and following.number == segment.number + 1 and len(ids) <= 1


def _segment_paths(folder: Path, stem: str) -> list[Path]:
    """The segments of a series, in order."""
    if not folder.is_dir():
        if not folder.exists():
            raise InputError("no such file or folder", where=folder)
        raise InputError("there is no recording", where=folder, got="a file", expected="a folder with data_000.mcap")
    with os_errors_as("the recording cannot be read", where=folder):
        entries = list(folder.iterdir())
    paths = sorted((path for path in entries if path.match(f"{stem}_*.mcap")), key=segment_order)
    if not paths and stem == "data":
        found = entries[0].name if entries else None
        raise InputError(
            "there is no recording",
            where=folder,
            got=f"{found} and no data_*.mcap" if found else "an empty folder",
            expected="a folder with data_000.mcap",
        )
    return paths


def _count_missing(folder: Path, stem: str, segments: Sequence[SegmentScan], expected: int = 0) -> int:
    """Warn of numbers that are left out: a segment was lost or not copied; returns how many.

    Args:
        folder: The recording.
        stem: Name of the series.
        segments: What there is of it.
        expected: How many segments there are at least, where that is known.
    """
    numbers = {each.number for each in segments if each.number is not None}
    gone = sorted(set(range(max(expected, max(numbers, default=-1) + 1))) - numbers)
    if gone:
        shown = ", ".join(f"{stem}_{number:03d}.mcap" for number in gone[:_SHOWN])
        more = f" and {len(gone) - _SHOWN} more" if len(gone) > _SHOWN else ""
        _log.warning("%s: without %s%s; read as far as it is there", folder, shown, more)
    return len(gone)


_LATEST_NS: Final = 30 * SECOND_NS
"""A pose is recorded at most so long after its image came: longer than any station waits for telemetry."""

_USUAL_NS: Final = 3 * SECOND_NS
"""What is measured in an image is recorded so soon, but for what waits longest for telemetry."""


def pose_of(recording: Recording, image: Image) -> PoseSample | None:
    """The pose of a recorded image; None where none was recorded.

    Raises:
        InputError: It is damaged.
    """
    from_ns, sequence = image.arrival_ns, image_sequence(image.index)
    for message in _poses(recording, from_ns, from_ns + _LATEST_NS):
        if message.sequence == sequence:
            with located(recording.folder):
                sample = decode_pose(message.data)
            if image.clock is not StampClock.UTC or sample.stamp_ns == image.stamp_ns:
                return sample
    return None


def pose_at(recording: Recording, stamp_ns: int) -> PoseSample | None:
    """The pose that was recorded with a stamp (UTC); None where there is none.

    Raises:
        InputError: It is damaged.
    """
    stamp = f'"{stamp_ns}"'.encode()
    for message in _poses(recording, None, None):
        if stamp in message.data:
            with located(recording.folder):
                sample = decode_pose(message.data)
            if sample.stamp_ns == stamp_ns:
                return sample
    return None


def measurements_of(recording: Recording, image: Image) -> Iterator[bytes]:
    """The recorded measurements of an image, as ``aerodft.measurement/1``, those of a probe that came later too.

    Raises:
        InputError: One is damaged.
    """
    from_ns, own = image.arrival_ns, b'"image":%d,' % image.index
    for payload in recording.measurements(from_ns=from_ns, to_ns=from_ns + _USUAL_NS):
        if own in payload:
            yield payload


def _poses(recording: Recording, from_ns: int | None, to_ns: int | None) -> Iterator[ChannelMessage]:
    return recording.messages(from_ns=from_ns, to_ns=to_ns, wanted=lambda channel: channel.schema == POSE_SCHEMA)
