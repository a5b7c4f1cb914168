"""The image of a calibration: what was observed, what the calibrated camera makes of it, and metres on the ground."""

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from aerodft.geometry import in_image
from aerodft.model import FloatArray, ImageArray
from aerodft.reports.calibration.ground_grid import Grid, horizon_px
from aerodft.reports.calibration.marks import Mark, from_foot, ground_of, pixels_of
from calibration.pose import State, angles_deg

_MIN_PX, _MAX_PX = 1280, 3840  # of the picture's width
_STRIP_PX, _DPI = 112.0, 100.0
_CANVAS = (0.23, 0.25, 0.28)
_SEEN, _OUTLIER, _ARROW, _HORIZON, _GRID, _NORTH = "#ffd500", "#ff3b30", "#00e5ff", "#ff7ad9", "#ffffff", "#7dff7d"
_TYPICAL_SHARE, _LONGEST_SHARE = 0.03, 0.12  # of the image's width: as long are typical residuals and the largest drawn
_TINY_PX = 1e-6
_NORTH_AT, _NORTH_SHARES = (0.06, 0.88), (0.02, 0.045)  # of the image: where its arrow is, and how long
_NEAR_ENDS = (0.02, 0.98, 0.08, 0.92, 0.15, 0.85)  # of a line: where its text may be
_QUALITY = 92

REFERENCE_PX: Final = 1920.0
"""Sizes are for a picture as wide as this, and grow and shrink with it."""

TEXT_PX, SMALL_PX = 20.0, 17.0
"""Heights of texts."""

_CROSS_PX, _RING_PX, _THICK_PX, _ARROW_PX, _RIM_PX, _LINE_RIM_PX = 22.0, 11.0, 2.2, 13.0, 2.0, 1.2
_LETTER = 0.58  # width over height of a letter, on the average
_MAX_LETTERS = 48

_Box = tuple[float, float, float, float]


def shorten(text: str, most_letters: int) -> str:
    """One line with no more than so many letters."""
    line = "".join(each if each.isprintable() else " " for each in text)
    return line if len(line) <= most_letters else f"{line[: most_letters - 3]}..."


