"""Still images out of recordings and videos, to read pixels in: as they are, or with what was measured drawn in."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, pairwise
from pathlib import Path
from typing import Final

import cv2

from aerodft.adapters.files import check_is_local, whole_file
from aerodft.adapters.images import STILLS, StillsFolderSource, VideoFileSource, video_info
from aerodft.app.recordings import open_recording
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, NoAnswerError, UsageError
from aerodft.model import Image
from replay.export import Item, Overlay, measured_images
from replay.recordings import is_mcap

_OUTSIDE_NS: Final = SECOND_NS
"""An instant may be so far before the first image or after the last one."""

Measured = tuple[Image, list[Item]]


@dataclass(frozen=True, slots=True)
class ImageReel:
    """The images of a recording or a video.

    Attributes:
        path: The recording or video.
        zero_ns: What seconds count from: the stamp of the first image; of a video 0 where nobody says it.
        images: Gives the images in their order, each with what was measured in it.
        is_measured: Whether measurements come with them.
    """

    path: Path
    zero_ns: int
    images: Callable[[], Iterator[Measured]]
    is_measured: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Still:
    """One image that was written.

    Attributes:
        path: The PNG file.
        image: Index of the image in the recording or video, which observations may name.
        stamp_ns: Of the image, UTC where the source knows it.
        seconds: From the reel's first image.
    """

    path: Path
    image: int
    stamp_ns: int
    seconds: float


def open_reel(path: str | Path) -> ImageReel:
    """Open the images of a recording or a video, or a photograph.

    Raises:
        InputError: It is none of them, or cannot be read.
    """
    path = Path(path)
    if path.is_file() and path.suffix.lower() in STILLS:
        stills = StillsFolderSource(path, unique_stamps=True)
        return ImageReel(path, stills.span_ns[0], lambda: ((image, []) for image in stills.events()), is_measured=False)
    if path.is_dir() or (path.exists() and is_mcap(path)):
        reader = open_recording(path).reader
        return ImageReel(path, reader.zero_ns, partial(measured_images, reader), is_measured=True)
    start_ns = video_info(path).start_ns or 0
    video = VideoFileSource(path, start_ns=start_ns)
    return ImageReel(path, start_ns, lambda: ((image, []) for image in video.events()), is_measured=False)


def write_stills(
    reel: ImageReel,
    folder: str | Path,
    *,
    at_ns: Sequence[int] = (),
    every_s: float | None = None,
    with_overlay: bool = False,
    overwrite: bool = False,
) -> tuple[Still, ...]:
    """Write the images nearest to some instants as PNG files, pixel for pixel.

    Args:
        reel: The images.
        folder: Where to write; made where it is missing.
        at_ns: Instants, of which the nearest images are written.
        every_s: Instead: an image every so many seconds, from the first.
        with_overlay: Whether values, intervals and statuses are drawn in; images below 480 px are enlarged then.
        overwrite: Whether files that exist are replaced.

    Returns:
        What was written, in the order of time.

    Raises:
        UsageError: Neither instants nor a step, both of them, or an overlay without measurements.
        NoAnswerError: No image, or an instant more than a second before the first or after the last one.
        InputError: An image is damaged, or a file exists or cannot be written.
    """
    if not at_ns and every_s is None and reel.path.suffix.lower() in STILLS:
        at_ns = (reel.zero_ns,)  # a photograph is all there is
    if bool(at_ns) == (every_s is not None) or (every_s is not None and every_s <= 0):
        raise UsageError("`at_ns` and `every_s`", got="both or neither of them", expected="instants, or a step above 0")
    if with_overlay and not reel.is_measured:
        raise UsageError("`with_overlay` of a video", expected="a recording: in a video nothing was measured")
    folder, written, overlay = Path(folder), dict[int, Still](), None
    check_is_local(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for image, items in _nearest(reel, at_ns) if every_s is None else _every(reel, every_s):
        if image.index in written or image.pixels is None:
            continue
        pixels = image.pixels()
        if with_overlay:
            overlay = overlay or Overlay(pixels.shape[1], pixels.shape[0])
            pixels = overlay.draw(pixels, items, image.stamp_ns, image.index)[:, :, ::-1]
        path = folder / f"image-{image.index:06d}.png"
        done, data = cv2.imencode(".png", pixels)
        if not done:
            raise InputError("the image cannot be encoded", where=path)
        with whole_file(path, overwrite=overwrite) as partial_file:
            partial_file.write_bytes(data.tobytes())
        seconds = (image.stamp_ns - reel.zero_ns) / SECOND_NS
        written[image.index] = Still(path=path, image=image.index, stamp_ns=image.stamp_ns, seconds=seconds)
    if not written:
        raise NoAnswerError("there is no image", where=reel.path, hint="record.image_hz says how many are recorded")
    return tuple(written.values())


def _every(reel: ImageReel, every_s: float) -> Iterator[Measured]:
    due_ns: int | None = None
    for image, items in reel.images():
        due_ns = image.stamp_ns if due_ns is None else due_ns
        if image.stamp_ns >= due_ns:
            step_ns = round(every_s * SECOND_NS)
            due_ns += ((image.stamp_ns - due_ns) // step_ns + 1) * step_ns
            yield image, items


def _nearest(reel: ImageReel, at_ns: Sequence[int]) -> Iterator[Measured]:
    """The image nearest to each instant.

    Raises:
        NoAnswerError: An instant lies before the first image or after the last one.
    """
    wanted = sorted(at_ns)
    first: Measured | None = None
    last: Measured | None = None
    for before, after in pairwise(chain(reel.images(), (None,))):
        if before is None:
            break
        first, last = first or before, before
        if wanted and wanted[0] < first[0].stamp_ns - _OUTSIDE_NS:
            break
        last_ns = before[0].stamp_ns + _OUTSIDE_NS if after is None else (before[0].stamp_ns + after[0].stamp_ns) // 2
        while wanted and wanted[0] <= last_ns:
            wanted.pop(0)
            yield before
        if not wanted:
            return
    if wanted and first is not None and last is not None:
        got = f"{(wanted[0] - reel.zero_ns) / SECOND_NS:g} s"
        till = f"to {_seconds(reel, last):.3f} s" if last is not first else "s or later"
        expected = f"{_seconds(reel, first):.3f} {till}"
        raise NoAnswerError("no image then", where=reel.path, got=got, expected=expected)


def _seconds(reel: ImageReel, measured: Measured) -> float:
    return (measured[0].stamp_ns - reel.zero_ns) / SECOND_NS
