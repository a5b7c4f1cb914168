"""Telemetry in a video's data track: its packets on the video's time line, and a log of frames stamped in UTC."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import av
import numpy as np

from aerodft.adapters.files import content_looks_like
from aerodft.adapters.telemetry.log_file import rows_that_go_on
from aerodft.adapters.telemetry.mavlink import FrameCounts
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import Event
from aerodft.service import block_of

VIDEO_KINDS: Final = ("an MP4 or MOV video", "an MPEG-TS video", "a Matroska or WebM video")
_UNREADABLE: Final = (av.FFmpegError, ValueError, OverflowError, IndexError)  # PyAV raises them of damaged videos
_LOOKED_AT: Final = 64  # packets of data at a video's beginning that tell whose they are; a track has one a second
_MOST_BYTES: Final = 1 << 28  # of one track: 30 hours of KLV at 30 sets of 80 bytes per second
_BLOCK_FRAMES: Final = 4096
_MOST_SPREAD_S: Final = 1.0  # chosen: asynchronous metadata may come as late as its period, which is at most 1 s
_MAD_TO_STD: Final = 1.4826  # of a normal distribution


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet of a data track.

    Attributes:
        media_ns: Time since the video's first image; None where the packet or the video has none.
        duration_ns: How long it holds; 0 where unknown.
        data: Its bytes.
    """

    media_ns: int | None
    duration_ns: int
    data: bytes


def data_packets(path: Path, is_own: Callable[[bytes], bool], *, most: int | None = None) -> list[Packet]:
    """All packets of the data tracks of which an early packet is of a format; empty where no track is.

    Args:
        path: The video.
        is_own: Whether a packet's bytes are of the format.
        most: So many packets of each track at most; None for all.

    Raises:
        InputError: The video cannot be read, or holds more than is read.
    """
    found: dict[int, list[Packet]] = {}
    owned, size = set[int](), 0
    try:
        with av.open(str(path), metadata_errors="replace") as container:
            tracks = list(container.streams.data)
            video = next(iter(container.streams.video), None)
            zero_s = None if video is None else float((video.start_time or 0) * (video.time_base or 0))
            for packet in container.demux(tracks) if tracks else ():
                if packet.stream.index not in owned and len(found.get(packet.stream.index, ())) >= _LOOKED_AT:
                    if not owned and all(len(found.get(each.index, ())) >= _LOOKED_AT for each in tracks):
                        break
                    continue
                data = bytes(packet)
                if not data:
                    continue
                size += len(data)
                if size > _MOST_BYTES:
                    raise InputError("too much telemetry", where=path, got=f"more than {_MOST_BYTES >> 20} MB")
                if is_own(data):
                    owned.add(packet.stream.index)
                found.setdefault(packet.stream.index, []).append(_packet(packet, data, zero_s))
                if most is not None and sum(map(len, found.values())) >= most:
                    break
    except _UNREADABLE:
        if not owned:
            return []
    return [packet for index in sorted(owned) for packet in found[index]]


def _packet(packet: "av.Packet[Any]", data: bytes, zero_s: float | None) -> Packet:
    base = float(packet.time_base or 0)
    is_timed = packet.pts is not None and zero_s is not None
    media_ns = round(((packet.pts or 0) * base - (zero_s or 0.0)) * SECOND_NS) if is_timed else None
    return Packet(media_ns, round((packet.duration or 0) * base * SECOND_NS), data)


def carries(path: Path, is_own: Callable[[bytes], bool]) -> bool:
    """Whether a data track at a video's beginning is of a format."""
    try:
        return bool(data_packets(path, is_own, most=_LOOKED_AT))
    except InputError:
        return False


def is_video(head: bytes) -> bool:
    """Whether a file begins like a video that may have data tracks."""
    return content_looks_like(head) in VIDEO_KINDS


@dataclass(frozen=True, slots=True)
class StampedFrame:
    """A frame of telemetry: its UTC, its time since the video's first image (None where unknown), its bytes."""

    unix_ns: int
    media_ns: int | None
    data: bytes


class DataTrackLog:
    """A log of frames that a video carries, or a file of such frames; arrival is each frame's UTC.

    Args:
        path: The file.
        protocol: Mark of the format's blocks.
        frames: All frames, at least one, in the order of the file.
        notes: Sentences on what the source does not say, or on damage.
        time_std_s: Standard deviation of the frames' times on the video's time line.

    Attributes:
        path: The file.
    """

    def __init__(
        self, path: Path, protocol: str, frames: Sequence[StampedFrame], notes: Sequence[str], time_std_s: float
    ) -> None:
        self.path, self._protocol, self._notes = path, protocol, list(notes)
        kept = rows_that_go_on([each.unix_ns for each in frames])
        self._frames = [frames[k] for k in kept]
        if len(kept) < len(frames):
            self._notes.append(f"{len(frames) - len(kept)} of {len(frames)} left out: their times do not go on")
        offsets = [each.unix_ns - each.media_ns for each in self._frames if each.media_ns is not None]
        self._offset_ns = sorted(offsets)[len(offsets) // 2] if offsets else None
        apart_s = (np.array(offsets, dtype=np.int64) - (self._offset_ns or 0)) / SECOND_NS
        self._spread_s = float(np.ptp(np.percentile(apart_s, [2, 98]))) if offsets else 0.0
        self._time_std_s = float(np.hypot(time_std_s, _MAD_TO_STD * np.median(np.abs(apart_s)) if offsets else 0.0))

    @property
    def counts(self) -> FrameCounts:
        """Counts of the frames."""
        return FrameCounts(frames=len(self._frames))

    @property
    def start_ns(self) -> int | None:
        """UTC of the video's first image; None of a file without one.

        Raises:
            InputError: The frames' UTC does not keep to the video's time line.
        """
        if self._spread_s > _MOST_SPREAD_S:
            raise InputError(
                "telemetry does not keep to its video's time line",
                where=self.path,
                got=f"UTC of frames {self._spread_s:.1f} s apart from it",
                expected=f"at most {_MOST_SPREAD_S:g} s",
                hint="it was cut or slowed: take the recorder's own file",
            )
        return self._offset_ns

    @property
    def time_std_s(self) -> float:
        """Standard deviation (s) of the telemetry's times on the video's time line."""
        return self._time_std_s

    def events(self) -> Iterator[Event]:
        """All frames in order, in blocks of bounded size."""
        for first in range(0, len(self._frames), _BLOCK_FRAMES):
            part = self._frames[first : first + _BLOCK_FRAMES]
            stamps_ns = [each.unix_ns for each in part]
            yield block_of(self._protocol, self.path.name, stamps_ns, [each.data for each in part])

    def warnings(self) -> tuple[str, ...]:
        """Sentences on what the source does not say, and on damage."""
        return tuple(f"{self.path}: {each}" for each in self._notes)