class Pen:
    """Draws in an image's pixels and keeps texts off each other.

    Args:
        axes: What is drawn on.
        size_px: Width and height of the image.
        width_in: Width of the picture in inches.
    """

    def __init__(self, axes: Axes, size_px: tuple[int, int], width_in: float) -> None:
        self._axes, self._size = axes, size_px
        self._points = 72.0 * width_in / REFERENCE_PX
        self._pixels = size_px[0] / REFERENCE_PX
        self._taken: list[_Box] = []

    def points(self, size: float) -> float:
        """A size in points of the figure."""
        return size * self._points

    def _rim(self, size: float, alpha: float = 0.55) -> list[withStroke]:
        return [withStroke(linewidth=self.points(size), foreground=(0.0, 0.0, 0.0, alpha))]

    def line(self, pixels: FloatArray, colour: str, width: float = _THICK_PX, alpha: float = 1.0) -> None:
        """Draw a polyline ``(k, 2)``."""
        rim = self._rim(width + _LINE_RIM_PX, 0.4)
        thick = self.points(width)
        self._axes.plot(pixels[:, 0], pixels[:, 1], color=colour, linewidth=thick, alpha=alpha, path_effects=rim)

    def cross(self, pixels: FloatArray, colour: str, marker: str = "+") -> None:
        """Draw crosses ``+`` or ``x``, or rings ``o``, at pixels ``(k, 2)``; no text goes there."""
        self._axes.plot(
            *pixels.T,
            linestyle="none",
            marker=marker,
            color=colour,
            markerfacecolor="none",
            markersize=self.points(_RING_PX if marker == "o" else _CROSS_PX),
            markeredgewidth=self.points(_THICK_PX),
            path_effects=self._rim(_THICK_PX + _RIM_PX),
        )
        half = _RING_PX * self._pixels
        self._taken += [(u - half, v - half, u + half, v + half) for u, v in pixels.tolist()]

    def arrow(self, start: FloatArray, end: FloatArray, colour: str) -> None:
        """Draw an arrow from one pixel ``(2,)`` to another, clipped at the image."""
        style = {
            "arrowstyle": "-|>",
            "color": colour,
            "linewidth": self.points(_THICK_PX),
            "mutation_scale": self.points(_ARROW_PX),
            "shrinkA": 0.0,
            "shrinkB": 0.0,
            "path_effects": self._rim(_THICK_PX + _RIM_PX),
        }
        ends = {"xy": tuple(end.tolist()), "xytext": tuple(start.tolist())}
        drawn = self._axes.annotate("", **ends, annotation_clip=False, arrowprops=style)
        if drawn.arrow_patch is not None:
            drawn.arrow_patch.set_clip_box(self._axes.bbox)

    def text(self, text: str, at: FloatArray, colour: str, *, must: bool = False, is_small: bool = False) -> bool:
        """Write beside a pixel ``(2,)``, at the first place that is free.

        Args:
            text: One line; a long one is cut.
            at: The pixel.
            colour: Of the letters.
            must: Write it also where no place is free.
            is_small: Write it small and close, as beside a line.

        Returns:
            Whether it was written.
        """
        size = SMALL_PX if is_small else TEXT_PX
        high = size * self._pixels
        wide, gap = _LETTER * high * min(len(text), _MAX_LETTERS), (0.2 if is_small else 0.75) * high
        if is_small:
            places = [(gap, -1.05 * high), (-wide - gap, -1.05 * high), (gap, 0.1 * high)]
        else:
            places = [(gap, -high), (gap, 0.1 * high), (-gap - wide, -high), (-gap - wide, 0.1 * high)]
            places += [(-wide / 2, -gap - high), (-wide / 2, gap), (2 * gap, -2.2 * high), (2 * gap, 1.5 * high)]
        u, v = at.tolist()
        boxes = [(u + du, v + dv, u + du + wide, v + dv + high) for du, dv in places]
        box = next((each for each in boxes if self._is_free(each)), boxes[0] if must else None)
        if box is None:
            return False
        self._taken.append(box)
        self._axes.text(
            box[0],
            box[3],
            shorten(text, _MAX_LETTERS),
            color=colour,
            fontsize=self.points(size),
            va="bottom",
            parse_math=False,
            path_effects=self._rim(3.5, 0.8),
            clip_on=True,
        )
        return True

    def _is_free(self, box: _Box) -> bool:
        left, top, right, bottom = box
        if left < 0 or top < 0 or right > self._size[0] - 1 or bottom > self._size[1] - 1:
            return False
        return not any(left < r and right > x and top < b and bottom > y for x, y, r, b in self._taken)


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Contents of a calibration's picture.

    Attributes:
        state: The calibrated camera.
        marks: The observations, with whether each was left out.
        grid: Metres on the ground.
        image: ``(h, w, 3)`` BGR of the camera's size; None for a plain canvas.
        is_oriented: Whether the heading means anything: landmarks or the file told it.
    """

    state: State
    marks: tuple[tuple[Mark, bool], ...]
    grid: Grid
    image: ImageArray | None
    is_oriented: bool

    @property
    def enlarged(self) -> float:
        """Factor of drawn residuals: 1, 2, 5, 10, ... so that a typical one is seen and none covers much."""
        off = np.array([np.linalg.norm(mark.off_px) for mark, is_outlier in self.marks if not is_outlier])
        known = off[np.isfinite(off)]
        if not np.any(known > _TINY_PX):
            return 1.0
        width = self.state.camera.width_px
        typical, largest = float(np.median(known)), float(np.max(known))
        ideal = min(_TYPICAL_SHARE * width / max(typical, _TINY_PX), _LONGEST_SHARE * width / largest)
        power = 10.0 ** math.floor(math.log10(max(ideal, 1.0)))
        return max((factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= ideal), default=1.0)


def draw_picture(picture: Picture, path: Path) -> tuple[str, ...]:
    """Write the picture as JPEG, as large as the image, but no wider than 3840 and no narrower than 1280 pixels.

    Returns:
        What a reader has to know of it, in sentences.
    """
    camera = picture.state.camera
    width_px = min(max(camera.width_px, _MIN_PX), _MAX_PX)
    image_px, strip_px = camera.height_px * width_px / camera.width_px, _STRIP_PX * width_px / REFERENCE_PX
    figure = Figure(figsize=(width_px / _DPI, (image_px + strip_px) / _DPI), dpi=_DPI, facecolor="white")
    share = strip_px / (image_px + strip_px)
    axes, strip = (figure.add_axes(box) for box in ((0.0, share, 1.0, 1.0 - share), (0.0, 0.0, 1.0, share)))
    pen = Pen(axes, (camera.width_px, camera.height_px), width_px / _DPI)
    _draw_background(picture, axes)
    _draw_lines(picture, pen)
    _draw_foot(picture, pen)
    _draw_north(picture, pen)
    enlarged = picture.enlarged
    for mark, is_outlier in picture.marks:
        _draw_mark(mark, pen, enlarged, is_outlier=is_outlier)
    notes = _name_marks(picture, pen)
    _name_lines(picture, pen)
    _draw_strip(picture, strip, pen)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # names are in any script
        figure.savefig(path, dpi=_DPI, format="jpg", pil_kwargs={"quality": _QUALITY, "subsampling": 0})
    return notes


def _draw_background(picture: Picture, axes: Axes) -> None:
    camera, image = picture.state.camera, picture.image
    extent = (-0.5, camera.width_px - 0.5, camera.height_px - 0.5, -0.5)
    shown = np.full((1, 1, 3), _CANVAS) if image is None else image[..., ::-1]
    axes.imshow(shown, extent=extent, aspect="auto", interpolation="antialiased")
    axes.set(xlim=extent[:2], ylim=extent[2:], autoscale_on=False)
    axes.set_axis_off()


def _draw_lines(picture: Picture, pen: Pen) -> None:
    """The ground's lines and the horizon."""
    finest = min((line.spacing_m for line in picture.grid.lines), default=0.0)
    for line in picture.grid.lines:
        width, alpha = (1.8, 0.9) if line.spacing_m > finest else (1.4, 0.8)
        pen.line(line.pixels_px, _GRID, width, alpha)
    for piece in horizon_px(picture.state):
        pen.line(piece, _HORIZON, 2.5)


