"""A plane held fast in the images of a camera that moves: its homography since the first image, without drift.

Every image is held against a keyframe that is warped to how the plane must look by now, never against the image before;
so nothing adds up but at the change from one keyframe to the next, and earlier ones are returned to where they fit.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.model.arrays import FloatArray, IntArray
from aerodft.vision.keyframes import (
    FEWEST,
    LAND_AS_BEFORE,
    LAND_AT_FIRST,
    MOST_CORNERS,
    Keyframe,
    PlaneImage,
    Stillness,
    corners_of,
    nearest_px,
)
from aerodft.vision.plane_land import Land, Matched, groups_of, land_among
from aerodft.vision.standpoints import FREE, Standpoint, foretold_cov, moved_on, place_cov_px2, shift_cov
from aerodft.vision.straight import carried
from aerodft.vision.tracking import followed

_FEWEST_FORETOLD: Final = 8  # where telemetry says the rest
_LEAST_SHARE: Final = 0.2  # of the points in view: where fewer agree, it may be another place
_RICH: Final = 0.55  # of a keyframe's points: with fewer in view it is time for another
_SOME: Final = 0.2  # of them: enough to return to it
_KEYFRAMES: Final = 24
_SWITCH_STD_PX: Final = 0.1  # small pixels, of a new keyframe's place
_REMEMBERED: Final = 500
_TRIED: Final = 2  # other keyframes
_LOOK_BACK: Final = 5  # images, from one try of an older keyframe to the next
_BETTER: Final = 0.7  # of the std: what it takes to return to one


@dataclass(frozen=True, slots=True, eq=False)
class Lock:
    """Where the plane is in an image.

    Attributes:
        homography: ``(3, 3)`` from straight small pixels of the first image to those of this one.
        cov: ``(8, 8)`` of that, in units of ``unit``, see ``standpoints``.
        unit: ``(3, 3)`` intrinsics.
        land: What it is made of.
        land_px: ``(n, 2)`` small pixels of these points.
    """

    homography: FloatArray
    cov: FloatArray
    unit: FloatArray
    land: Land
    land_px: FloatArray

    def cov_px2(self, first: FloatArray) -> FloatArray:
        """Covariances ``(n, 2, 2)`` of where points are that were at ``first (n, 2)``; straight small pixels."""
        return place_cov_px2(self.cov, self.unit, carried(self.homography, first))

    def first_std_px(self, first: FloatArray) -> float:
        """How well points at ``first (n, 2)`` are held, the worst of them, in pixels of the first image."""
        back = np.linalg.inv(self.homography)
        cov = place_cov_px2(moved_on(self.cov, np.asarray(back), self.unit), self.unit, first)
        return math.sqrt(float(np.max(np.linalg.eigvalsh(cov))))


class PlaneLock:
    """Holds the plane.

    Args:
        first: The first image.
        near_px: ``(n, 2)`` small pixels around which the plane is looked at, because farther away it may be another.
        reach_px: How far around them.
    """

    def __init__(self, first: PlaneImage, near_px: FloatArray, reach_px: float) -> None:
        self._near, self._reach_px = first.view.straight(near_px), reach_px
        self._unit = first.view.intrinsics
        self._last, self._step = np.eye(3), np.eye(3)
        self._last_image = first
        self._told_s = first.time_s
        self._images = 0
        self._astray = np.zeros((0, 2))
        self._held = self._keyframe(first, np.eye(3), np.zeros((FREE, FREE)))
        self._keyframes = [self._held]

    def know_first(self, standpoint: Standpoint | None) -> None:
        """Where the first image was taken from, which may become known after it."""
        first = self._keyframes[0]
        if first.taken is self._last_image:
            self._last_image = replace(first.taken, standpoint=standpoint)
        first.taken = replace(first.taken, standpoint=standpoint)

    def follow(self, now: PlaneImage) -> Lock | None:
        """Find the plane in the next image; None where it is not found."""
        self._images += 1
        if now.standpoint is not None:
            self._told_s = now.time_s
        for guess in self._guesses(now.standpoint):
            for keyframe in (self._held, *self._alike(guess, now)):
                lock = self._fit(keyframe, guess, now)
                if lock is not None:
                    self._held = keyframe
                    lock = self._choose(lock, now)
                    self._step, self._last = lock.homography @ np.linalg.inv(self._last), lock.homography
                    self._last_image = now
                    return lock
        self._step = np.eye(3)
        return None

    def _guesses(self, standpoint: Standpoint | None) -> list[FloatArray]:
        """Homographies since the first image, the likeliest first."""
        first, last = self._keyframes[0].taken.standpoint, self._last_image.standpoint
        guesses = [
            self._step @ self._last if standpoint is None or last is None else last.onto(standpoint) @ self._last
        ]
        if standpoint is not None and first is not None:
            guesses.append(first.onto(standpoint))
        return guesses

    def _alike(self, homography: FloatArray, now: PlaneImage) -> list[Keyframe]:
        """Other keyframes that show what is seen now, the best known first."""
        shown = [each for each in self._keyframes if each is not self._held and _shows(each, homography, now, _SOME)]
        return sorted(shown, key=lambda each: each.std_px)[:_TRIED]

    def _choose(self, lock: Lock, now: PlaneImage) -> Lock:
        """Hold on to the keyframe whose place is known best of those that show the view; else make this image one."""
        if self._images % _LOOK_BACK == 0:
            std_px = lock.first_std_px(self._near)
            for keyframe in self._alike(lock.homography, now):
                better = self._fit(keyframe, lock.homography, now) if keyframe.std_px < _BETTER * std_px else None
                if better is not None and better.first_std_px(self._near) < _BETTER * std_px:
                    self._held, lock = keyframe, better
                    break
        if not _shows(self._held, lock.homography, now, _RICH):
            new = self._keyframe(now, lock.homography, lock.cov + shift_cov(_SWITCH_STD_PX, self._unit), lock)
            if len(new.corners_px) >= 2 * FEWEST:
                self._held = new
                self._keyframes = [*self._keyframes[:1], *self._keyframes[1:][-_KEYFRAMES:], new]
        return lock

    def _keyframe(
        self, taken: PlaneImage, since_first: FloatArray, cov: FloatArray, lock: Lock | None = None
    ) -> Keyframe:
        near_px = taken.view.bent(carried(since_first, self._near))
        corners = corners_of(taken.small, near_px)
        if len(self._astray) and lock is not None:
            astray_px = taken.view.bent(carried(since_first, self._astray))
            corners = corners[nearest_px(corners, lock.land_px) < nearest_px(corners, astray_px)]
        near = corners[nearest_px(corners, near_px) <= self._reach_px]
        enough = near if len(near) >= MOST_CORNERS // 2 else corners
        still = Stillness(taken.time_s, LAND_AT_FIRST if lock is None else min(lock.land.log_odds, LAND_AS_BEFORE))
        return Keyframe(
            taken=taken,
            corners_px=enough,
            since_first=since_first,
            cov=cov,
            std_px=0.0 if lock is None else lock.first_std_px(self._near),
            stillness=still,
            are_known=np.ones(len(enough), dtype=np.bool_),
            strangeness=still.again(),
        )

    def _fit(self, keyframe: Keyframe, guess: FloatArray, now: PlaneImage) -> Lock | None:
        """The homography by one keyframe's points, near a guess."""
        onto = guess @ np.linalg.inv(keyframe.since_first)
        there_px, inside = keyframe.seen_px(now.view, onto)
        fewest = max(FEWEST, math.ceil(_LEAST_SHARE * np.count_nonzero(inside)))
        if np.count_nonzero(inside) < fewest:
            return None
        warped = now.view.warped(keyframe.taken.small, onto, keyframe.taken.view)
        now_px, found = followed(warped, now.small, there_px[inside], there_px[inside])
        if np.count_nonzero(found) < fewest:
            return None
        rows = np.flatnonzero(inside)[found]
        then = keyframe.taken.view.straight(keyframe.corners_px[rows])
        seen = self._matched(keyframe.taken, now, then, now.view.straight(now_px[found]), onto)
        few = fewest if seen.foretold_cov is None else _FEWEST_FORETOLD
        groups = groups_of(seen, seen.now - carried(onto, then), fewest, few)
        land = land_among(groups, seen, keyframe, rows, now, self._last_image, self._told_s) if groups else None
        if land is None or np.count_nonzero(land.group.members) < few:
            return None
        if land.gone is not None:
            keyframe.remember(rows[land.group.members], land.gone)
        if np.any(land.astray):
            self._forget(keyframe, rows[land.astray])
        whole = land.group.homography @ keyframe.since_first
        since = moved_on(keyframe.cov, land.group.homography, self._unit)
        cov = since + land.group.cov + shift_cov(land.doubt_px, self._unit)
        return Lock(whole / np.linalg.norm(whole), cov, self._unit, land, now_px[found][land.group.members])

    def _matched(
        self, before: PlaneImage, after: PlaneImage, then: FloatArray, now: FloatArray, onto: FloatArray
    ) -> Matched:
        if before.standpoint is None or after.standpoint is None:
            return Matched(then, now, self._unit, onto, None)
        cov = foretold_cov(before.standpoint, after.standpoint, self._unit)
        return Matched(then, now, self._unit, before.standpoint.onto(after.standpoint), cov)

    def _forget(self, keyframe: Keyframe, rows: IntArray) -> None:
        """Leave corners out that do not lie still on the plane, and remember where such are."""
        back: FloatArray = np.asarray(np.linalg.inv(keyframe.since_first), dtype=np.float64)
        away = carried(back, keyframe.taken.view.straight(keyframe.corners_px[rows]))
        self._astray = np.concatenate([self._astray, away])[-_REMEMBERED:]
        keyframe.forget(rows)


def _shows(keyframe: Keyframe, homography: FloatArray, now: PlaneImage, least_share: float) -> bool:
    """Whether a keyframe has that share of its points in an image with this homography since the first."""
    onto: FloatArray = np.asarray(homography @ np.linalg.inv(keyframe.since_first), dtype=np.float64)
    return keyframe.is_shown(now.view, onto, least_share)
