"""Subtitles beside a video, or inside it, as blocks of cues on the video's time line."""

import math
import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import av
import numpy as np

from aerodft.adapters.files import looks_like, read_whole
from aerodft.adapters.images import video_info
from aerodft.adapters.telemetry.log_file import rows_that_go_on
from aerodft.adapters.telemetry.mavlink import FrameCounts
from aerodft.adapters.telemetry.subtitles.cues import Cue, find_cues, read_cue
from aerodft.adapters.telemetry.subtitles.decoding import PROTOCOL, hfov_deg
from aerodft.adapters.telemetry.subtitles.video_fit import check_fits, check_one_camera, interval_s, joints
from aerodft.adapters.timestamps import OLDEST_NS, unix_ns_to_iso
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, os_errors_as
from aerodft.model import Event, RawBlock

TITLE: Final = "a drone's subtitles (.SRT, or a video with them)"
VIDEO_SUFFIXES: Final = (".mp4", ".mov", ".m4v", ".ts")
SUFFIX: Final = ".srt"
_BLOCK_CUES: Final = 4096
_MOST_BYTES: Final = 1 << 28  # ten hours at 60 images per second take 650 MB: nobody flies that long
_ZONE_NS: Final = 900 * SECOND_NS  # offsets from UTC are whole quarters of an hour
_HOUR_NS: Final = 3600 * SECOND_NS
_FARTHEST_NS: Final = 14 * 3600 * SECOND_NS
_SAME_NS: Final = 60 * SECOND_NS  # by which the container's clock and the drone's may differ, besides the zone
_TRUNCATED_NS: Final = SECOND_NS // 1000 - 1
_GAP_NS: Final = 2 * SECOND_NS  # between parts; a Matrice 30T needs 0.07 s, clocks in whole seconds are off by 1 s
_HELD_S: Final = 0.1  # drones renew positions 10 times per second, and repeat them in the cues between
_ZOOMED: Final = 1.01  # what rounds to other digits is no zoom
_NO_TELEMETRY: Final = frozenset({"TimeCodeHandler", "GoPro TCD"})  # tracks of time codes, as cameras name them
_TEXT: Final = ("mov_text", "subrip", "text")
_WITHOUT_ANGLES: Final = (
    "no angles of the camera: state its tilt (`tilt_deg`, or telemetry.attitude.fixed_mount); its gimbal is taken to "
    "keep it level"
)


@dataclass(frozen=True, slots=True)
class _Timed:
    """Cues on one time line: start of each in ns since the video's first image, place and length in the text."""

    media_ns: list[int]
    spans: list[tuple[int, int]]
    cues: list[Cue]
    left_out: int


