"""Video files with their true presentation stamps.

Media time 0 is the stream's first image: a stamp is ``start + (pts - stream start) * time base``, in integers, so a
container whose time line begins elsewhere (a transport stream, an edit list) needs no other start.
"""

import logging
from bisect import bisect_left, insort
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Final, TypeAlias

import av
from av.container import InputContainer
from av.stream import Disposition
from av.video.stream import VideoStream

from aerodft.adapters.files import looks_like
from aerodft.adapters.images.pixels import FramePixels
from aerodft.adapters.timestamps import OLDEST_NS, iso_to_unix_ns
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import Image, ImageArray

_LOG = logging.getLogger(__name__)
# The first is local time with its offset, and of the recording's start; the second is what most containers have.
_START_KEYS = ("com.apple.quicktime.creationdate", "creation_time")
_NO_VIDEO = {"image2", "tty", "bin", "xbin", "adf", "idf"}
_NEAR_IMAGES = 30  # decoded on the way to one ahead, rather than looking for a key image
_BEFORE_S = (0.0, 3.0, 15.0)  # a container without an index, such as a transport stream, is searched by guess
_Found: TypeAlias = tuple[int, int | None, av.VideoFrame | None]  # index, presentation stamp, image


VIDEO_SUFFIXES: Final = frozenset({".mp4", ".mov", ".mkv", ".avi", ".ts", ".m4v", ".webm", ".mpg", ".mpeg"})
"""Endings of names that promise a video."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoInfo:
    """Size, length and rotation of a container's first video stream.

    Attributes:
        width_px: As stored.
        height_px: As stored.
        rotation_deg: What a player would turn it by, anticlockwise; stamps and pixels here are as stored.
        start_ns: UTC of the start by the container's own metadata; None where it has none.
        duration_ns: None where unknown.
        images: None where unknown.
    """

    width_px: int
    height_px: int
    rotation_deg: int
    start_ns: int | None
    duration_ns: int | None
    images: int | None


class Losses(Counter[str]):
    """How many images were left out, by what is wrong with them."""

    BACKWARDS: Final = "with a stamp that is not after the one before"

    def report(self, where: Path | str) -> None:
        """Log them."""
        for what, count in self.items():
            _LOG.warning("%s: left out %d images %s", where, count, what)


class VideoFileSource:
    """A video file as a source of images, in presentation order."""

    def __init__(self, path: Path, *, start_ns: int | None = None, decode: bool = True) -> None:
        """Open the file once and read what it says about itself.

        Args:
            path: Any container and codec that FFmpeg reads.
            start_ns: UTC of the first image; None to take the container's metadata.
            decode: False to read stamps only: images come without pixels, many times faster.

        Raises:
            InputError: Missing, empty, no video, or no start time anywhere.
        """
        self.path = path
        self.info = video_info(path)
        self._decode = decode
        if start_ns is None:
            start_ns = self.info.start_ns
            if start_ns is None:
                raise InputError(
                    "does not say when it was recorded",
                    where=path,
                    expected="creation_time in the container",
                    hint="pass `video_start_ns` (or images.start), the UTC of its first image",
                )
            digits = "" if start_ns % SECOND_NS else ", to whole seconds"
            _LOG.warning("%s: start taken from the container%s; `video_start_ns` overrules", path, digits)
        if self.info.rotation_deg:
            _LOG.warning("%s: flagged as rotated by %d deg; pixels are used as stored", path, self.info.rotation_deg)
        self.start_ns = start_ns

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """UTC of start and end; None where the container does not say how long it is."""
        return None if self.info.duration_ns is None else (self.start_ns, self.start_ns + self.info.duration_ns)

    def events(self) -> Iterator[Image]:
        """All images whose stamp is sound; what was left out is logged as a warning at the end."""
        losses = Losses()
        last_ns: int | None = None
        index = -1
        with _opened(self.path) as (container, stream):
            clock = _MediaClock(stream)
            found = _frames(container, stream, losses) if self._decode else _stamps_only(container, stream)
            for index, pts, frame in found:
                media_ns = clock.media_ns(pts)
                if media_ns is None:
                    losses["without a stamp"] += 1
                elif last_ns is not None and media_ns <= last_ns:
                    losses[Losses.BACKWARDS] += 1
                else:
                    last_ns = media_ns
                    yield self._image(index, self.start_ns + media_ns, frame)
            losses.report(self.path)
            self._report_end(index + 1, last_ns)

    def _report_end(self, images: int, last_ns: int | None) -> None:
        short = self.info.images is not None and images < self.info.images
        if self.info.duration_ns is not None and (last_ns or 0) + SECOND_NS < self.info.duration_ns:
            short = True
        if short:
            of = f" of {self.info.images}" if self.info.images else ""
            end_s = (last_ns or 0) / SECOND_NS
            _LOG.warning(
                "%s: ends early, after %d%s images at %.3f s; it is cut or damaged", self.path, images, of, end_s
            )

    def _image(self, index: int, stamp_ns: int, frame: av.VideoFrame | None) -> Image:
        return Image(
            index=index,
            stamp_ns=stamp_ns,
            arrival_ns=stamp_ns,
            width_px=self.info.width_px if frame is None else frame.width,
            height_px=self.info.height_px if frame is None else frame.height,
            pixels=None if frame is None else FramePixels(frame),
        )


class VideoFilesSource:
    """Videos that one camera took one after the other, as one source of images that are numbered on.

    Args:
        files: Each video with the UTC of its first image, in order; None of the first for its container's.
        decode: As for ``VideoFileSource``.

    Raises:
        InputError: As for ``VideoFileSource``.
    """

    def __init__(self, files: Sequence[tuple[Path, int | None]], *, decode: bool = True) -> None:
        self._sources = [VideoFileSource(path, start_ns=start_ns, decode=decode) for path, start_ns in files]

    def events(self) -> Iterator[Image]:
        """All images whose stamp is sound, in order."""
        first, last_ns = 0, 0
        for source in self._sources:
            index = -1
            for image in source.events():
                index = image.index
                if image.stamp_ns > last_ns:
                    last_ns = image.stamp_ns
                    yield replace(image, index=first + index)
            first += index + 1


class SeekableVideo:
    """A video's images by their number, in any order; for one thread at a time.

    Args:
        path: The video; it stays open.

    Attributes:
        info: What it says about itself.
        media_ns: Of each image the time since the first, in order.

    Raises:
        InputError: Missing, empty, no video, or without an image.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.info = video_info(path)
        self._container, self._stream = _open(path)
        clock = _MediaClock(self._stream)
        stamps = [(clock.media_ns(pts), pts) for _, pts, _ in _stamps_only(self._container, self._stream)]
        known = [(media_ns, pts) for media_ns, pts in stamps if media_ns is not None and pts is not None]
        if not known:
            raise InputError("holds no image with a stamp", where=path)
        self.media_ns = [media_ns for media_ns, _ in known]
        self._pts = [pts for _, pts in known]
        self._next = len(self._pts)  # the image that is decoded next, if nobody asks for another
        self._frames: Iterator[av.VideoFrame] = iter(())

    def pixels(self, number: int) -> ImageArray:
        """``(height, width, 3)`` uint8 BGR.

        Raises:
            InputError: It cannot be decoded.
        """
        pts = self._pts[number]
        is_near = self._next <= number < self._next + _NEAR_IMAGES
        frame = self._frame(pts) if is_near else None
        for before_s in () if frame is not None else (*_BEFORE_S, None):
            self._seek(pts, before_s)
            frame = self._frame(pts)
            if frame is not None:
                break
        self._next = len(self._pts) if frame is None else number + 1
        if frame is None:
            raise InputError("the image cannot be decoded", where=self._path, got=f"image {number}")
        return FramePixels(frame)()

    def _seek(self, pts: int, before_s: float | None) -> None:
        """Go to a key image some seconds before a stamp, or where that is None to the start."""
        if before_s is None:
            self._container.close()
            self._container, self._stream = _open(self._path)
        else:
            before = round(before_s / (self._stream.time_base or Fraction(1, SECOND_NS)))
            self._container.seek(max(pts - before, self._pts[0]), stream=self._stream)
        self._frames = self._container.decode(self._stream)

    def _frame(self, pts: int) -> "av.VideoFrame | None":
        """The frame with a stamp, if it comes before any later one."""
        try:
            found = next((each for each in self._frames if each.pts is not None and each.pts >= pts), None)
        except av.FFmpegError:
            return None
        return found if found is not None and found.pts == pts and not found.is_corrupt else None