def _draw_mark(mark: Mark, pen: Pen, enlarged: float, *, is_outlier: bool) -> None:
    colour = _OUTLIER if is_outlier else _SEEN
    for first, last in mark.lines:
        pen.line(mark.seen_px[[first, last]], colour)
    pen.cross(mark.seen_px, colour, "+" if mark.kind in ("landmark", "ground") else "o")
    for start, off in zip(mark.seen_px, mark.expected_px - mark.seen_px, strict=True):
        if np.all(np.isfinite(off)):
            pen.arrow(start, start + (off if is_outlier else enlarged * off), _OUTLIER if is_outlier else _ARROW)


def _draw_foot(picture: Picture, pen: Pen) -> None:
    """The point straight below the camera, where it is in the image."""
    state = picture.state
    foot = state.position_m.copy()
    foot[2] = picture.grid.axes.elevation_m
    pixel = pixels_of(state, foot)
    if in_image(state.camera, pixel):
        pen.cross(pixel[None], _NORTH, "x")
        pen.text("camera's foot", pixel, _NORTH, must=True)


def _draw_north(picture: Picture, pen: Pen) -> None:
    """An arrow over the ground to the north; straight ahead where nobody knows where that is."""
    state, camera = picture.state, picture.state.camera
    anchor = np.array([camera.width_px * _NORTH_AT[0], camera.height_px * _NORTH_AT[1]])
    start = ground_of(state, anchor, picture.grid.axes.elevation_m)
    ahead = from_foot(state, np.array([0.0, 1.0]), 0.0)[:2] - state.position_m[:2]
    towards = np.array([0.0, 1.0, 0.0]) if picture.is_oriented else np.append(ahead, 0.0)
    away = pixels_of(state, start + 1e-3 * np.linalg.norm(start - state.position_m) * towards) - anchor
    length = float(np.linalg.norm(away))
    if not length > 0:  # NaN too: no ground is seen there
        return
    before, after = (share * camera.width_px * away / length for share in _NORTH_SHARES)
    pen.arrow(anchor - before, anchor + after, _NORTH)
    pen.text("N" if picture.is_oriented else "ahead", anchor + after, _NORTH, must=True)


