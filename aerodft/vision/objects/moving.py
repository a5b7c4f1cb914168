"""What moves: before a fixed camera by background subtraction (MOG2, Zivkovic 2004), over the ground from a drone.

There the ground is held still as for tracked probes (``plane_lock``): images are laid onto a canvas of what one of them
saw of it, each place of which has a mean and a variance, and what differs from that background is new. What stands up
from the ground is shifted when the camera moves on: ``ground_tracks`` tells it from what walks. What is new in an image
is cleaned: without shadows, grains and fringes, as the outlines of objects.
"""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import Ground
from aerodft.model import BoolArray, Camera, FloatArray, Image, ImageArray, Observation
from aerodft.service import OBJECTS, ObjectSettings
from aerodft.vision.camera_motion import allowed_outside
from aerodft.vision.common import (
    NODE_PX,
    OUTSIDE_PX,
    PlaneImage,
    PlanePoses,
    PoseOf,
    UndistortedView,
    apply_homography,
    nodes_px,
)
from aerodft.vision.plane_lock import PlaneLock

_SLACK_PX: Final = 0.3  # staircases of a mask are no corners
_BRIGHTEST_GAIN: Final = 0.9  # what is brighter than this share of the background is in no shadow
_DARKEST_GAIN: Final = 0.25  # the sky still lights what the sun does not
_WINDOW_PX: Final = 5
_SAME_COLOUR: Final = 0.025  # of red and green over the sum of all three ...
_COLOUR_NOISE: Final = 3.0  # ... and of that sum, in grey levels
_SAME_TEXTURE: Final = 0.07  # of the brightness: what is left when the background times the gain is taken away
_TEXTURE_NOISE: Final = 3.0  # grey levels
_MARGIN_PX: Final = 4
_GRAIN: Final = np.ones((3, 3), dtype=np.uint8)
_GAPS: Final = np.ones((9, 5), dtype=np.uint8)  # what a belt or a shadow leaves between two parts of one object
_FRINGE: Final = 0.05  # of an object's height: what is thinner hangs on to it, the border of its shadow for one
_SCRAP: Final = 0.15  # of what casts a shadow: what is left of the shadow has less
_GHOST: Final = 0.6  # of how much the background differs from what is around, where the image does
_RING_PX: Final = 8
_AROUND: Final = np.ones((5, 5), dtype=np.uint8)
_ONE: Final = 2  # connected component, beside what is none

MOST_OUTLINES: Final = 30
"""Where more than these seem to move in one image, nothing can be told from water or leaves."""

TOO_MANY: Final = "more seems to move than persons or vehicles do: water, leaves, another light? ignore says where"
_REMEMBERED_S: Final = 10.0
_MOST_FLICKER: Final = 0.1  # changes an image: two persons in a second that walk past change a place as often
_STABLE_LOOKS: Final = 25.0  # that are taken for granted
_AROUND_PX: Final = 17

Planes = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
Background = ImageArray | Planes
_MARGIN: Final = 0.3  # of the image's size, to each side
_SCALES: Final = (0.75, 1.35)  # seen larger or smaller than that it is time for another canvas

Window = tuple[slice, slice]

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
_HISTORY: Final = 500
_APART: Final = 25.0  # squared standard deviations from the background
_SHADOW: Final = 127  # MOG2's label
_LEARNED: Final = 5  # looks, until the background is one
_BY_ITSELF: Final = -1.0  # MOG2's own rate of learning
_BACKGROUND_SHARE: Final = 0.1  # ... this share of its memory
_ANOTHER_VIEW: Final = 0.5  # of the image: where more than this is new, light or camera have changed
_BACKGROUND_LOOKS: Final = 15  # it changes slowly, and takes as long to read as all the rest
_COARSE: Final = 4  # pixels of which one is made, to remember what changes
_DECIMALS: Final = 2
_ABOUT_PX: Final = 1280  # images are compared at about this width
_GROUND_NOT_HELD: Final = 0.4  # of what is seen: where more than this is new, the ground was not held
_LOST_S: Final = 1.0  # held no more for so long: begun anew
_FIRST_LOOKS: Final = 10  # whose median is the first background
_EDGE_PX: Final = 3.0  # what touches the image's border is cut off: it has no foot


