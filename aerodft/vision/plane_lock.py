"""A plane held fast in the images of a camera that moves: its homography since the first image, without drift.

Every image is held against a keyframe that is warped to how the plane must look by now, never against the image before;
so nothing adds up but at the change from one keyframe to the next, and earlier ones are returned to where they fit.
"""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray, IntArray
from aerodft.vision.plane_groups import PlaneGroup, carried_std_px, drifting_apart, groups_of
from aerodft.vision.straight import StraightView, carried
from aerodft.vision.tracking import followed

_CORNERS: Final = 160
_CELLS: Final = 8  # of the grid over which they are spread, along each side
_QUALITY: Final = 0.01
_APART_PX: Final = 6
_MARGIN_PX: Final = 12.0
_FEWEST: Final = 12
_LEAST_SHARE: Final = 0.2  # of the points in view: where fewer agree, it may be another place
_RICH: Final = 0.55  # of a keyframe's points: with fewer in view it is time for another
_SCALES: Final = (0.7, 1.45)  # a template that is seen larger or smaller than that looks different
_KEYFRAMES: Final = 12
_SWITCH_STD_PX: Final = 0.15  # small pixels, of a new keyframe's place
_FORETOLD_STEP_STD_PX: Final = 1.5  # small pixels, of what telemetry foretells from image to image ...
_FORETOLD_STD_PX: Final = 15.0  # ... and at most, since the first
_STEP_STD_PX: Final = 8.0  # of going on as before, without telemetry
_MOST_DOUBT: Final = 13.3  # squared stds of two times two coordinates, of which 99 % are less
_CERTAIN: Final = 20.0  # more of them: the others are not the plane
_REMEMBERED: Final = 500
_TRIED: Final = 2  # other keyframes
_LOOK_BACK: Final = 5  # images, from one try of an older keyframe to the next


@dataclass(frozen=True, slots=True, eq=False)
class Lock:
    """Where the plane is in an image.

    Attributes:
        homography: ``(3, 3)`` from straight small pixels of the first image to those of this one.
        agreeing: Points that it explains.
        added_px: What the change of keyframes adds to the std, and what else may be the plane.
        land_px: ``(n, 2)`` small pixels of these points.
        group: What it is made of: points that the keyframe had ...
        then: ... at these straight pixels ``(m, 2)``; ...
        since_first: ... and the keyframe's own homography.
    """

    homography: FloatArray
    agreeing: int
    added_px: float
    land_px: FloatArray
    group: PlaneGroup
    then: FloatArray
    since_first: FloatArray

    def std_px(self, first: FloatArray) -> float:
        """Of the worst known of points that were at ``first (n, 2)``, straight, in the first image; small pixels."""
        carried_px = carried_std_px(self.group, self.then, carried(self.since_first, first))
        return math.hypot(float(np.max(carried_px)), self.added_px)


@dataclass(slots=True, eq=False)
class _Keyframe:
    image: ImageArray
    corners_px: FloatArray
    since_first: FloatArray
    added_px: float


