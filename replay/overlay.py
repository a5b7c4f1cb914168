"""What was measured, drawn into its image: pixels, values, intervals, and statuses where there is no number."""

import math
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from aerodft.errors import InputError
from aerodft.model.arrays import FloatArray, ImageArray
from aerodft.model.probe import ProbeKind
from aerodft.model.status import Status
from replay.table import Item, time_utc

LEAST_HEIGHT_PX: Final = 480
"""Smaller images are enlarged, so that what is written in them can be read."""

_LINES: Final = 32  # lines of text that an image is high
_COLOURS: Final = ((86, 180, 233), (230, 159, 0), (0, 158, 115), (240, 228, 66), (204, 121, 167), (213, 94, 0))
"""RGB; told apart by the colour-blind as well (Okabe and Ito)."""
_NO_NUMBER: Final = (150, 30, 30)
_BLACK, _WHITE = (0, 0, 0), (255, 255, 255)
_UNITS: Final = {"m2": "m²", "deg": "°"}


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
        height_px: Likewise.
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
        taken = [
            self._write(canvas, line, 0.0, self._line_px * row, _BLACK)
            for row, line in enumerate(_header(items, stamp_ns, index))
        ]
        for item in items:
            taken.append(self._label(canvas, item, taken))
        return canvas

    def _points(self, item: Item) -> FloatArray:
        """The pixels in the enlarged image, ``(n, 2)``; pixel centres stay centres. What is unknown is left out."""
        known = [point for point in item["pixels"] or () if None not in point]
        points = np.asarray(known, dtype=np.float64).reshape(-1, 2)
        return (points + 0.5) * self._scale - 0.5

    def _colour(self, name: str) -> tuple[int, int, int]:
        return self.colours.setdefault(name, _COLOURS[len(self.colours) % len(_COLOURS)])

    def _mark(self, canvas: ImageArray, item: Item) -> None:
        """Crosses at the pixels, and lines between them, dark around so that they show on everything."""
        far = 16 * max(self._size)
        points = np.rint(np.clip(self._points(item), -far, far)).astype(np.int32)
        colour = self._colour(item["name"])
        size = round(self._line_px * 0.8)
        for paint, stroke in ((_BLACK, 2 * self._stroke), (colour, self._stroke)):
            if len(points) > 1:
                closed, river = item["kind"] == ProbeKind.AREA, item["kind"] == ProbeKind.RIVER
                lines = [points] if not river else [points[row : row + 2] for row in range(0, len(points), 2)]
                whole = [line.reshape(-1, 1, 2) for line in lines]
                cv2.polylines(canvas, whole, closed, paint, max(stroke // 2, 1), cv2.LINE_AA)
            for u, v in points.tolist():
                cv2.drawMarker(canvas, (u, v), paint, cv2.MARKER_CROSS, size, stroke, cv2.LINE_AA)

    def _label(self, canvas: ImageArray, item: Item, taken: Sequence[_Box]) -> _Box:
        """Write a measurement beside its pixels, where nothing is written yet."""
        text, has_number = label_of(item), item["status"] == Status.OK
        points = self._points(item)
        inside = points[((points >= 0) & (points < self._size)).all(axis=1)]
        centre = inside.mean(axis=0) if len(inside) else np.array([0.0, self._line_px * 2])
        width = self._fitting(text).getlength(text) + self._line_px
        left = float(np.clip(centre[0] - width / 2, 0, max(self.size[0] - width, 0)))
        lowest = self.size[1] - self._line_px
        wanted = float(np.clip(centre[1] - 1.8 * self._line_px, 0, lowest))
        step = self._line_px / 2
        tops = sorted(np.arange(0, lowest + step / 2, step).tolist(), key=lambda top: abs(top - wanted))
        boxes = (_Box(left, top, left + width, top + self._line_px) for top in (wanted, *tops))
        free = next((box for box in boxes if not any(box.overlaps(other) for other in taken)), None)
        top = wanted if free is None else free.top
        return self._write(canvas, text, left, top, self._colour(item["name"]) if has_number else _NO_NUMBER)

    def _write(self, canvas: ImageArray, text: str, left: float, top: float, colour: tuple[int, int, int]) -> _Box:
        font = self._fitting(text)
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

    def _fitting(self, text: str) -> ImageFont.FreeTypeFont:
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
    name, unit = item["name"], _UNITS.get(item["unit"], item["unit"])
    if item["status"] != Status.OK:
        return f"{name}  {item['status']}"
    if item["value"] is not None:
        space = "" if unit == "°" else " "
        if not item["ci95"]:
            return f"{name}  {item['value']:.2f}{space}{unit}"
        digits = _digits(item["ci95"][1] - item["ci95"][0])
        low, high = (f"{bound:.{digits}f}" for bound in item["ci95"])
        return f"{name}  {item['value']:.{digits}f}{space}{unit}  [{low} … {high}]"
    return f"{name}  {_place(item)}"


def _place(item: Item) -> str:
    ellipse = item["ellipse95"]
    spread = f"  ± {ellipse['semi_major_m']:.2g} m" if ellipse and ellipse["semi_major_m"] is not None else ""
    geo, enu = item["geo"], item["enu_m"]
    if geo and geo[0]["lat"] is not None and geo[0]["lon"] is not None:
        return f"{geo[0]['lat']:.6f}°, {geo[0]['lon']:.6f}°{spread}"
    if enu:
        return f"east {enu[0][0]:.2f} m, north {enu[0][1]:.2f} m{spread}"
    return str(item["status"])


def _digits(width: float) -> int:
    """Decimals in which an interval of this width has two digits or three."""
    return 2 if not 0 < width < math.inf else int(np.clip(1 - math.floor(math.log10(width)), 0, 4))


def _header(items: Sequence[Item], stamp_ns: int, index: int) -> list[str]:
    """When and from where: one line for each."""
    if not items:
        return [f"{_clock(stamp_ns)}  image {index}", "nothing was measured in this image"]
    pose = items[0]["pose"]
    parts = [
        "" if pose["height_agl_m"] is None else f"height {pose['height_agl_m']:.1f} m ({pose['height_source']})",
        "" if pose["tilt_deg"] is None else f"tilt {pose['tilt_deg']:.1f}°",
        "" if pose["heading_deg"] is None else f"heading {pose['heading_deg']:.0f}°",
    ]
    camera = "  ".join(part for part in parts if part)
    return [f"{_clock(int(items[0]['stamp_ns']))}  image {index}", *([camera] if camera else [])]


def _clock(stamp_ns: int) -> str:
    return f"{time_utc(stamp_ns)[:23].replace('T', ' ')} UTC"