def _name_marks(picture: Picture, pen: Pen) -> tuple[str, ...]:
    """Names beside their marks where there is room, of outliers always."""
    missing = 0
    for mark, is_outlier in sorted(picture.marks, key=lambda pair: not pair[1]):
        text = f"{mark.text} (left out)" if is_outlier else mark.text
        middles = [mark.seen_px[list(pair)].mean(axis=0) for pair in mark.lines] or [mark.seen_px[0]]
        chosen = middles if mark.kind in ("parallel", "right_angle") else middles[:1]
        colour = _OUTLIER if is_outlier else _SEEN
        written = [pen.text(text, at, colour, must=is_outlier) for at in chosen]
        missing += not any(written)
    return (f"There was no room for {missing} of {len(picture.marks)} names.",) if missing else ()


def _name_lines(picture: Picture, pen: Pen) -> None:
    """Texts near the ends of lines, first the end that is lower in the image, where there is room."""
    named = [("horizon", piece, _HORIZON) for piece in horizon_px(picture.state)]
    coarse_first = sorted(picture.grid.lines, key=lambda line: -line.spacing_m)
    named += [(picture.grid.text(line), line.pixels_px, _GRID) for line in coarse_first]
    for text, pixels, colour in named:
        ordered = pixels if pixels[0, 1] > pixels[-1, 1] else pixels[::-1]
        any(pen.text(text, _along(ordered, share), colour, is_small=True) for share in _NEAR_ENDS)


def _along(pixels: FloatArray, share: float) -> FloatArray:
    return np.asarray(pixels[round(share * (len(pixels) - 1))])


def _draw_strip(picture: Picture, strip: Axes, pen: Pen) -> None:
    """Below the image: what the colours are, and the camera and the grid in a line each."""
    size = pen.points(TEXT_PX)
    length = f"{picture.enlarged:g} times as long" if picture.enlarged > 1 else "true length"
    seen, off, out, sky = (
        Line2D([], [], color=colour, markersize=pen.points(TEXT_PX), linewidth=pen.points(2.5))
        for colour in (_SEEN, _ARROW, _OUTLIER, _HORIZON)
    )
    seen.set(marker="+", linestyle="none", label="observed", markeredgewidth=pen.points(2.2))
    off.set(marker=">", markersize=size / 2, label=f"to where it should be, {length}")
    out.set(marker="+", label="left out, true length", markeredgewidth=pen.points(2.2))
    sky.set(label="horizon")
    handles = [seen, off, *([out] if any(is_outlier for _, is_outlier in picture.marks) else [])]
    handles += [sky] if horizon_px(picture.state) else []
    keys = {"facecolor": _CANVAS, "labelcolor": "white", "borderaxespad": 0.2, "fontsize": size}
    strip.legend(handles=handles, loc="upper left", ncols=len(handles), **keys)
    strip.set_axis_off()
    tilt, roll, heading = angles_deg(picture.state)
    height = float(picture.state.position_m[2]) - picture.grid.axes.elevation_m
    words = f"camera {height:.2f} m above the grid, tilt {tilt:.2f} deg, roll {roll:.2f} deg"
    words += f", heading {round(heading, 2) % 360:.2f} deg" if picture.is_oriented else ""
    strip.text(0.004, 0.36, words, fontsize=size)
    strip.text(0.004, 0.08, picture.grid.note if picture.grid.lines else "no ground in view", fontsize=size)
