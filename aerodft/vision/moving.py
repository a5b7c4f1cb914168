"""What moves: before a fixed camera by background subtraction (MOG2, Zivkovic 2004), over the ground from a drone.

There the ground is held still as for tracked probes (``plane_lock``): images are laid onto a canvas of what one of them
saw of it, each place of which has a mean and a variance, and what differs from that background is new. What stands up
from the ground is shifted when the camera moves on: ``ground_tracks`` tells it from what walks.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.ground import Ground
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.observation import Observation
from aerodft.service.settings import OBJECTS, ObjectSettings
from aerodft.vision.blobs import (
    MOST_OUTLINES,
    TOO_MANY,
    Planes,
    calm,
    is_ghost,
    objects_in,
    remember_changes,
    without_shadows,
)
from aerodft.vision.keyframes import PlaneImage, PoseOf, Standpoints
from aerodft.vision.plane_lock import PlaneLock
from aerodft.vision.steady import allowed_outside
from aerodft.vision.tracking import NODE_PX, OUTSIDE_PX, StraightView, carried, nodes_px

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
        self.restless = 0
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
        self.restless += bool(seen[0].unseen)
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
        calm = self._calm(new, elapsed_s)
        if np.count_nonzero(new) > _ANOTHER_VIEW * new.size:
            self._subtractor = cv2.createBackgroundSubtractorMOG2(_HISTORY, _APART, detectShadows=True)
            self._background, self._looks = None, 0
            return []
        mask = new = np.asarray(new & calm)
        if self._background is None or self._looks % _BACKGROUND_LOOKS == 0:
            self._background = np.asarray(self._subtractor.getBackgroundImage(), dtype=np.uint8)
        background = self._background
        if self._settings.shadows:
            labelled = np.asarray(labels == _SHADOW)
            mask = without_shadows(pixels, background, new, labelled, self._settings.least_px)
        found = objects_in(mask, self._settings.least_px)
        return [outline for outline in found if not is_ghost(pixels, background, new, outline)]

    def _calm(self, new: BoolArray, elapsed_s: float) -> BoolArray:
        """Where who moves can be told ``(height, width)``, with what is new in the next image."""
        size = new.shape[1] // _COARSE, new.shape[0] // _COARSE
        now = np.asarray(cv2.resize(new.astype(np.float32), size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        if self._changes is None:
            self._changes = np.zeros_like(now), now.copy()
        remember_changes(*self._changes, now, np.ones_like(now), self._looks, elapsed_s)
        mask = cv2.resize(calm(self._changes[0]).astype(np.uint8), new.shape[::-1], interpolation=cv2.INTER_NEAREST)
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
        self.restless = 0
        self._settings, self._ground = settings, ground
        self._allowed = allowed_outside(settings.ignore, camera.width_px, camera.height_px)
        self._all_allowed = bool(np.all(self._allowed))
        self._small, self._view = StraightView(camera), StraightView(camera, _ABOUT_PX)
        self._standpoints = Standpoints(camera, self._small, pose_of)
        self._to_view = self._view.intrinsics @ np.linalg.inv(self._small.intrinsics)
        self._lock: PlaneLock | None = None
        self._canvas: GroundCanvas | None = None
        self._background = GroundBackground.of((0, 0))
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
        self.restless += bool(seen[0].unseen)
        return seen

    def _outlines(self, image: Image, pixels: ImageArray, time_s: float) -> list[FloatArray]:
        since_first, view = self._held(image, pixels, time_s)
        if since_first is None:
            return []
        if self._canvas is None:
            self._canvas = GroundCanvas(self._view, since_first)
            self._background, self._first = GroundBackground.of(self._canvas.shape), []
        elif not self._canvas.holds(self._canvas.onto(since_first)):
            canvas = GroundCanvas(self._view, since_first)
            self._background, self._canvas = self._background.on(canvas, self._canvas), canvas
        elapsed_s, self._last_s = time_s - self._last_s, time_s
        return self._new_on(self._canvas, self._view.shrunken(pixels), view, since_first, elapsed_s)

    def _held(self, image: Image, pixels: ImageArray, time_s: float) -> tuple[FloatArray | None, StraightView]:
        """Homography since the first image, and the view as it is zoomed; None where the ground is not held."""
        seen = self._standpoints.seen(image)
        if self._lock is None and self._ground is not None and seen is not None:
            middle = np.array([pixels.shape[1] - 1, pixels.shape[0] - 1]) / 2
            self._standpoints.find_plane(seen, middle, self._ground, 0.0)
        standpoint, view = self._standpoints.of(seen), self._standpoints.view_of(seen)
        now = PlaneImage(self._small.small(pixels), view, time_s, standpoint)
        zoomed = self._view if seen is None else self._standpoints.zoomed(self._view, seen)
        if self._lock is None or time_s - self._held_s > _LOST_S:
            if standpoint is None:
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
        self, canvas: GroundCanvas, pixels: ImageArray, view: StraightView, since_first: FloatArray, elapsed_s: float
    ) -> list[FloatArray]:
        """Outlines in the image, of what is new on the canvas."""
        onto = canvas.onto(since_first)
        if self._first is not None:
            whole = slice(0, canvas.shape[0]), slice(0, canvas.shape[1])
            self._first.append(canvas.laid(pixels, view, onto, whole))
            if len(self._first) == _FIRST_LOOKS:
                self._background.begin(self._first)
                self._first = None
            return []
        window = canvas.window(onto)
        seen, is_seen = canvas.laid(pixels, view, onto, window)
        if not seen.size:
            return []
        is_new, shade = self._background.new_in(seen, is_seen, window, elapsed_s)
        if int(np.count_nonzero(is_new)) > _GROUND_NOT_HELD * int(np.count_nonzero(is_seen)):
            self._lock, self._canvas = None, None
            return []
        least_px = max(round(self._settings.least_px / self._view.shrink**2), 8)
        mask = is_new
        if self._settings.shadows:
            background = np.clip(self._background.mean[window], 0, 255).astype(np.uint8)
            mask = without_shadows(seen, background, is_new, shade, least_px)
        outlines = self._without_ghosts(seen, is_new, objects_in(mask, least_px), window)
        self._background.learn(seen, is_seen, is_new, window, elapsed_s)
        corner = np.array([window[1].start, window[0].start], dtype=np.float64)
        found = [view.to_full(view.bent(carried(onto, outline + corner))) for outline in outlines]
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
        """Whether it lies in the image, and not in what is to be ignored."""
        height, width = self._allowed.shape
        if not np.all(np.isfinite(outline)):
            return False
        if np.any(outline < _EDGE_PX) or np.any(outline > np.array([width, height]) - 1 - _EDGE_PX):
            return False
        middle = np.round(np.mean(outline, axis=0)).astype(int)
        return self._all_allowed or bool(self._allowed[middle[1], middle[0]])
