"""What the ground looks like when nobody is there: mean and variance of each place of a canvas, once it was seen."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, ImageArray
from aerodft.vision.ground_canvas import GroundCanvas, Window
from aerodft.vision.restless import calm, remember_changes

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


@dataclass(slots=True, eq=False)
class GroundBackground:
    """The background of one canvas.

    Attributes:
        mean: ``(height, width, 3)`` BGR.
        variance: ``(height, width)`` of one colour.
        looks: ``(height, width)`` how often a place was seen.
        changes: ``(height, width)`` how often it changes, see ``restless``.
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