def outlines_of(mask: BoolArray, slack_px: float = _SLACK_PX) -> list[FloatArray]:
    """The outer borders of what is connected in a mask ``(height, width)``.

    A pixel is a square of side 1 around its centre, so a mask of one pixel has an outline of area 1.

    Args:
        mask: What belongs to objects.
        slack_px: How far a border may be off where it is made of fewer corners; 0 for every corner.

    Returns:
        ``(n, 2)`` each, the largest first.
    """
    if not np.any(mask):
        return []
    rows, columns = np.flatnonzero(np.any(mask, axis=1)), np.flatnonzero(np.any(mask, axis=0))
    top, left = int(rows[0]), int(columns[0])
    part = mask[top : rows[-1] + 1, left : columns[-1] + 1].astype(np.uint8)
    # On a grid of half pixels, borders between pixels have points of their own.
    halves = np.zeros((2 * part.shape[0] + 1, 2 * part.shape[1] + 1), dtype=np.uint8)
    halves[1::2, 1::2] = part
    found, _ = cv2.findContours(cv2.dilate(halves, _GRAIN), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    found = sorted(found, key=cv2.contourArea, reverse=True)
    if slack_px > 0:
        found = [cv2.approxPolyDP(border, 2 * slack_px, closed=True) for border in found]
    return [border[:, 0].astype(np.float64) / 2 + [left - 0.5, top - 0.5] for border in found]


def shadows(image: ImageArray, background: ImageArray, labelled: BoolArray) -> BoolArray:
    """Mask of shadows among what is not background.

    Args:
        image: ``(height, width, 3)`` BGR.
        background: ``(height, width, 3)`` BGR of the place without objects.
        labelled: ``(height, width)``: where somebody else sees a shadow.

    Returns:
        ``(height, width)``.
    """
    now, then = _smooth(image), _smooth(background)
    now_sum, then_sum = _total(now) + 1.0, _total(then) + 1.0
    gain = now_sum / then_sum
    darker = (gain > _DARKEST_GAIN) & (gain < _BRIGHTEST_GAIN)
    green, red = (np.abs(now[..., k] / now_sum - then[..., k] / then_sum) for k in (1, 2))
    same_colour = np.maximum(green, red) < _SAME_COLOUR + _COLOUR_NOISE / now_sum
    same_texture = _roughness(image, background, gain) < _TEXTURE_NOISE + _SAME_TEXTURE * now_sum / 3
    seen = (same_colour & same_texture) | (labelled & (same_colour | same_texture))
    return np.asarray(darker & seen)


def _smooth(image: ImageArray) -> Planes:
    return np.asarray(cv2.blur(image.astype(np.float32), (_WINDOW_PX, _WINDOW_PX)))


def _total(image: Planes) -> Planes:
    return image[..., 0] + image[..., 1] + image[..., 2]


def _roughness(image: ImageArray, background: ImageArray, gain: Planes) -> Planes:
    """Root mean square of what the gain does not explain, grey levels ``(height, width)``."""
    now, then = (_total(each.astype(np.float32)) / 3 for each in (image, background))
    rest = now - gain * then
    return np.asarray(np.sqrt(cv2.blur(rest * rest, (_WINDOW_PX, _WINDOW_PX))))


def without_shadows(
    pixels: ImageArray, background: ImageArray, new: BoolArray, labelled: BoolArray, min_area_px: int
) -> BoolArray:
    """Mask of what is new and in no shadow; computed only where there is something.

    Args:
        pixels: ``(height, width, 3)`` BGR.
        background: ``(height, width, 3)`` BGR of the place without objects.
        new: ``(height, width)``.
        labelled: ``(height, width)``: where somebody else sees a shadow.
        min_area_px: What covers fewer pixels is noise.
    """
    mask = cv2.morphologyEx(new.astype(np.uint8), cv2.MORPH_OPEN, _GRAIN)
    _, parts, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    for number, (left, top, width, height, area) in enumerate(stats.tolist()):
        if number and area >= min_area_px:
            rows = slice(max(top - _MARGIN_PX, 0), top + height + _MARGIN_PX)
            part = rows, slice(max(left - _MARGIN_PX, 0), left + width + _MARGIN_PX)
            shade = shadows(pixels[part], background[part], labelled[part])
            mine = parts[part] == number
            mask[part][mine & (shade | _small_parts(mine & ~shade))] = 0
    return np.asarray(mask > 0)


def _small_parts(mask: BoolArray) -> BoolArray:
    """Small parts of a mask ``(height, width)`` beside the largest: rests of a shadow."""
    _, parts, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = stats[:, cv2.CC_STAT_AREA]
    small = areas < _SCRAP * np.max(areas[1:], initial=0)
    small[0] = False
    return np.asarray(small[parts])


def objects_in(mask: BoolArray, min_area_px: int) -> list[FloatArray]:
    """Outlines ``(n, 2)`` of a mask ``(height, width)`` without grains, its gaps closed, the largest first."""
    found = outlines_of(_whole(mask, min_area_px))
    return [outline for outline in found if len(outline) >= 3]  # noqa: PLR2004 - a triangle's corners


def is_ghost(pixels: ImageArray, background: Background, new: BoolArray, outline: FloatArray) -> bool:
    """Whether somebody has left there since it was learned: the image is there as around it, the background is not.

    Args:
        pixels: ``(height, width, 3)`` BGR.
        background: ``(height, width, 3)`` BGR that was learned.
        new: ``(height, width)`` where the two differ.
        outline: ``(n, 2)`` of what may be one.
    """
    low = np.maximum(np.floor(outline.min(axis=0)).astype(int) - _RING_PX, 0)
    high = np.ceil(outline.max(axis=0)).astype(int) + _RING_PX + 1
    part = slice(low[1], high[1]), slice(low[0], high[0])
    mask = np.zeros(new[part].shape, dtype=np.uint8)
    cv2.fillPoly(mask, [np.round(outline - low).astype(np.int32)], 1)
    ring = (cv2.dilate(mask, _AROUND, iterations=_RING_PX // 2) > mask) & ~new[part]
    if not ring.any() or not mask.any():
        return False
    around = np.mean(pixels[part][ring], axis=0)
    now, then = (np.mean(each[part][mask > 0], axis=0) for each in (pixels, background))
    return bool(np.linalg.norm(now - around) < _GHOST * np.linalg.norm(then - around))


def _without_fringe(mask: ImageArray) -> BoolArray:
    """One object ``(height, width)`` without what hangs on to it; with it, where it would fall apart."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, [max(3, round(_FRINGE * len(mask)) | 1)] * 2)
    smooth = cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)
    parts, _ = cv2.connectedComponents(smooth, connectivity=8)
    return np.asarray((smooth if parts == _ONE else mask) > 0)


def _whole(mask: BoolArray, min_area_px: int) -> BoolArray:
    """A mask without grains, its gaps closed, of parts of at least so many pixels."""
    clean = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _GRAIN)  # first, or borders of shadows grow
    clean = cv2.morphologyEx(clean, cv2.MORPH_CLOSE, _GAPS)
    _, parts, stats, _ = cv2.connectedComponentsWithStats(clean, connectivity=8)
    whole = np.zeros_like(clean)
    for number, (left, top, width, height, area) in enumerate(stats.tolist()):
        if number == 0 or area < min_area_px:
            continue
        part = slice(top, top + height), slice(left, left + width)
        whole[part][_without_fringe((parts[part] == number).astype(np.uint8))] = 1
    return np.asarray(whole > 0)


def remember_changes(
    share: Planes, last: Planes, new: Planes, seen: Planes, looks: Planes | float, elapsed_s: float
) -> None:
    """Add an image's changes to how often each place changes; all ``(height, width)``, 0 to 1.

    Args:
        share: Of the images, in which it changed; changed in place.
        last: What was new in the image before; changed in place.
        new: What is new in this one.
        seen: What this one shows.
        looks: How often each place was seen.
        elapsed_s: Since the last one.
    """
    later = min(1 - math.exp(-elapsed_s / _REMEMBERED_S), 0.1)
    rate = np.maximum(np.float32(1) / (looks + np.float32(_STABLE_LOOKS)), np.float32(later))
    share += (cv2.absdiff(new, last) - share) * (seen * rate)
    last += (new - last) * seen


def stable_mask(share: Planes) -> BoolArray:
    """Mask ``(height, width)`` of places calm enough to detect motion."""
    return np.asarray(cv2.blur(share, (_AROUND_PX, _AROUND_PX)) < _MOST_FLICKER)


class GroundCanvas:
    """The straight pixels of one image, with margins.

    Args:
        view: Of that image.
        since_first: ``(3, 3)`` homography since the first image, of straight pixels of such views.
    """

    def __init__(self, view: UndistortedView, since_first: FloatArray) -> None:
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
        at = apply_homography(np.asarray(np.linalg.inv(onto), dtype=np.float64), corners)
        if not np.all(np.isfinite(at)):
            return slice(0, self.shape[0]), slice(0, self.shape[1])
        low = np.clip(np.floor(np.min(at, axis=0)), 0, None).astype(int)
        high = np.clip(np.ceil(np.max(at, axis=0)) + 1, 0, [self.shape[1], self.shape[0]]).astype(int)
        return slice(int(low[1]), max(int(high[1]), int(low[1]))), slice(int(low[0]), max(int(high[0]), int(low[0])))

    def holds(self, onto: FloatArray) -> bool:
        """Whether an image lies within the canvas, in about its size."""
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]]) * (self._size_px - 1)
        back: FloatArray = np.asarray(np.linalg.inv(onto), dtype=np.float64)
        at = apply_homography(back, corners)
        if not np.all(np.isfinite(at)):
            return False
        inside = np.all((at > -0.1 * self._size_px) & (at < [self.shape[1], self.shape[0]] + 0.1 * self._size_px))
        ends = apply_homography(back, corners[4] + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        scale = np.sqrt(abs(float(np.linalg.det(ends[1:] - ends[0]))))
        return bool(inside and _SCALES[0] <= scale <= _SCALES[1])

    def warp(
        self, pixels: ImageArray, view: UndistortedView, onto: FloatArray, window: Window
    ) -> tuple[ImageArray, BoolArray]:
        """An image of a view as the canvas shows it, and where it does; of the window only."""
        rows, columns = window
        height, width = rows.stop - rows.start, columns.stop - columns.start
        nodes = view.distort(apply_homography(onto, nodes_px(width, height) + [columns.start, rows.start]))
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

    def warp_from(self, planes: np.ndarray, other: "GroundCanvas") -> np.ndarray:
        """Planes of another canvas ``(h, w, ...)`` warped onto this one; 0 where there is nothing."""
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
        changes: ``(height, width)`` how often it changes, see :func:`remember_changes`.
        last: ``(height, width)`` what was new in the last image that showed it.
    """

    mean: Planes
    variance: Planes
    looks: Planes
    changes: Planes
    last: Planes

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> "GroundBackground":
        """Nothing yet, of a canvas of that shape."""
        mean, variance = np.zeros((*shape, 3), dtype=np.float32), np.full(shape, _FIRST_VARIANCE, dtype=np.float32)
        return cls(mean, variance, *(np.zeros(shape, dtype=np.float32) for _ in range(3)))

    def begin(self, warped: list[tuple[ImageArray, BoolArray]]) -> None:
        """Take the medians of some images of the whole canvas: who walks is nowhere in most of them."""
        seen = np.all([is_seen for _, is_seen in warped], axis=0)
        rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
        if not len(rows):
            return
        part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        ordered = np.sort(np.stack([each[part] for each, _ in warped]), axis=0)
        inside = seen[part]
        self.mean[part][inside] = ordered[len(warped) // 2][inside]
        spread = (ordered[3 * len(warped) // 4].astype(np.float32) - ordered[len(warped) // 4]) / _QUARTILES
        self.variance[part][inside] = np.mean(spread * spread, axis=-1)[inside]
        self.looks[part][inside] = len(warped)

    def on_canvas(self, canvas: GroundCanvas, old: GroundCanvas) -> "GroundBackground":
        """The background on another canvas."""
        looks = canvas.warp_from(self.looks, old)
        edge = cv2.erode((looks > 0).astype(np.uint8), _RING) == 0  # half of what is there beside nothing
        looks[edge] = 0
        variance = canvas.warp_from(self.variance, old)
        variance[edge] = _FIRST_VARIANCE
        mean, changes, last = (canvas.warp_from(each, old) for each in (self.mean, self.changes, self.last))
        return GroundBackground(mean, variance, looks, changes, last)

    def new_in(
        self, seen: ImageArray, is_seen: BoolArray, window: Window, elapsed_s: float
    ) -> tuple[BoolArray, BoolArray]:
        """Masks of an image ``(h, w, 3)`` in a window: differing from the background, and possibly shade."""
        mean = self.mean[window]
        off = seen.astype(np.float32) - mean
        grey = cv2.cvtColor(mean, cv2.COLOR_BGR2GRAY)
        across, down = cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=0.125)
        allowed = self.variance[window] + _NOISE**2 + _ASTRAY_PX**2 * (across * across + down * down)
        is_new = (_mean_square(off) > _NEW_STD**2 * allowed) & (self.looks[window] >= _LEAST_LOOKS) & is_seen
        now, shown = is_new.astype(np.float32), is_seen.astype(np.float32)
        remember_changes(self.changes[window], self.last[window], now, shown, self.looks[window], elapsed_s)
        is_new &= stable_mask(self.changes[window])
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


def _mean_square(colours: Planes) -> Planes:
    """``(height, width)`` over the colours ``(height, width, 3)``."""
    return np.asarray(cv2.transform(cv2.multiply(colours, colours), np.full((1, 3), 1 / 3, dtype=np.float32)))


class MovingObjects:
    """Implements ``service.ports.ImageObserver``: an observation of every outline, one without any where none is seen.

    What stands still for some 20 s becomes background.

    Args:
        camera: The camera.
        settings: What is looked for.

    Attributes:
        restless: Images so far in which too much seemed to move.
    """

    def __init__(self, camera: Camera, settings: ObjectSettings) -> None:
        self._settings = settings
        self._allowed = allowed_outside(settings.ignore, camera.width_px, camera.height_px)
        self._subtractor = cv2.createBackgroundSubtractorMOG2(_HISTORY, _APART, detectShadows=True)
        self._background: ImageArray | None = None
        self.flickering = 0
        self._changes: tuple[Planes, Planes] | None = None
        self._looks = 0
        self._last_ns: int | None = None

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """Outlines of what moves.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        last_ns, self._last_ns = self._last_ns, image.stamp_ns
        elapsed_s = 0.0 if last_ns is None else max(image.stamp_ns - last_ns, 0) / SECOND_NS
        seen = observations_of(self.outlines(image.pixels(), elapsed_s), image, self._settings.std_px)
        self.flickering += bool(seen[0].unseen)
        return seen

    def outlines(self, pixels: ImageArray, elapsed_s: float = 0.1) -> list[FloatArray]:
        """Outlines ``(n, 2)`` of what moves in the next image ``(height, width, 3)`` BGR, the largest first.

        Args:
            pixels: The image.
            elapsed_s: Since the last one.
        """
        rate = _BY_ITSELF if self._looks < _LEARNED else min(_BACKGROUND_SHARE * elapsed_s / _STANDING_S, 0.05)
        labels = np.asarray(self._subtractor.apply(pixels, learningRate=rate), dtype=np.uint8)
        self._looks += 1
        new = np.asarray(labels > 0) & self._allowed
        if self._looks <= _LEARNED:
            return []
        stable_mask = self._stable_mask(new, elapsed_s)
        if np.count_nonzero(new) > _ANOTHER_VIEW * new.size:
            self._subtractor = cv2.createBackgroundSubtractorMOG2(_HISTORY, _APART, detectShadows=True)
            self._background, self._looks = None, 0
            return []
        mask = new = np.asarray(new & stable_mask)
        if self._background is None or self._looks % _BACKGROUND_LOOKS == 0:
            self._background = np.asarray(self._subtractor.getBackgroundImage(), dtype=np.uint8)
        background = self._background
        if self._settings.shadows:
            labelled = np.asarray(labels == _SHADOW)
            mask = without_shadows(pixels, background, new, labelled, self._settings.min_area_px)
        found = objects_in(mask, self._settings.min_area_px)
        return [outline for outline in found if not is_ghost(pixels, background, new, outline)]

    def _stable_mask(self, new: BoolArray, elapsed_s: float) -> BoolArray:
        """Mask ``(height, width)`` of places calm enough to detect motion, with what is new in the next image."""
        size = new.shape[1] // _COARSE, new.shape[0] // _COARSE
        now = np.asarray(cv2.resize(new.astype(np.float32), size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        if self._changes is None:
            self._changes = np.zeros_like(now), now.copy()
        remember_changes(*self._changes, now, np.ones_like(now), self._looks, elapsed_s)
        mask = cv2.resize(
            stable_mask(self._changes[0]).astype(np.uint8), new.shape[::-1], interpolation=cv2.INTER_NEAREST
        )
        return np.asarray(mask > 0)


def observations_of(outlines: list[FloatArray], image: Image, std_px: float) -> tuple[Observation, ...]:
    """One observation for each outline ``(n, 2)``; one without any where there are none, or too many."""
    too_many = len(outlines) > MOST_OUTLINES
    rounded = [np.round(outline, _DECIMALS).tolist() for outline in ([] if too_many else outlines)]
    contours = [tuple((u, v) for u, v in outline) for outline in rounded]
    return tuple(
        Observation.in_image(image, OBJECTS, std_px=std_px, contour=contour, unseen=TOO_MANY if too_many else "")
        for contour in contours or [()]
    )


class MovingOverGround:
    """Implements ``service.ports.ImageObserver``, as :class:`MovingObjects` does for a camera that stands still.

    Args:
        camera: The camera.
        settings: What is looked for.
        pose_of: The pose at an image's stamp, about; None where it is not known.
        ground: None for the level plane at 0; else the level of what is seen in the middle counts.

    Attributes:
        restless: Images so far in which too much seemed to move.
    """

    def __init__(self, camera: Camera, settings: ObjectSettings, pose_of: PoseOf, ground: Ground | None = None) -> None:
        self.flickering = 0
        self._settings, self._ground = settings, ground
        self._allowed = allowed_outside(settings.ignore, camera.width_px, camera.height_px)
        self._all_allowed = bool(np.all(self._allowed))
        self._small, self._view = UndistortedView(camera), UndistortedView(camera, _ABOUT_PX)
        self._plane_poses = PlanePoses(camera, self._small, pose_of)
        self._to_view = self._view.intrinsics @ np.linalg.inv(self._small.intrinsics)
        self._lock: PlaneLock | None = None
        self._canvas: GroundCanvas | None = None
        self._background = GroundBackground.empty((0, 0))
        self._first: list[tuple[ImageArray, BoolArray]] | None = []
        self._last_s = self._held_s = 0.0
        self._epoch_ns: int | None = None

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """Outlines of what moves.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        self._epoch_ns = image.stamp_ns if self._epoch_ns is None else self._epoch_ns
        time_s = (image.stamp_ns - self._epoch_ns) / SECOND_NS
        outlines = self._outlines(image, image.pixels(), time_s)
        seen = observations_of(outlines, image, self._settings.std_px)
        self.flickering += bool(seen[0].unseen)
        return seen

    def _outlines(self, image: Image, pixels: ImageArray, time_s: float) -> list[FloatArray]:
        since_first, view = self._held(image, pixels, time_s)
        if since_first is None:
            return []
        if self._canvas is None:
            self._canvas = GroundCanvas(self._view, since_first)
            self._background, self._first = GroundBackground.empty(self._canvas.shape), []
        elif not self._canvas.holds(self._canvas.onto(since_first)):
            canvas = GroundCanvas(self._view, since_first)
            self._background, self._canvas = self._background.on_canvas(canvas, self._canvas), canvas
        elapsed_s, self._last_s = time_s - self._last_s, time_s
        return self._new_on(self._canvas, self._view.shrunk_image(pixels), view, since_first, elapsed_s)

    def _held(self, image: Image, pixels: ImageArray, time_s: float) -> tuple[FloatArray | None, UndistortedView]:
        """Homography since the first image, and the view as it is zoomed; None where the ground is not held."""
        seen = self._plane_poses.image_pose(image)
        if self._lock is None and self._ground is not None and seen is not None:
            middle = np.array([pixels.shape[1] - 1, pixels.shape[0] - 1]) / 2
            self._plane_poses.find_plane(seen, middle, self._ground, 0.0)
        plane_pose, view = self._plane_poses.plane_pose(seen), self._plane_poses.view_of(seen)
        now = PlaneImage(self._small.small(pixels), view, time_s, plane_pose)
        zoomed = self._view if seen is None else self._plane_poses.zoomed(self._view, seen)
        if self._lock is None or time_s - self._held_s > _LOST_S:
            if plane_pose is None:
                return None, zoomed
            size = self._small.camera
            middle_px = np.array([[size.width_px / 2, size.height_px / 2]])
            self._lock, self._canvas, self._held_s = PlaneLock(now, middle_px, 2.0 * size.width_px), None, time_s
            return np.eye(3), zoomed
        lock = self._lock.follow(now)
        if lock is None:
            return None, zoomed
        self._held_s = time_s
        return self._to_view @ lock.homography @ np.linalg.inv(self._to_view), zoomed

    def _new_on(
        self, canvas: GroundCanvas, pixels: ImageArray, view: UndistortedView, since_first: FloatArray, elapsed_s: float
    ) -> list[FloatArray]:
        """Outlines in the image, of what is new on the canvas."""
        onto = canvas.onto(since_first)
        if self._first is not None:
            whole = slice(0, canvas.shape[0]), slice(0, canvas.shape[1])
            self._first.append(canvas.warp(pixels, view, onto, whole))
            if len(self._first) == _FIRST_LOOKS:
                self._background.begin(self._first)
                self._first = None
            return []
        window = canvas.window(onto)
        seen, is_seen = canvas.warp(pixels, view, onto, window)
        if not seen.size:
            return []
        is_new, shade = self._background.new_in(seen, is_seen, window, elapsed_s)
        if int(np.count_nonzero(is_new)) > _GROUND_NOT_HELD * int(np.count_nonzero(is_seen)):
            self._lock, self._canvas = None, None
            return []
        min_area_px = max(round(self._settings.min_area_px / self._view.shrink**2), 8)
        mask = is_new
        if self._settings.shadows:
            background = np.clip(self._background.mean[window], 0, 255).astype(np.uint8)
            mask = without_shadows(seen, background, is_new, shade, min_area_px)
        outlines = self._without_ghosts(seen, is_new, objects_in(mask, min_area_px), window)
        self._background.learn(seen, is_seen, is_new, window, elapsed_s)
        corner = np.array([window[1].start, window[0].start], dtype=np.float64)
        found = [view.to_full(view.distort(apply_homography(onto, outline + corner))) for outline in outlines]
        return [outline for outline in found if self._is_whole(outline)]

    def _without_ghosts(
        self, seen: ImageArray, is_new: BoolArray, outlines: list[FloatArray], window: Window
    ) -> list[FloatArray]:
        there = []
        for outline in outlines:
            if is_ghost(seen, self._background.mean[window], is_new, outline):
                inside = np.zeros(seen.shape[:2], dtype=np.uint8)
                cv2.fillPoly(inside, [np.round(outline).astype(np.int32)], 1)
                self._background.forget(seen, np.asarray(inside > 0), window)
            else:
                there.append(outline)
        return there

    def _is_whole(self, outline: FloatArray) -> bool:
        """Whether an outline lies within the image and outside of ignored regions."""
        height, width = self._allowed.shape
        if not np.all(np.isfinite(outline)):
            return False
        if np.any(outline < _EDGE_PX) or np.any(outline > np.array([width, height]) - 1 - _EDGE_PX):
            return False
        middle = np.round(np.mean(outline, axis=0)).astype(int)
        return self._all_allowed or bool(self._allowed[middle[1], middle[0]])
