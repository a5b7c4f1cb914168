"""Lines, crosses, arrows and texts over an image, all with a dark rim and as large as the image asks for."""

from typing import Final

from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from aerodft.model.arrays import FloatArray

REFERENCE_PX: Final = 1920.0
"""Sizes are for a picture as wide as this, and grow and shrink with it."""

TEXT_PX, SMALL_PX = 20.0, 17.0
"""Heights of texts."""

_CROSS_PX, _RING_PX, _THICK_PX, _ARROW_PX, _RIM_PX, _LINE_RIM_PX = 22.0, 11.0, 2.2, 13.0, 2.0, 1.2
_LETTER = 0.58  # width over height of a letter, on the average
_MOST_LETTERS = 48

_Box = tuple[float, float, float, float]


def shortened(text: str, most_letters: int) -> str:
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
        """A polyline ``(k, 2)``."""
        rim = self._rim(width + _LINE_RIM_PX, 0.4)
        thick = self.points(width)
        self._axes.plot(pixels[:, 0], pixels[:, 1], color=colour, linewidth=thick, alpha=alpha, path_effects=rim)

    def cross(self, pixels: FloatArray, colour: str, marker: str = "+") -> None:
        """Crosses ``+`` or ``x``, or rings ``o``, at pixels ``(k, 2)``; no text goes there."""
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
        """From one pixel ``(2,)`` to another, clipped at the image."""
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

    def text(self, text: str, at: FloatArray, colour: str, *, must: bool = False) -> bool:
        """Write beside a pixel ``(2,)``, at the first place that is free.

        Args:
            text: One line; a long one is cut.
            at: The pixel.
            colour: Of the letters.
            must: Write it also where no place is free.

        Returns:
            Whether it was written.
        """
        wide, high = self._extent(text, TEXT_PX)
        gap = 0.75 * high
        places = [(gap, -high), (gap, 0.1 * high), (-gap - wide, -high), (-gap - wide, 0.1 * high)]
        places += [(-wide / 2, -gap - high), (-wide / 2, gap), (2 * gap, -2.2 * high), (2 * gap, 1.5 * high)]
        box = self._place(at, places, (wide, high), must=must)
        return box is not None and self._write(text, box, colour, TEXT_PX)

    def text_on(self, text: str, at: FloatArray, colour: str) -> bool:
        """Write small, close to a pixel ``(2,)`` of a line; as ``text`` otherwise."""
        wide, high = self._extent(text, SMALL_PX)
        gap = 0.2 * high
        places = [(gap, -1.05 * high), (-wide - gap, -1.05 * high), (gap, 0.1 * high)]
        box = self._place(at, places, (wide, high), must=False)
        return box is not None and self._write(text, box, colour, SMALL_PX)

    def _extent(self, text: str, size: float) -> tuple[float, float]:
        high = size * self._pixels
        return _LETTER * high * min(len(text), _MOST_LETTERS), high

    def _place(
        self, at: FloatArray, places: list[tuple[float, float]], extent: tuple[float, float], *, must: bool
    ) -> _Box | None:
        u, v = at.tolist()
        wide, high = extent
        boxes = [(u + du, v + dv, u + du + wide, v + dv + high) for du, dv in places]
        return next((box for box in boxes if self._is_free(box)), boxes[0] if must else None)

    def _is_free(self, box: _Box) -> bool:
        left, top, right, bottom = box
        if left < 0 or top < 0 or right > self._size[0] - 1 or bottom > self._size[1] - 1:
            return False
        return not any(left < r and right > x and top < b and bottom > y for x, y, r, b in self._taken)

    def _write(self, text: str, box: _Box, colour: str, size: float) -> bool:
        self._taken.append(box)
        self._axes.text(
            box[0],
            box[3],
            shortened(text, _MOST_LETTERS),
            color=colour,
            fontsize=self.points(size),
            va="bottom",
            parse_math=False,
            path_effects=self._rim(3.5, 0.8),
            clip_on=True,
        )
        return True