class SubtitleLog:
    """A flight's subtitles, of one video or of the parts that a drone has cut it into, in the order of their clocks.

    Args:
        paths: The subtitles; or videos with subtitles beside them, by the same name, or inside.
        start_ns: UTC of the first video's first image; None for the clocks of subtitles and videos.

    Attributes:
        path: The first file that was named.

    Raises:
        InputError: A file is missing or unreadable, holds no cue of a drone, or two are of one time.
    """

    def __init__(self, paths: Sequence[Path], start_ns: int | None = None) -> None:
        self.path = paths[0]
        self._paths = tuple(paths)
        parts = [_Part(path) for path in paths]
        _check_sizes(parts)
        zones_ns = [part.zone_ns for part in parts if part.zone_ns is not None]
        for part in parts if zones_ns else ():
            part.take_zone(zones_ns[0])
        for before, part in pairwise(parts):
            if not part.has_clock:
                part.shift(max(before.next_start_ns - part.start_ns, 0))
        self._parts = sorted(parts, key=lambda part: part.start_ns)
        for before, part in pairwise(self._parts):
            if part.start_ns <= before.end_ns:
                raise InputError("two files are of one time", where=part.path, got=f"the time of {before.path}")
        if start_ns is not None:
            by_ns = start_ns - self.start_ns
            for part in self._parts:
                part.shift(by_ns)

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files that were named, in the order of their times."""
        return tuple(part.path for part in self._parts)

    @property
    def start_ns(self) -> int:
        """UTC of the first video's first image."""
        return self._parts[0].start_ns

    @property
    def videos(self) -> tuple[tuple[Path, int], ...]:
        """Each part's video and the UTC of its first image; empty where one part has none."""
        videos = tuple((part.video, part.start_ns) for part in self._parts if part.video is not None)
        return videos if len(videos) == len(self._parts) else ()

    @property
    def focal_mm(self) -> float | None:
        """Median 35 mm-equivalent focal length, digital zoom included; None where no cue states one."""
        focal_mm = [each for part in self._parts for each in part.focal_mm]
        return float(np.median(focal_mm)) if focal_mm else None

    @property
    def interval_s(self) -> float:
        """Usual time between two cues (s), the longest of all parts."""
        return max(interval_s(part.media_ns) for part in self._parts)

    @property
    def time_std_s(self) -> float:
        """Standard deviation (s) of when a cue's values were measured: anywhere in the interval that it holds."""
        return max(_HELD_S, self.interval_s) / math.sqrt(12)

    @property
    def has_angles(self) -> bool:
        """Whether cues state the camera's angles."""
        return any(cue.gimbal_deg is not None for part in self._parts for cue in part.cues)

    def check_video(self, video: Path) -> list[str]:
        """Sentences on a video that is named apart from the subtitles, which are taken to begin with it.

        Raises:
            InputError: It is not the video of these subtitles.
        """
        media_ns = [part.start_ns + each - self.start_ns for part in self._parts for each in part.media_ns]
        cues = [cue for part in self._parts for cue in part.cues]
        return check_fits(media_ns, cues, video_info(video), self.path)

    @property
    def counts(self) -> FrameCounts:
        """Counts of the cues."""
        return FrameCounts(frames=sum(len(part.cues) for part in self._parts))

    def restarted(self, start_ns: int) -> "SubtitleLog":
        """The flight with another UTC of its first image."""
        return SubtitleLog(self._paths, start_ns)

    def events(self) -> Iterator[Event]:
        """All cues in order, in blocks of bounded size."""
        for part in self._parts:
            yield from part.events()

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each thing that the subtitles do not say, and for damage."""
        gaps = (
            f"{part.path} begins {gap_ns / SECOND_NS:.1f} s after the end of {before.path}; a cut video goes on at once"
            for before, part in pairwise(self._parts)
            if (gap_ns := part.start_ns - before.next_start_ns) > _GAP_NS
        )
        return (*(sentence for part in self._parts for sentence in part.warnings()), *gaps)


class _Part:
    """One file's subtitles as blocks of cues, whose arrivals are UTC on the video's time line.

    The drone's clock is local time without a zone. The zone is the one by which the video's own creation time differs
    from it; without a video the clock is taken for UTC. A dialect without a clock has the video's creation time.

    Attributes:
        path: The file that was named.
        video: The video that the subtitles belong to; None where there is none.
        start_ns: UTC of the video's first image.
        has_clock: Whether the subtitles state the time of day.
        zone_ns: The drone's clock minus UTC; None where nothing tells it.

    Raises:
        InputError: The file is missing or unreadable, or holds no cue of a drone.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.video, self._text, self._where = _subtitles_of(path)
        self._info = None if self.video is None else video_info(self.video)
        self._timed = _on_time_line(self._text)
        if not any(map(_says_something, self._timed.cues)):
            got = "subtitles without telemetry" if find_cues(self._text) else looks_like(path)
            raise InputError("wrong type of file", where=self._where, got=got, expected=TITLE)
        timed = self._timed
        self._notes = [] if self._info is None else check_fits(timed.media_ns, timed.cues, self._info, self._where)
        if self._info is not None:
            check_one_camera(timed.media_ns, timed.cues, self._where)
        self._notes += joints(timed.media_ns, timed.cues)
        self.has_clock = any(cue.clock_ns is not None for cue in self._timed.cues)
        self.zone_ns: int | None = None
        self.start_ns = self._own_start_ns()

    @property
    def cues(self) -> list[Cue]:
        """All cues whose time goes on."""
        return self._timed.cues

    @property
    def media_ns(self) -> list[int]:
        """Times of the cues since the video's first image."""
        return self._timed.media_ns

    @property
    def end_ns(self) -> int:
        """UTC of the last cue."""
        return self.start_ns + self._timed.media_ns[-1]

    @property
    def next_start_ns(self) -> int:
        """UTC at which a part that goes on would begin: the video's end, else that of the last cue."""
        duration_ns = None if self._info is None else self._info.duration_ns
        media_ns = self._timed.media_ns
        return self.start_ns + (duration_ns or 2 * media_ns[-1] - media_ns[max(len(media_ns) - 2, 0)] + 1)

    @property
    def focal_mm(self) -> list[float]:
        """35 mm-equivalent focal lengths of the cues that state one, digital zoom included."""
        return [cue.focal_mm * (cue.zoom or 1.0) for cue in self.cues if cue.focal_mm is not None]

    def shift(self, by_ns: int) -> None:
        """Move the part in time."""
        self.start_ns += by_ns

    def take_zone(self, zone_ns: int) -> None:
        """Take the zone of another part, where this one's is not known."""
        if self.has_clock and self.zone_ns is None:
            self.zone_ns = zone_ns
            self.shift(-zone_ns)

    @property
    def size_px(self) -> tuple[int, int] | None:
        """Size of the video's images; None without a video."""
        return None if self._info is None else (self._info.width_px, self._info.height_px)

    def events(self) -> Iterator[Event]:
        """All cues in order, in blocks of bounded size."""
        timed = self._timed
        for first in range(0, len(timed.spans), _BLOCK_CUES):
            offset, length = np.array(timed.spans[first : first + _BLOCK_CUES], dtype=np.int64).T
            stop = int(offset[-1] + length[-1])
            yield RawBlock(
                protocol=PROTOCOL,
                sender=self.path.name,
                arrival_ns=self.start_ns + np.array(timed.media_ns[first : first + _BLOCK_CUES], dtype=np.int64),
                offset=offset - offset[0],
                length=length,
                data=self._text[int(offset[0]) : stop],
                checked=True,
            )

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each thing that the subtitles do not say, and for damage."""
        cues, where = self._timed.cues, self._where
        sentences = [f"{where}: {each}" for each in self._notes]
        if self.zone_ns is not None:
            zone = f"UTC{self.zone_ns / _HOUR_NS:+g} h by the video's creation time"
            sentences.append(f"{where}: the drone's clock is local time: {zone}")
        elif self.has_clock:
            sentences.append(f"{where}: the drone's clock is local time without a zone: it is taken for UTC")
        with_angles = sum(cue.gimbal_deg is not None for cue in cues)
        with_height = sum(cue.height_home_m is not None for cue in cues)
        if not with_angles:
            sentences.append(f"{where}: {_WITHOUT_ANGLES}")
        elif with_angles < len(cues):
            sentences.append(f"{where}: no angles of the camera in {len(cues) - with_angles} of {len(cues)} cues")
        if 0 < with_height < len(cues):
            sentences.append(f"{where}: no height in {len(cues) - with_height} of {len(cues)} cues")
        if not with_height:
            absolute = any(cue.altitude_m is not None for cue in cues)
            has = "its altitude is absolute, of no stated datum" if absolute else "it states none"
            sentences.append(f"{where}: no height above the take-off point: {has}; state telemetry.height.manual_m")
        dialects = {cue.height_key or ("altitude" if cue.altitude_m is not None else "") for cue in cues} - {""}
        if len(dialects) > 1:
            sentences.append(
                f"{where}: more than one dialect ({', '.join(sorted(dialects))}): each cue is read by its own words"
            )
        if self.focal_mm and max(self.focal_mm) > _ZOOMED * min(self.focal_mm):
            sentences.append(
                f"{where}: the camera zooms: telemetry.zoom.reported_hfov_deg must be the field of view that the "
                f"subtitles report at the camera file's zoom ({hfov_deg(self.focal_mm[0]):.2f} deg at the start)"
            )
        if self._timed.left_out:
            sentences.append(f"{where}: {self._timed.left_out} cues left out: their times do not go on")
        return tuple(sentences)

    def _own_start_ns(self) -> int:
        """UTC of the video's first image, by the clocks of the drone and of the container."""
        timed = self._timed
        local = [
            cue.clock_ns - media_ns
            for cue, media_ns in zip(timed.cues, timed.media_ns, strict=True)
            if cue.clock_ns is not None and cue.clock_ns >= OLDEST_NS
        ]
        container_ns = None if self._info is None else self._info.start_ns
        if not local:
            if container_ns is not None:
                self._notes.append(f"no clock: UTC is the video's creation time, {unix_ns_to_iso(container_ns)}")
                return container_ns
            self._notes.append(
                "no clock: the file's modification time is taken for the end, so UTC may be off by hours"
            )
            with os_errors_as("cannot be read", where=self.path):
                return self.path.stat().st_mtime_ns - timed.media_ns[-1]
        start_ns = sorted(local)[len(local) // 2]  # the median, in integers
        if container_ns is not None:
            offset_ns = round((start_ns - container_ns) / _ZONE_NS) * _ZONE_NS
            slack_ns = _SAME_NS + timed.media_ns[-1]  # some containers state the end
            if abs(offset_ns) <= _FARTHEST_NS and abs(start_ns - offset_ns - container_ns) <= slack_ns:
                self.zone_ns = offset_ns
                return start_ns - offset_ns
            self._notes.append(
                f"the video was made at {unix_ns_to_iso(container_ns)}, the drone's clock says that it began at "
                f"{unix_ns_to_iso(start_ns)}: was it converted, or are the subtitles another video's?"
            )
        return start_ns


def _check_sizes(parts: Sequence[_Part]) -> None:
    """Refuse videos of several sizes: a camera file is of one."""
    first = parts[0]
    for part in parts[1:]:
        if None not in (part.size_px, first.size_px) and part.size_px != first.size_px:
            sizes = " and ".join(f"{size[0]} x {size[1]} px" for size in (first.size_px, part.size_px) if size)
            raise InputError(
                "not a part of the same video", where=part.path, got=sizes, hint=f"import it apart from {first.path}"
            )


def beside(path: Path, suffixes: Sequence[str]) -> Path | None:
    """The file of the same stem with one of some suffixes, in whatever case; None where there is none."""
    try:
        found = sorted(each for each in path.parent.iterdir() if each.stem.lower() == path.stem.lower())
    except OSError:
        return None
    return next((each for each in found if each.suffix.lower() in suffixes and each.is_file()), None)


def _subtitles_of(path: Path) -> tuple[Path | None, bytes, Path]:
    """The video, the subtitles' text, and the file that it stands in.

    Raises:
        InputError: There are none, or they cannot be read.
    """
    if path.suffix.lower() == SUFFIX or not _has_video_head(path):
        return beside(path, VIDEO_SUFFIXES), _read(path), path
    subtitles = beside(path, (SUFFIX,))
    if subtitles is not None:
        return path, _read(subtitles), subtitles
    return path, _text_track(path), path


def carries_subtitles(video: Path) -> bool:
    """Whether a drone's subtitles are beside a video or inside it."""
    try:
        _, text, _ = _subtitles_of(video)
    except InputError:
        return False
    return any(_says_something(read_cue(text[at : at + size])) for at, size in find_cues(text))


def unread_tracks(video: Path) -> list[str]:
    """Names of a video's data tracks, which are telemetry in binary form; time codes are none."""
    try:
        with av.open(str(video), metadata_errors="replace") as container:
            return sorted({_tag(each) for each in container.streams.data} - _NO_TELEMETRY)
    except av.FFmpegError:
        return []


def _read(path: Path) -> bytes:
    if not path.exists():
        raise InputError("no such file", where=path, expected=TITLE, hint="check the path")
    with os_errors_as("cannot be read", where=path, expected=TITLE):
        if path.is_file() and path.stat().st_size > _MOST_BYTES:
            raise InputError("wrong type of file", where=path, got=f"more than {_MOST_BYTES >> 20} MB", expected=TITLE)
        return read_whole(path)


def _has_video_head(path: Path) -> bool:
    return looks_like(path) in {"an MP4 or MOV video", "a Matroska or WebM video"}


def _text_track(path: Path) -> bytes:
    """The subtitles inside a video, as the text of an .SRT file.

    Raises:
        InputError: The video has none.
    """
    hint = "put the .SRT beside it by the same name (the drone's app has a switch for video captions)"
    try:
        with av.open(str(path), metadata_errors="replace") as container:
            stream = next((each for each in container.streams.subtitles if each.codec_context.name in _TEXT), None)
            if stream is None:
                others = sorted({_tag(each) for each in container.streams.data})
                track = f"; its data track ({', '.join(others)}) is no text" if others else ""
                raise InputError("a video without subtitles", where=path, got=f"no text track{track}", hint=hint)
            base, parts = stream.time_base, list[bytes]()
            for packet in container.demux(stream):
                data = bytes(packet)
                if packet.pts is None or not data or base is None:
                    continue
                size = struct.unpack_from(">H", data)[0] if len(data) > 1 else 0
                text = data[2 : 2 + size] if size and size <= len(data) - 2 else data
                start_ms = round(packet.pts * base * 1000)
                parts.append(f"{len(parts) + 1}\n{_srt_time(start_ms)} --> {_srt_time(start_ms)}\n".encode() + text)
    except av.FFmpegError:
        raise InputError(
            "wrong type of file", where=path, got=f"{looks_like(path)} that cannot be read", expected=TITLE
        ) from None
    return b"\n\n".join(parts) + b"\n\n"


def _tag(stream: av.stream.Stream) -> str:
    handler = stream.metadata.get("handler_name", "")
    return re.sub(r"[^\w .-]", "", handler) or "unnamed"


def _srt_time(ms: int) -> str:
    seconds, ms = divmod(max(ms, 0), 1000)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d},{ms:03d}"


