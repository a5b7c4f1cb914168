"""What the ground looks like when nobody is there, as a camera that moves sees it: a canvas with its background.

Images are laid onto what one of them saw of the plane; each place of that canvas has a mean and a variance.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.vision.blobs import calm, remember_changes
from aerodft.vision.straight import NODE_PX, OUTSIDE_PX, StraightView, carried, nodes_px

_MARGIN: Final = 0.3  # of the image's size, to each side
_SCALES: Final = (0.75, 1.35)  # seen larger or smaller than that it is time for another canvas

Window = tuple[slice, slice]
_Planes = np.ndarray[tuple[int, ...], np.dtype[np.float32]]

_NEW_STD: Final = 5.0  # standard deviations from the background
_NOISE: Final = 3.0  # grey levels, at least
_ASTRAY_PX: Final = 0.6  # by which images may be laid wrongly: where there are edges, they differ
_FIRST_VARIANCE: Final = 150.0
_LEAST_LOOKS: Final = 4
_YOUNG_LOOKS: Final = 12.0  # of a mean of all looks; then it follows
_VARIANCE_SHARE: Final = 0.05
_STANDING_S: Final = 20.0  # who stands still for so long becomes background
_LEAST_GAIN: Final = 0.3  # the sky still lights what the sun does not
_SHADE_STD: Final = 3.0
_QUARTILES: Final = 1.35  # between them, standard deviations of a normal distribution
_RING: Final = np.ones((5, 5), dtype=np.uint8)


class GroundCanvas:
    """The straight pixels of one image, with margins.

    Args:
        view: Of that image.
        since_first: ``(3, 3)`` homography since the first image, of straight pixels of such views.
    """

    def __init__(self, view: StraightView, since_first: FloatArray) -> None:
        width, height = view.camera.width_px, view.camera.height_px
        self._margin_px = np.array([round(_MARGIN * width), round(_MARGIN * height)], dtype=np.float64)
        self.shape = height + 2 * int(self._margin_px[1]), width + 2 * int(self._margin_px[0])
        self.since_first = since_first
        self._size_px = np.array([width, height], dtype=np.float64)

    def onto(self, since_first: FloatArray) -> FloatArray:
        """``(3, 3)`` from canvas pixels to straight pixels of an image with that homography since the first."""
        back = np.eye(3)
        back[:2, 2] = -self._margin_px
        return np.asarray(since_first @ np.linalg.inv(self.since_first) @ back)

    def window(self, onto: FloatArray) -> Window:
        """The part of the canvas that an image can show."""
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (self._size_px - 1)
        at = carried(np.asarray(np.linalg.inv(onto), dtype=np.float64), corners)
        if not np.all(np.isfinite(at)):
            return slice(0, self.shape[0]), slice(0, self.shape[1])
        low = np.clip(np.floor(np.min(at, axis=0)), 0, None).astype(int)
        high = np.clip(np.ceil(np.max(at, axis=0)) + 1, 0, [self.shape[1], self.shape[0]]).astype(int)
        return slice(int(low[1]), max(int(high[1]), int(low[1]))), slice(int(low[0]), max(int(high[0]), int(low[0])))

    def holds(self, onto: FloatArray) -> bool:
        """Whether an image lies within the canvas, in about its size."""
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]]) * (self._size_px - 1)
        back: FloatArray = np.asarray(np.linalg.inv(onto), dtype=np.float64)
        at = carried(back, corners)
        if not np.all(np.isfinite(at)):
            return False
        inside = np.all((at > -0.1 * self._size_px) & (at < [self.shape[1], self.shape[0]] + 0.1 * self._size_px))
        ends = carried(back, corners[4] + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        scale = np.sqrt(abs(float(np.linalg.det(ends[1:] - ends[0]))))
        return bool(inside and _SCALES[0] <= scale <= _SCALES[1])

    def laid(
        self, pixels: ImageArray, view: StraightView, onto: FloatArray, window: Window
    ) -> tuple[ImageArray, BoolArray]:
        """An image of a view as the canvas shows it, and where it does; of the window only."""
        rows, columns = window
        height, width = rows.stop - rows.start, columns.stop - columns.start
        nodes = view.bent(carried(onto, nodes_px(width, height) + [columns.start, rows.start]))
        nodes = np.nan_to_num(nodes, nan=OUTSIDE_PX).astype(np.float32)
        size = nodes.shape[1] * NODE_PX, nodes.shape[0] * NODE_PX
        columns_px, rows_px = (  # one by one: as a pair they would be rounded otherwise
            cv2.resize(np.ascontiguousarray(nodes[..., k]), size, interpolation=cv2.INTER_LINEAR)[:height, :width]
            for k in (0, 1)
        )
        seen = cv2.remap(pixels, columns_px, rows_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        farthest = self._size_px - 2
        is_seen = (columns_px >= 1) & (columns_px <= farthest[0]) & (rows_px >= 1) & (rows_px <= farthest[1])
        return np.asarray(seen, dtype=np.uint8), np.asarray(is_seen)

    def moved_here(self, planes: np.ndarray, other: "GroundCanvas") -> np.ndarray:
        """What lies on another canvas ``(h, w, ...)`` as it lies on this one; 0 where there is nothing."""
        back = np.eye(3)
        back[:2, 2] = -self._margin_px
        onto = np.linalg.inv(other.onto(np.eye(3))) @ np.linalg.inv(self.since_first) @ back
        return np.asarray(cv2.warpPerspective(planes, np.linalg.inv(onto), self.shape[::-1], flags=cv2.INTER_LINEAR))


@dataclass(slots=True, eq=False)
class GroundBackground:
    """The background of one canvas.

    Attributes:
        mean: ``(height, width, 3)`` BGR.
        variance: ``(height, width)`` of one colour.
        looks: ``(height, width)`` how often a place was seen.
        changes: ``(height, width)`` how often it changes, see ``blobs.remember_changes``.
        last: ``(height, width)`` what was new in the last image that showed it.
    """

    mean: _Planes
    variance: _Planes
    looks: _Planes
    changes: _Planes
    last: _Planes

    @classmethod
    def of(cls, shape: tuple[int, int]) -> "GroundBackground":
        """Nothing yet, of a canvas of that shape."""
        mean, variance = np.zeros((*shape, 3), dtype=np.float32), np.full(shape, _FIRST_VARIANCE, dtype=np.float32)
        return cls(mean, variance, *(np.zeros(shape, dtype=np.float32) for _ in range(3)))

    def begin(self, laid: list[tuple[ImageArray, BoolArray]]) -> None:
        """Take the medians of some images of the whole canvas: who walks is nowhere in most of them."""
        seen = np.all([is_seen for _, is_seen in laid], axis=0)
        rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
        if not len(rows):
            return
        part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        ordered = np.sort(np.stack([each[part] for each, _ in laid]), axis=0)
        inside = seen[part]
        self.mean[part][inside] = ordered[len(laid) // 2][inside]
        spread = (ordered[3 * len(laid) // 4].astype(np.float32) - ordered[len(laid) // 4]) / _QUARTILES
        self.variance[part][inside] = np.mean(spread * spread, axis=-1)[inside]
        self.looks[part][inside] = len(laid)

    def on(self, canvas: GroundCanvas, old: GroundCanvas) -> "GroundBackground":
        """The same on another canvas."""
        looks = canvas.moved_here(self.looks, old)
        edge = cv2.erode((looks > 0).astype(np.uint8), _RING) == 0  # half of what is there beside nothing
        looks[edge] = 0
        variance = canvas.moved_here(self.variance, old)
        variance[edge] = _FIRST_VARIANCE
        mean, changes, last = (canvas.moved_here(each, old) for each in (self.mean, self.changes, self.last))
        return GroundBackground(mean, variance, looks, changes, last)

    def new_in(
        self, seen: ImageArray, is_seen: BoolArray, window: Window, elapsed_s: float
    ) -> tuple[BoolArray, BoolArray]:
        """Where an image ``(h, w, 3)`` that is laid into a window shows something else, and where what may be shade."""
        mean = self.mean[window]
        off = seen.astype(np.float32) - mean
        grey = cv2.cvtColor(mean, cv2.COLOR_BGR2GRAY)
        across, down = cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=0.125)
        allowed = self.variance[window] + _NOISE**2 + _ASTRAY_PX**2 * (across * across + down * down)
        is_new = (_mean_square(off) > _NEW_STD**2 * allowed) & (self.looks[window] >= _LEAST_LOOKS) & is_seen
        now, shown = is_new.astype(np.float32), is_seen.astype(np.float32)
        remember_changes(self.changes[window], self.last[window], now, shown, self.looks[window], elapsed_s)
        is_new &= calm(self.changes[window])
        colours, then = seen[is_new].astype(np.float32), mean[is_new]
        gain = np.einsum("nk,nk->n", colours, then) / np.maximum(np.einsum("nk,nk->n", then, then), 1.0)
        rest = colours - gain[:, None] * then
        rest2 = np.einsum("nk,nk->n", rest, rest) / 3
        shade = np.zeros_like(is_new)
        shade[is_new] = (gain > _LEAST_GAIN) & (gain < 1) & (rest2 < _SHADE_STD**2 * allowed[is_new])
        return np.asarray(is_new), shade

    def learn(self, seen: ImageArray, is_seen: BoolArray, is_new: BoolArray, window: Window, elapsed_s: float) -> None:
        """Take an image in; what is new in it but slowly."""
        looks, mean, variance = self.looks[window], self.mean[window], self.variance[window]
        looks += is_seen
        rate = 1 / np.clip(looks, 1, _YOUNG_LOOKS)
        rate[is_new] = min(elapsed_s / _STANDING_S, 1.0)
        rate *= is_seen
        off = seen.astype(np.float32) - mean
        known = (is_seen & ~is_new & (looks > 1)).astype(np.float32)
        variance += (_mean_square(off) - variance) * (known * np.float32(_VARIANCE_SHARE))
        mean += cv2.multiply(off, cv2.merge([rate, rate, rate]))

    def forget(self, seen: ImageArray, inside: BoolArray, window: Window) -> None:
        """Take what is seen for the background there ``(h, w)``."""
        self.mean[window][inside] = seen[inside]
        self.looks[window][inside] = 1


def _mean_square(colours: _Planes) -> _Planes:
    """``(height, width)`` over the colours ``(height, width, 3)``."""
    return np.asarray(cv2.transform(cv2.multiply(colours, colours), np.full((1, 3), 1 / 3, dtype=np.float32)))