class _MediaClock:
    """Presentation stamps to nanoseconds since the stream's first image."""

    def __init__(self, stream: VideoStream) -> None:
        self._base = stream.time_base or Fraction(1, SECOND_NS)
        self._zero = stream.start_time
        self._period_ns = round(SECOND_NS / stream.average_rate) if stream.average_rate else None
        self._previous_ns: int | None = None

    def media_ns(self, pts: int | None) -> int | None:
        """Since the first image; None where there is neither a stamp nor a rate to continue with."""
        if pts is None:
            if self._period_ns is None:
                return None
            self._previous_ns = 0 if self._previous_ns is None else self._previous_ns + self._period_ns
            return self._previous_ns
        if self._zero is None:
            self._zero = pts
        scaled = (pts - self._zero) * self._base.numerator * SECOND_NS
        self._previous_ns = (2 * scaled + self._base.denominator) // (2 * self._base.denominator)
        return self._previous_ns


def video_info(path: Path) -> VideoInfo:
    """Size, length and rotation of a video file's first stream.

    Raises:
        InputError: Missing, empty, or no video.
    """
    with _opened(path) as (container, stream):
        metadata = {**stream.metadata, **container.metadata}
        return VideoInfo(
            width_px=stream.codec_context.width,
            height_px=stream.codec_context.height,
            rotation_deg=_rotation_deg(container, stream),
            start_ns=_metadata_start_ns(metadata),
            duration_ns=_duration_ns(container, stream),
            images=stream.frames or None,
        )