def _says_something(cue: Cue) -> bool:
    """Whether a cue is a drone's."""
    return any(
        each is not None for each in (cue.lat_lon_deg, cue.height_home_m, cue.altitude_m, cue.gimbal_deg, cue.count)
    )


def _on_time_line(text: bytes) -> _Timed:
    """All cues whose time goes on: a single time that is off, ahead or back, is left out with its cue.

    Cue times are truncated to milliseconds. The last cue is taken at the end of its millisecond, as its image would
    have no cue on its other side.
    """
    spans = find_cues(text)
    cues = [read_cue(text[at : at + size]) for at, size in spans]
    starts = _starts_ns(cues)
    kept = rows_that_go_on(starts)
    media_ns = [each for k in kept if (each := starts[k]) is not None]
    media_ns[-1:] = [each + _TRUNCATED_NS for each in media_ns[-1:]]
    return _Timed(
        media_ns=media_ns,
        spans=[spans[k] for k in kept],
        cues=[cues[k] for k in kept],
        left_out=len(spans) - len(kept),
    )


def _starts_ns(cues: list[Cue]) -> list[int | None]:
    """Start of each cue in ns since the video's first image: by its time, else by its clock since the first cue's."""
    if any(cue.start_s is not None for cue in cues):
        return [None if cue.start_s is None else round(cue.start_s * SECOND_NS) for cue in cues]
    first_ns = next((cue.clock_ns for cue in cues if cue.clock_ns is not None), 0)
    return [None if cue.clock_ns is None else cue.clock_ns - first_ns for cue in cues]
