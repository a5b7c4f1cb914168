"""A recording's images as an H.264 video, with what was measured in each and at the pace at which they were taken."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Final, Self

import av
import numpy as np

from aerodft.adapters.codec import events
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, NoAnswerError
from aerodft.model.image import Image
from replay.overlay import Overlay
from replay.pixels import PixelStore
from replay.recording import Recording
from replay.table import Item, parsed, row_of, time_utc

_TICKS_PER_S: Final = 90_000
_LATE_NS: Final = 60 * SECOND_NS  # measurements of an image come at most so long after it
_AHEAD_IMAGES: Final = 2000
_GUESSED_HZ: Final = 30
# What the encoder looks ahead it holds, at 7 MB for each image of 1080p.
_ENCODER: Final = {
    "preset": "veryfast",
    "crf": "20",
    "bf": "1",
    "rc-lookahead": "1",
    "x264-params": "sync-lookahead=0:sliced-threads=1:weightp=0",
}


@dataclass(slots=True)
class Filmed:
    """What is in a video.

    Attributes:
        images: Images.
        measurements: What was drawn into them.
        damaged_images: Recorded images that cannot be decoded, and are not in it.
        restamped_images: Images whose stamps went back in time; shown right after the ones before them.
    """

    images: int = 0
    measurements: int = 0
    damaged_images: int = 0
    restamped_images: int = 0


def write_video(recording: Recording, path: Path) -> Filmed:
    """Write a recording's images with their measurements as MP4; images come when their stamps say.

    Args:
        recording: With images.
        path: The file.

    Raises:
        NoAnswerError: No image was recorded.
        InputError: The recording or its measurements are damaged, or the video cannot be encoded.
        OSError: The file cannot be written.
    """
    images = _images(recording)
    first = next(images, None)
    if first is None:
        raise NoAnswerError(
            "the recording holds no image", where=recording.folder, hint="record.image_hz says how many"
        )
    filmed, answers = Filmed(), _Answers(recording)
    with _Film(path) as film:
        try:
            for image in chain((first,), images):
                items = answers.of(image)
                if not film.add(image, items):
                    filmed.damaged_images += 1
                    continue
                filmed.images += 1
                filmed.measurements += len(items)
            if not filmed.images:
                raise InputError("no recorded image can be decoded", where=recording.folder)
            film.finish()
        except av.FFmpegError as error:
            raise InputError("the video cannot be encoded", where=recording.folder, got=error) from error
    filmed.restamped_images = film.restamped
    return filmed


def _images(recording: Recording) -> Iterator[Image]:
    """The images that have pixels, in order of arrival."""
    store = PixelStore(recording)
    for message in recording.messages():
        if message.channel.schema == events.IMAGE_SCHEMA:
            image = events.decode_image(message.data)
            pixels = store.pixels(image)
            if pixels is not None:
                yield Image(
                    index=image.index,
                    stamp_ns=image.stamp_ns,
                    arrival_ns=image.arrival_ns,
                    clock=image.clock,
                    pixels=pixels,
                )


class _Answers:
    """Measurements by image; holds those of a minute."""

    def __init__(self, recording: Recording) -> None:
        self._coming = recording.measurements()
        self._by_image: dict[int, list[Item]] = {}
        self._by_stamp: dict[int, list[Item]] = {}

    def of(self, image: Image) -> list[Item]:
        """What was measured in an image; asked for in order of their arrival."""
        for payload in self._coming:
            item = parsed(payload)
            row_of(item)  # what is no measurement is refused, as in every other format
            index, stamp_ns = item["image"], int(item["stamp_ns"])
            held, key = (self._by_stamp, stamp_ns) if index is None else (self._by_image, index)
            held.setdefault(key, []).append(item)
            if stamp_ns > image.stamp_ns + _LATE_NS or (index is not None and index > image.index + _AHEAD_IMAGES):
                break
        found = self._by_image.pop(image.index, []) + self._by_stamp.pop(image.stamp_ns, [])
        for index in [each for each in self._by_image if each < image.index]:
            del self._by_image[index]
        for stamp_ns in [each for each in self._by_stamp if each < image.stamp_ns - _LATE_NS]:
            del self._by_stamp[stamp_ns]
        return found


class _Film:
    """An MP4 file that images are added to, of the size of the first.

    Attributes:
        restamped: Images whose stamp was not after the last one's.
    """

    def __init__(self, path: Path) -> None:
        self.restamped = 0
        self._path = path
        self._open: _Opened | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._open is not None:
            self._open.container.close()

    def add(self, image: Image, items: list[Item]) -> bool:
        """Add an image with what was measured in it; False where it cannot be decoded."""
        try:
            pixels = image.pixels() if image.pixels is not None else None
        except InputError:
            pixels = None
        if pixels is None:
            return False
        if self._open is None:
            self._open = _opened(self._path, Overlay(pixels.shape[1], pixels.shape[0]), image.stamp_ns)
        film = self._open
        # Drawn in place, and not copied for the encoder: every copy of a picture is megabytes.
        drawn = np.ascontiguousarray(film.overlay.draw(pixels, items, image.stamp_ns, image.index))
        del pixels
        frame = av.VideoFrame.from_numpy_buffer(drawn, format="rgb24")
        due = round((image.stamp_ns - film.start_ns) * _TICKS_PER_S / SECOND_NS)
        frame.pts = max(due, film.last + 1)
        frame.time_base = Fraction(1, _TICKS_PER_S)
        self.restamped += due <= film.last
        film.last = frame.pts
        film.container.mux(film.stream.encode(frame))
        return True

    def finish(self) -> None:
        """Write out what the encoder holds."""
        if self._open is not None:
            self._open.container.mux(self._open.stream.encode())


@dataclass(slots=True)
class _Opened:
    overlay: Overlay
    start_ns: int
    container: "av.container.OutputContainer"
    stream: "av.VideoStream"
    last: int = -1


def _opened(path: Path, overlay: Overlay, start_ns: int) -> _Opened:
    container = av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"})
    container.metadata["creation_time"] = time_utc(start_ns)
    stream = container.add_stream("libx264", rate=_GUESSED_HZ, options=_ENCODER)
    stream.width, stream.height = overlay.size
    stream.pix_fmt = "yuv420p"
    stream.codec_context.time_base = Fraction(1, _TICKS_PER_S)
    return _Opened(overlay, start_ns, container, stream)