class PlaneLock:
    """Holds the plane.

    Args:
        view: The camera's small images.
        first: The first of them.
        near_px: ``(n, 2)`` small pixels around which the plane is looked at, because farther away it may be another.
        reach_px: How far around them.
    """

    def __init__(self, view: StraightView, first: ImageArray, near_px: FloatArray, reach_px: float) -> None:
        self._view, self._near_px, self._reach_px = view, near_px, reach_px
        self._last, self._step = np.eye(3), np.eye(3)
        self._foretold: FloatArray | None = None
        self._missed = 0
        self._astray = np.zeros((0, 2))
        self._expected: list[tuple[FloatArray, float]] = []
        self._centre: FloatArray = view.straight(np.asarray(np.mean(near_px, axis=0)))
        self._images = 0
        self._held = self._keyframe(first, np.eye(3), 0.0)
        self._keyframes = [self._held]

    def follow(self, image: ImageArray, foretold: FloatArray | None = None) -> Lock | None:
        """Find the plane in the next small image; None where it is not found.

        Args:
            image: ``(height, width)``.
            foretold: What telemetry makes of the homography since the first image; None where it does not tell.
        """
        self._images += 1
        on = self._step @ self._last
        step_std_px = _STEP_STD_PX * (1 + self._missed)
        if foretold is not None:
            on = foretold if self._foretold is None else foretold @ np.linalg.inv(self._foretold) @ self._last
            images = self._images if self._foretold is None else 1 + self._missed
            step_std_px = _FORETOLD_STEP_STD_PX * math.sqrt(images)
        self._expected = [(on, step_std_px)]
        if foretold is not None:
            drift_px = _FORETOLD_STEP_STD_PX * math.sqrt(self._images)
            self._expected.append((foretold, min(drift_px, _FORETOLD_STD_PX)))
        for guess, _ in self._expected:
            for keyframe in (self._held, *self._alike(guess)):
                lock = self._fit(keyframe, guess, image)
                if lock is not None:
                    self._held = keyframe
                    lock = self._choose(lock, image)
                    self._step, self._last = lock.homography @ np.linalg.inv(self._last), lock.homography
                    self._foretold, self._missed = foretold, 0
                    return lock
        self._step = np.eye(3)
        self._missed += 1
        return None

    def _doubt(self, homography: FloatArray) -> float:
        """How far a homography since the first image is from what is expected, squared stds."""
        places = [carried(each, self._centre) for each in (homography, *(each for each, _ in self._expected))]
        stds = [std for _, std in self._expected]
        return sum(
            float(np.sum((place - places[0]) ** 2)) / std**2 for place, std in zip(places[1:], stds, strict=True)
        )

    def _forget(self, keyframe: _Keyframe, rows: IntArray) -> None:
        """Leave corners out that do not lie still on the plane, and remember where such are."""
        back: FloatArray = np.asarray(np.linalg.inv(keyframe.since_first), dtype=np.float64)
        away = carried(back, self._view.straight(keyframe.corners_px[rows]))
        self._astray = np.concatenate([self._astray, away])[-_REMEMBERED:]
        keyframe.corners_px = np.delete(keyframe.corners_px, rows, axis=0)

    def _alike(self, homography: FloatArray) -> list[_Keyframe]:
        """Other keyframes that show what is seen now, the best first."""
        others = [each for each in self._keyframes if each is not self._held and self._shows(each, homography)]
        return sorted(others, key=lambda each: each.added_px)[:_TRIED]

    def _choose(self, lock: Lock, image: ImageArray) -> Lock:
        """Hold on to the keyframe whose place is known best of those that show the view; else make this image one."""
        if self._images % _LOOK_BACK == 0:
            for keyframe in self._alike(lock.homography):
                better = None
                if keyframe.added_px < lock.added_px:
                    better = self._fit(keyframe, lock.homography, image)
                if better is not None:
                    self._held = keyframe
                    return better
        if not self._shows(self._held, lock.homography):
            added_px = max(lock.std_px(self._view.straight(self._near_px)), math.hypot(lock.added_px, _SWITCH_STD_PX))
            new = self._keyframe(image, lock.homography, added_px, lock)
            if len(new.corners_px) >= 2 * _FEWEST:
                self._held = new
                self._keyframes = [*self._keyframes[:1], *self._keyframes[1:][-_KEYFRAMES:], new]
        return lock

    def _shows(self, keyframe: _Keyframe, homography: FloatArray) -> bool:
        """Whether a keyframe has most of what is seen, in about the same size."""
        onto = homography @ np.linalg.inv(keyframe.since_first)
        if len(keyframe.corners_px) < 2 * _FEWEST:
            return False
        share = np.mean(self._inside(self._view.moved(onto, keyframe.corners_px)))
        middle = np.mean(keyframe.corners_px, axis=0) + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        ends = self._view.moved(onto, middle)
        scale = math.sqrt(abs(float(np.linalg.det(ends[1:] - ends[0]))))
        return bool(share >= _RICH and _SCALES[0] <= scale <= _SCALES[1])

    def _keyframe(
        self, image: ImageArray, since_first: FloatArray, added_px: float, lock: Lock | None = None
    ) -> _Keyframe:
        near_px = self._view.moved(since_first, self._near_px)
        corners = _corners(image)
        if len(self._astray) and lock is not None:
            astray = self._view.bent(carried(since_first, self._astray))
            astray = astray[np.isfinite(astray[:, 0])]
            corners = corners[_nearest_px(corners, lock.land_px) < _nearest_px(corners, astray)]
        apart = np.linalg.norm(corners[:, None] - near_px, axis=-1)
        near = corners[np.min(np.where(np.isnan(apart), np.inf, apart), axis=1, initial=np.inf) <= self._reach_px]
        enough = near if len(near) >= _CORNERS // 2 else corners
        return _Keyframe(image, enough, since_first, added_px)

    def _fit(self, keyframe: _Keyframe, guess: FloatArray, image: ImageArray) -> Lock | None:
        """The homography by one keyframe's points, near a guess."""
        view = self._view
        onto = guess @ np.linalg.inv(keyframe.since_first)
        there_px = view.moved(onto, keyframe.corners_px)
        inside = self._inside(there_px)
        if np.count_nonzero(inside) < _FEWEST:
            return None
        warped = view.warped(keyframe.image, onto)
        now_px, found = followed(warped, image, there_px[inside], there_px[inside])
        fewest = max(_FEWEST, math.ceil(_LEAST_SHARE * np.count_nonzero(inside)))
        if np.count_nonzero(found) < fewest:
            return None
        then, now = view.straight(keyframe.corners_px[inside][found]), view.straight(now_px[found])
        on, _ = self._expected[0]
        off_px = now - carried(on @ np.linalg.inv(keyframe.since_first), then)
        groups = drifting_apart(then, now, off_px, fewest) or groups_of(then, now, fewest)
        if not groups:
            return None
        doubts = [self._doubt(group.homography @ keyframe.since_first) for group in groups]
        if len(groups) > 1 and doubts[1] < doubts[0]:
            groups, doubts = groups[::-1], doubts[::-1]
        if doubts[0] > _MOST_DOUBT:
            return None
        split_px = 0.0
        if len(groups) > 1 and doubts[1] < doubts[0] + _CERTAIN:
            places = [carried(group.homography @ keyframe.since_first, self._centre) for group in groups]
            split_px = float(np.linalg.norm(places[1] - places[0])) * math.exp((doubts[0] - doubts[1]) / 2)
        if doubts[-1] > doubts[0] + _CERTAIN:
            self._forget(keyframe, np.flatnonzero(inside)[found][groups[-1].members])
        whole = groups[0].homography @ keyframe.since_first
        mine = groups[0].members
        return Lock(
            homography=whole / whole[2, 2],
            agreeing=int(np.count_nonzero(mine)),
            added_px=math.hypot(keyframe.added_px, split_px),
            land_px=view.bent(now[mine]),
            group=groups[0],
            then=then,
            since_first=keyframe.since_first,
        )

    def _inside(self, small_px: FloatArray) -> BoolArray:
        farthest = np.array([self._view.camera.width_px, self._view.camera.height_px]) - 1 - _MARGIN_PX
        return np.asarray(np.all((small_px >= _MARGIN_PX) & (small_px <= farthest), axis=-1))


def _corners(small: ImageArray) -> FloatArray:
    """Corners ``(n, 2)``, the best of each cell of a grid."""
    strength = cv2.cornerMinEigenVal(small, 5)
    peaks = strength >= cv2.dilate(strength, np.ones((2 * _APART_PX + 1, 2 * _APART_PX + 1), dtype=np.uint8))
    rows, columns = np.nonzero(peaks & (strength > _QUALITY * float(np.quantile(strength, 0.99))))
    cells = (rows * _CELLS // small.shape[0]) * _CELLS + columns * _CELLS // small.shape[1]
    order = np.lexsort((-strength[rows, columns], cells))
    rank = np.arange(len(order)) - np.searchsorted(cells[order], cells[order])
    kept = order[rank < _CORNERS // _CELLS**2 + 3]
    return np.stack([columns[kept], rows[kept]], axis=-1).astype(np.float64)


def _nearest_px(points_px: FloatArray, others_px: FloatArray) -> FloatArray:
    """How far each of ``(n, 2)`` is from the nearest of ``(m, 2)``."""
    return np.asarray(np.min(np.linalg.norm(points_px[:, None] - others_px, axis=-1), axis=1, initial=np.inf))
