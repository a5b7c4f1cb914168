"""A recording's images as an H.264 video, with what was measured in each and at the pace at which they were taken."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Final, NamedTuple, Self

import av
import cv2
import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from aerodft.adapters.wire.events import IMAGE_SCHEMA, decode_image
from aerodft.conventions import SECOND_NS
from aerodft.dft import recorded_kind
from aerodft.errors import InputError, NoAnswerError, printable
from aerodft.model import FloatArray, Image, ImageArray, Status
from replay.export.table import Item, digits_of, parse_measurement, row_of, time_utc, written_unit
from replay.recordings import PixelStore, Recording

LEAST_HEIGHT_PX: Final = 480
"""Smaller images are enlarged, so that what is written in them can be read."""

_LINES: Final = 32  # lines of text that an image is high
COLOURS: Final = ((86, 180, 233), (230, 159, 0), (0, 158, 115), (240, 228, 66), (204, 121, 167), (213, 94, 0))
"""RGB; told apart by the colour-blind as well (Okabe and Ito)."""
_NO_NUMBER: Final = (150, 30, 30)
_BLACK, _WHITE = (0, 0, 0), (255, 255, 255)


class _Box(NamedTuple):
    left: float
    top: float
    right: float
    bottom: float

    def overlaps(self, other: "_Box") -> bool:
        return (
            self.left < other.right and other.left < self.right and self.top < other.bottom and other.top < self.bottom
        )


class Overlay:
    """Draws into images of one size; a probe keeps its colour.

    Attributes:
        colours: RGB, by probe.

    Args:
        width_px: Of the images.
        height_px: Of the images.
    """

    def __init__(self, width_px: int, height_px: int) -> None:
        self._scale = max(1, math.ceil(LEAST_HEIGHT_PX / height_px))
        self._size = (width_px * self._scale, height_px * self._scale)
        self._line_px = max(12, min(self._size[1] / _LINES, self._size[0] / 45))
        self._font = ImageFont.truetype(str(_font_file()), round(0.72 * self._line_px))
        self._stroke = max(2, round(self._line_px / 9))
        self.colours: dict[str, tuple[int, int, int]] = {}

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of what is drawn, each even, as video codecs want it."""
        return self._size[0] + self._size[0] % 2, self._size[1] + self._size[1] % 2

    def draw(self, image: ImageArray, items: Sequence[Item], stamp_ns: int, index: int) -> ImageArray:
        """An image with what was measured in it.

        Args:
            image: ``(h, w, 3)`` uint8 BGR.
            items: Measurements as on the wire.
            stamp_ns: Of the image, where nothing was measured.
            index: Of the image.

        Returns:
            ``size`` as ``(h, w, 3)`` uint8 RGB.
        """
        if (image.shape[1], image.shape[0]) != self._size:
            image = np.asarray(cv2.resize(image, self._size, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)
        canvas = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
        for item in items:
            self._mark(canvas, item)
        width, height = self.size
        if (width, height) != self._size:
            below, beside = height - canvas.shape[0], width - canvas.shape[1]
            canvas = np.asarray(cv2.copyMakeBorder(canvas, 0, below, 0, beside, cv2.BORDER_REPLICATE), dtype=np.uint8)
        boxes_written = [
            self._write(canvas, printable(line), 0.0, self._line_px * row, _BLACK)
            for row, line in enumerate(_header(items, stamp_ns, index))
        ]
        half = 0.4 * self._line_px
        marks = [_Box(u - half, v - half, u + half, v + half) for item in items for u, v in self._points(item).tolist()]
        for item in items:
            boxes_written.append(self._label(canvas, item, boxes_written, marks))
        return canvas

    def _points(self, item: Item) -> FloatArray:
        """The pixels in the enlarged image, ``(n, 2)``; pixel centres stay centres. What is unknown is left out."""
        known = [point for point in item["pixels"] or () if None not in point]
        points = np.asarray(known, dtype=np.float64).reshape(-1, 2)
        return (points + 0.5) * self._scale - 0.5

    def _colour(self, name: str) -> tuple[int, int, int]:
        return self.colours.setdefault(name, COLOURS[len(self.colours) % len(COLOURS)])

    def _mark(self, canvas: ImageArray, item: Item) -> None:
        """Crosses at the pixels, and lines between them, dark around so that they show on everything."""
        far = 16 * max(self._size)
        points = np.rint(np.clip(self._points(item), -far, far)).astype(np.int32)
        colour = self._colour(item["name"])
        size = round(self._line_px * 0.8)
        for paint, stroke in ((_BLACK, 2 * self._stroke), (colour, self._stroke)):
            if len(points) > 1:
                kind = recorded_kind(item["kind"])
                whole = [points[line].reshape(-1, 1, 2) for line in kind.lines(len(points))]
                cv2.polylines(canvas, whole, kind.is_closed, paint, max(stroke // 2, 1), cv2.LINE_AA)
            for u, v in points.tolist():
                cv2.drawMarker(canvas, (u, v), paint, cv2.MARKER_CROSS, size, stroke, cv2.LINE_AA)

    def _label(self, canvas: ImageArray, item: Item, boxes_written: Sequence[_Box], marks: Sequence[_Box]) -> _Box:
        """Write a measurement beside its pixels, where nothing is written yet, and no mark where there is room."""
        text, has_number = printable(label_of(item)), item["status"] == Status.OK
        points = self._points(item)
        inside = points[((points >= 0) & (points < self._size)).all(axis=1)]
        centre = inside.mean(axis=0) if len(inside) else np.array([0.0, self._line_px * 2])
        width = self._font_for(text).getlength(text) + self._line_px
        left = float(np.clip(centre[0] - width / 2, 0, max(self.size[0] - width, 0)))
        lowest = self.size[1] - self._line_px
        wanted = float(np.clip(centre[1] - 1.8 * self._line_px, 0, lowest))
        step = self._line_px / 2
        tops = sorted(np.arange(0, lowest + step / 2, step).tolist(), key=lambda top: abs(top - wanted))
        boxes = [_Box(left, top, left + width, top + self._line_px) for top in (wanted, *tops)]
        free = [box for box in boxes if not any(map(box.overlaps, boxes_written))]
        clear = (box for box in free if not any(map(box.overlaps, marks)))
        top = next(clear, (free or boxes)[0]).top
        return self._write(canvas, text, left, top, self._colour(item["name"]) if has_number else _NO_NUMBER)

    def _write(self, canvas: ImageArray, text: str, left: float, top: float, colour: tuple[int, int, int]) -> _Box:
        font = self._font_for(text)
        width = font.getlength(text) + self._line_px
        box = _Box(left, top, left + width, top + self._line_px)
        # Only the part around the box becomes a picture of Pillow's: a whole one would be held three times more.
        first_u, first_v = int(max(left - self._line_px, 0)), int(max(top - self._line_px, 0))
        part = canvas[first_v : int(box.bottom + self._line_px), first_u : int(box.right + self._line_px)]
        picture = Picture.fromarray(part)
        pen = ImageDraw.Draw(picture)
        left, top = left - first_u, top - first_v
        pen.rectangle((left, top, left + width, top + self._line_px), fill=colour)
        is_light = float(np.dot(colour, (0.299, 0.587, 0.114))) > 128  # noqa: PLR2004 - half of what a byte holds
        ink = _BLACK if is_light else _WHITE
        pen.text((left + self._line_px / 2, top + self._line_px / 2), text, fill=ink, font=font, anchor="lm")
        part[:] = np.asarray(picture, dtype=np.uint8)
        return box

    def _font_for(self, text: str) -> ImageFont.FreeTypeFont:
        """The font, smaller where a line would be wider than the image."""
        room = (self.size[0] - self._line_px) / max(self._font.getlength(text), 1.0)
        return self._font if room >= 1 else self._font.font_variant(size=max(6, int(self._font.size * room)))


def _font_file() -> Path:
    """DejaVu Sans, which matplotlib brings along; to find it by importing that takes 11 MB."""
    found = find_spec("matplotlib")
    if found is None or found.origin is None:
        raise InputError("there is no font to write with", expected="the package matplotlib, which brings one")
    return Path(found.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"


def label_of(item: Item) -> str:
    """A measurement in a few words: name, value and 95 % interval, or its status."""
    name, unit = item["name"], written_unit(item["unit"])
    if item["status"] != Status.OK:
        return f"{name}  {item['status']}"
    if item["value"] is not None:
        space = "" if unit == "°" else " "
        if not item["ci95"]:
            return f"{name}  {item['value']:.2f}{space}{unit}"
        digits = digits_of(item["ci95"][1] - item["ci95"][0])
        low, high = (f"{bound:.{digits}f}" for bound in item["ci95"])
        return f"{name}  {item['value']:.{digits}f}{space}{unit}  [{low} … {high}]"
    return f"{name}  {_place(item)}"


def _place(item: Item) -> str:
    ellipse = item["ellipse95"]
    spread = f"  ± {ellipse['semi_major_m']:.2g} m (95 %)" if ellipse and ellipse["semi_major_m"] is not None else ""
    geo, enu = item["geo"], item["enu_m"]
    if geo and geo[0]["lat_deg"] is not None and geo[0]["lon_deg"] is not None:
        return f"{geo[0]['lat_deg']:.6f}°, {geo[0]['lon_deg']:.6f}°{spread}"
    if enu:
        return f"east {enu[0][0]:.2f} m, north {enu[0][1]:.2f} m{spread}"
    return str(item["status"])


def _header(items: Sequence[Item], stamp_ns: int, index: int) -> list[str]:
    """Lines with the stamp and the pose, one for each."""
    if not items:
        return [f"{_clock(stamp_ns)}  image {index}", "nothing was measured in this image"]
    pose = items[0]["pose"]
    parts = [
        "" if pose["height_agl_m"] is None else f"height {pose['height_agl_m']:.1f} m ({pose['height_source']})",
        "" if pose["tilt_deg"] is None else f"tilt {pose['tilt_deg']:.1f}°",
        "" if pose["heading_deg"] is None else f"heading {pose['heading_deg']:.0f}°",
    ]
    camera = "  ".join(part for part in parts if part)
    return [f"{_clock(int(items[0]['stamp_ns']))}  image {index}  [ … ] 95 %", *([camera] if camera else [])]


def _clock(stamp_ns: int) -> str:
    return f"{time_utc(stamp_ns)[:23].replace('T', ' ')} UTC"


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
class VideoSummary:
    """Counts of images and measurements in a video.

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


def write_video(recording: Recording, path: Path) -> VideoSummary:
    """Write a recording's images with their measurements as MP4; images come when their stamps say.

    Args:
        recording: With images.
        path: The file.

    Raises:
        NoAnswerError: No image was recorded.
        InputError: The recording or its measurements are damaged, or the video cannot be encoded.
        OSError: The file cannot be written.
    """
    images = measured_images(recording)
    first = next(images, None)
    if first is None:
        raise NoAnswerError(
            "the recording holds no image", where=recording.folder, hint="record.image_hz says how many"
        )
    summary = VideoSummary()
    with _VideoWriter(path) as writer:
        try:
            for image, items in chain((first,), images):
                if not writer.add(image, items):
                    summary.damaged_images += 1
                    continue
                summary.images += 1
                summary.measurements += len(items)
            if not summary.images:
                raise InputError("no recorded image can be decoded", where=recording.folder)
            writer.finish()
        except av.FFmpegError as error:
            raise InputError("the video cannot be encoded", where=recording.folder, got=error) from error
    summary.restamped_images = writer.restamped
    return summary


def measured_images(recording: Recording) -> Iterator[tuple[Image, list[Item]]]:
    """The images that have pixels, in order of arrival, each with what was measured in it.

    Raises:
        InputError: The recording or its measurements are damaged.
    """
    store, measurements = PixelStore(recording), _MeasurementsByImage(recording)
    for message in recording.messages():
        if message.channel.schema == IMAGE_SCHEMA:
            image = decode_image(message.data)
            pixels = store.pixels(image)
            if pixels is not None:
                yield replace(image, pixels=pixels), measurements.of(image)


def best_image(
    recording: Recording, colours: Mapping[str, tuple[int, int, int]] | None = None
) -> tuple[Image, ImageArray] | None:
    """The image in which most was measured, the later the better, with that drawn in; RGB.

    Args:
        recording: The recording.
        colours: RGB by probe; those that are not named get some of their own.

    Returns:
        None where no image was recorded.

    Raises:
        InputError: The recording, its measurements or that image are damaged.
    """
    best: tuple[int, Image, list[Item]] | None = None
    for image, items in measured_images(recording):
        answers = sum(item["status"] == Status.OK for item in items)
        if best is None or answers >= best[0]:
            best = answers, image, items
    if best is None or best[1].pixels is None:
        return None
    _, image, items = best
    pixels = best[1].pixels()
    overlay = Overlay(pixels.shape[1], pixels.shape[0])
    overlay.colours.update(colours or {})
    return image, overlay.draw(pixels, items, image.stamp_ns, image.index)


class _MeasurementsByImage:
    """Measurements by image; holds those of a minute."""

    def __init__(self, recording: Recording) -> None:
        self._payloads = recording.measurements()
        self._by_image: dict[int, list[Item]] = {}
        self._by_stamp: dict[int, list[Item]] = {}

    def of(self, image: Image) -> list[Item]:
        """Measurements of an image; to be asked for in order of arrival."""
        for payload in self._payloads:
            item = parse_measurement(payload)
            row_of(item)  # what is no measurement is refused, as in every other format
            index, stamp_ns = item["image"], int(item["stamp_ns"])
            by_key, key = (self._by_stamp, stamp_ns) if index is None else (self._by_image, index)
            by_key.setdefault(key, []).append(item)
            if stamp_ns > image.stamp_ns + _LATE_NS or (index is not None and index > image.index + _AHEAD_IMAGES):
                break
        found = self._by_image.pop(image.index, []) + self._by_stamp.pop(image.stamp_ns, [])
        for index in [each for each in self._by_image if each < image.index]:
            del self._by_image[index]
        for stamp_ns in [each for each in self._by_stamp if each < image.stamp_ns - _LATE_NS]:
            del self._by_stamp[stamp_ns]
        return found


class _VideoWriter:
    """An MP4 file that images are added to, of the size of the first.

    Attributes:
        restamped: Images whose stamp was not after the last one's.
    """

    def __init__(self, path: Path) -> None:
        self.restamped = 0
        self._path = path
        self._open: _OpenVideo | None = None

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
            self._open = _open_video(self._path, Overlay(pixels.shape[1], pixels.shape[0]), image.stamp_ns)
        writer = self._open
        # Drawn in place, and not copied for the encoder: every copy of a picture is megabytes.
        drawn = np.ascontiguousarray(writer.overlay.draw(pixels, items, image.stamp_ns, image.index))
        del pixels
        frame = av.VideoFrame.from_numpy_buffer(drawn, format="rgb24")
        due = round((image.stamp_ns - writer.start_ns) * _TICKS_PER_S / SECOND_NS)
        frame.pts = max(due, writer.last + 1)
        frame.time_base = Fraction(1, _TICKS_PER_S)
        self.restamped += due <= writer.last
        writer.last = frame.pts
        writer.container.mux(writer.stream.encode(frame))
        return True

    def finish(self) -> None:
        """Write out what the encoder holds."""
        if self._open is not None:
            self._open.container.mux(self._open.stream.encode())


@dataclass(slots=True)
class _OpenVideo:
    overlay: Overlay
    start_ns: int
    container: "av.container.OutputContainer"
    stream: "av.VideoStream"
    last: int = -1


def _open_video(path: Path, overlay: Overlay, start_ns: int) -> _OpenVideo:
    container = av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"})
    container.metadata["creation_time"] = time_utc(start_ns)
    stream = container.add_stream("libx264", rate=_GUESSED_HZ, options=_ENCODER)
    stream.width, stream.height = overlay.size
    stream.pix_fmt = "yuv420p"
    stream.codec_context.time_base = Fraction(1, _TICKS_PER_S)
    return _OpenVideo(overlay, start_ns, container, stream)