def _duration_ns(container: InputContainer, stream: VideoStream) -> int | None:
    if stream.duration is not None and stream.time_base is not None:
        return round(stream.duration * stream.time_base * SECOND_NS)
    return None if container.duration is None else container.duration * (SECOND_NS // av.time_base)


def _metadata_start_ns(metadata: dict[str, str]) -> int | None:
    for key in _START_KEYS:
        try:
            start_ns = iso_to_unix_ns(metadata.get(key, ""))
        except ValueError:
            continue
        if start_ns >= OLDEST_NS:
            return start_ns
    return None


def _rotation_deg(container: InputContainer, stream: VideoStream) -> int:
    try:
        frame = next(container.decode(stream), None)
    except av.FFmpegError:
        return 0
    return 0 if frame is None else int(frame.rotation)


@contextmanager
def _opened(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    """The container and its first video stream, for a while; raises as ``_open`` does."""
    container, stream = _open(path)
    with container:
        yield container, stream


def _open(path: Path) -> tuple[InputContainer, VideoStream]:
    """The container and its first video stream.

    Raises:
        InputError: Missing, empty, or no video.
    """
    if not path.is_file():
        got = looks_like(path) if path.exists() else "nothing there"
        raise InputError("no video file", where=path, got=got, expected="a video file", hint="check the path")
    try:
        container = av.open(str(path), metadata_errors="replace")
    except av.FFmpegError:
        got = looks_like(path)
        hint = "it is cut off before its index" if "MP4" in got else ""
        raise InputError("not a readable video", where=path, got=got, expected="a video file", hint=hint) from None
    if not container.streams.video or _is_no_video(container):
        container.close()
        raise InputError("holds no video", where=path, got=looks_like(path), expected="a video file")
    stream = container.streams.video[0]
    stream.thread_type = "AUTO"
    return container, stream


def _is_no_video(container: InputContainer) -> bool:
    """Whether FFmpeg sees pictures in what nobody would call a video: a still, a cover in a sound file, text."""
    name = container.format.name
    cover = bool(container.streams.video[0].disposition & Disposition.attached_pic)
    return name in _NO_VIDEO or name.endswith("_pipe") or cover


def _packets(container: InputContainer, stream: VideoStream) -> Iterator["av.Packet[VideoStream]"]:
    try:
        yield from container.demux(stream)
    except av.FFmpegError as error:
        _LOG.warning("%s: damaged, reading stops here (%s)", container.name, error.strerror)


def _frames(container: InputContainer, stream: VideoStream, losses: Losses) -> Iterator[_Found]:
    """Decoded images; a damaged one keeps its index, so that the others are what a player and a detector call them."""
    stamps: list[int] = []
    index = -1
    for packet in _packets(container, stream):
        if packet.pts is not None and packet.size and not packet.is_discard:
            insort(stamps, packet.pts)
        try:
            frames = packet.decode()
        except av.FFmpegError:
            losses["damaged"] += 1
            continue
        for frame in frames:
            if frame.is_corrupt:
                losses["damaged"] += 1
            else:
                index = index + 1 if frame.pts is None else bisect_left(stamps, frame.pts)
                yield index, frame.pts, frame


def _stamps_only(container: InputContainer, stream: VideoStream) -> Iterator[_Found]:
    """Packets in presentation order; stored order differs where images refer to later ones."""
    stamps = [packet.pts for packet in _packets(container, stream) if packet.size and not packet.is_discard]
    known = sorted(pts for pts in stamps if pts is not None)
    for index, pts in enumerate(known):
        yield index, pts, None
    for index in range(len(known), len(stamps)):
        yield index, None, None
