"""A plane held fast in the images of a camera that moves: its homography since the first image, without drift.

Every image is held against a keyframe that is warped to how the plane must look by now, never against the image before;
so nothing adds up but at the change from one keyframe to the next, and earlier ones are returned to where they fit.
Points that a plane carries from one image to another are parted into groups with a homography each: where water flows
over the plane, it is a group of its own.

Clicked points of the ground are found again so in every image: probes that stay where they are while we move. Telemetry
tells land from water that flows and finds the plane again after it was lost. A point that is not found, or that has
left the image, is lost: it has no pixels, never wrong ones.
"""

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX, SECOND_NS
from aerodft.geometry import Ground, robust_std, student_weights, weighted_step
from aerodft.model import BoolArray, Camera, FloatArray, Image, ImageArray, IntArray, Observation, Probe
from aerodft.vision.common import (
    FEWEST,
    FREE,
    LAND_AS_BEFORE,
    LAND_AT_FIRST,
    MOST_CORNERS,
    GroundDrift,
    Keyframe,
    PlaneImage,
    PlanePose,
    PlanePoses,
    PoseOf,
    Stillness,
    UndistortedView,
    apply_change,
    apply_homography,
    by_elements,
    change_between,
    compose_cov,
    consensus_homography,
    corners_of,
    nearest_px,
    place_cov_px2,
    predicted_cov,
    share_moving,
    shift_cov,
    track_lk,
)

_STRAY_PX: Final = 1.0  # what is farther off moves by itself, or lies on something else
_TOGETHER_PX: Final = 0.8
_LAYERS: Final = 2  # land, and water that flows
_STEPS: Final = 4  # that are told apart: water does not flow everywhere alike
_EXPLAINED: Final = 0.6  # of the points: where fewer go with a step, a step is not how they go
_DRAWS: Final = 1000
_CONFIDENCE: Final = 0.999
_LEAST_STD_PX: Final = 0.05  # no tracker is better on real images
_ROUNDS: Final = 4
_STUDENT: Final = 5.0  # degrees of freedom of the residuals' t distribution
_OVERLAPPING: Final = 3.0  # points whose windows overlap are off alike: so many say as much as one
_UNKNOWN: Final = 1e4  # variance of elements that nothing is known of
_UNPOSED_S: Final = 2.0  # without telemetry for longer than this, land cannot be told from water
_NEVER_POSED_S: Final = 0.5  # without it for longer than this, before it has said anything
_STEP_STD_PX: Final = 8.0  # of going on as before, without telemetry
_MOST_DOUBT: Final = 9.2  # squared stds of two coordinates, of which 99 % are less
_CERTAIN: Final = 10.0  # log odds: the others are not the plane
_LARGER: Final = 0.5  # how much for a group speaks that it has more points, by the logarithm of their number
_AHEAD_M: Final = 0.5  # over which derivatives on the plane are taken
_FEWEST_PREDICTED: Final = 8  # where telemetry says the rest
_LEAST_SHARE: Final = 0.2  # of the points in view: where fewer agree, it may be another place
_RICH: Final = 0.55  # of a keyframe's points: with fewer in view it is time for another
_SOME: Final = 0.2  # of them: enough to return to it
_KEYFRAMES: Final = 24
_SWITCH_STD_PX: Final = 0.1  # small pixels, of a new keyframe's place
_REMEMBERED: Final = 500
_TRIED: Final = 2  # other keyframes
_LOOK_BACK: Final = 5  # images, from one try of an older keyframe to the next
_BETTER: Final = 0.7  # of the std: what it takes to return to one
_REACH: Final = 0.35  # of the image's width: what is farther from the probes may be another plane
_START_NS: Final = SECOND_NS // 5  # pixels are those of an image that is no later than this after their time
_MOST_STD_PX: Final = 8.0  # full pixels: what is known no better is lost
_STD_PX: Final = 0.2  # full pixels: a tracker is never better
_DECIMALS: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class PlaneGroup:
    """Points that follow one homography.

    Attributes:
        homography: ``(3, 3)`` that they follow.
        cov: ``(8, 8)`` of that, as ``keyframes.predicted_cov``.
        members: ``(n,)``: which they are.
    """

    homography: FloatArray
    cov: FloatArray
    members: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class MatchedPoints:
    """Points of the plane in two images, and what is known of its homography without them.

    Attributes:
        then: ``(n, 2)`` straight small pixels.
        now: ``(n, 2)`` the same points in the other image.
        unit: ``(3, 3)`` intrinsics that elements are in units of.
        foretold: ``(3, 3)``.
        foretold_cov: ``(8, 8)`` of that; None where nothing is known.
    """

    then: FloatArray
    now: FloatArray
    unit: FloatArray
    predicted: FloatArray
    predicted_cov: FloatArray | None


def groups_of(seen: MatchedPoints, off_px: FloatArray, fewest: int, fewest_predicted: int) -> list[PlaneGroup]:
    """Groups of points that follow one homography each, at most four.

    One homography bends between land and water that has only just begun to flow away; a common step does not: first
    it is tried to part all points by their steps.

    Args:
        seen: The points.
        off_px: ``(n, 2)`` how far each is off the expected.
        fewest: Points that a group has, at least.
        fewest_predicted: Points that a group that telemetry helps with has, at least.
    """
    if seen.predicted_cov is not None:
        parts = _split_by_step(off_px, fewest_predicted)
        found = [_fit_group(seen, seen.predicted, part) for part in parts]
        found = [group for group in found if np.count_nonzero(group.members) >= fewest_predicted]
        explained = sum((group.members for group in found), np.zeros(len(off_px), dtype=np.bool_))
        if np.count_nonzero(explained) >= max(_EXPLAINED * len(off_px), fewest):
            return found
    groups: list[PlaneGroup] = []
    left = np.arange(len(seen.then))
    while len(left) >= fewest and len(groups) < _LAYERS:
        consensus = consensus_homography(seen.then[left], seen.now[left], _STRAY_PX, _DRAWS, _CONFIDENCE)
        if consensus is None or np.count_nonzero(consensus[1]) < fewest:
            break
        homography, follows = consensus
        groups.append(_fit_group(seen, homography, left[follows]))
        left = left[~follows]
        fewest = fewest_predicted if seen.predicted_cov is not None else fewest
    return [group for group in groups if np.count_nonzero(group.members) >= fewest_predicted]


def _split_by_step(off_px: FloatArray, fewest: int) -> list[IntArray]:
    """Groups of points that have moved apart, each as one: the indices of each, the largest first."""
    left = np.arange(len(off_px))
    parts: list[IntArray] = []
    while len(left) >= fewest and len(parts) < _STEPS:
        apart = np.linalg.norm(off_px[left][:, None] - off_px[left], axis=-1) < _TOGETHER_PX
        best = int(np.argmax(np.sum(apart, axis=1)))
        middle = np.mean(off_px[left[apart[best]]], axis=0)
        near = np.linalg.norm(off_px[left] - middle, axis=-1) < _TOGETHER_PX
        if np.count_nonzero(near) < fewest:
            break
        parts.append(left[near])
        left = left[~near]
    return parts


def _fit_group(seen: MatchedPoints, start: FloatArray, rows: IntArray) -> PlaneGroup:
    """The most likely homography of some points and all that agree with them."""
    first = _refine_group(seen, start, rows)
    near = np.flatnonzero(first.members)
    return _refine_group(seen, first.homography, near) if len(near) else first


def _refine_group(seen: MatchedPoints, start: FloatArray, rows: IntArray) -> PlaneGroup:
    """The most likely homography of some points, under t-distributed errors and what is predicted."""
    then, now, unit = seen.then[rows], seen.now[rows], seen.unit
    known_cov = _UNKNOWN * np.eye(FREE) if seen.predicted_cov is None else seen.predicted_cov
    prior = np.asarray(np.linalg.inv(known_cov), dtype=np.float64)
    homography, cov = start, np.asarray(known_cov)
    for _ in range(_ROUNDS):
        at = apply_homography(homography, then)
        off = now - at
        std_px = max(robust_std(off) * math.sqrt(_variance_factor(len(then))), _LEAST_STD_PX)
        weight = student_weights(np.sum(off**2, axis=-1) / std_px**2, 2, _STUDENT) / (_OVERLAPPING * std_px**2)
        known = np.zeros(FREE) if seen.predicted_cov is None else change_between(homography, seen.predicted, unit)
        step, information = weighted_step(by_elements(unit, at), off, weight, (prior, known))
        homography = apply_change(homography, step, unit)
        cov = np.asarray(np.linalg.inv(information), dtype=np.float64)
    members = np.linalg.norm(apply_homography(homography, seen.then) - seen.now, axis=-1) < _STRAY_PX
    return PlaneGroup(homography, np.asarray(cov), np.asarray(members))


def _variance_factor(points: int) -> float:
    """Over what a variance of residuals is too small, because a homography has been fitted to them."""
    return 2 * points / max(2 * points - FREE, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Land:
    """The group of points that is taken for the plane.

    Attributes:
        group: Its points.
        astray: ``(n,)``: which points are certainly not of it.
        log_odds: That it lies still.
        doubt_px: What the chance of being wrong adds to the std.
        gone: Where it has gone, by telemetry; None where that does not tell.
    """

    group: PlaneGroup
    astray: BoolArray
    log_odds: float
    doubt_px: float
    drift: GroundDrift | None


def land_among(
    groups: list[PlaneGroup],
    seen: MatchedPoints,
    keyframe: Keyframe,
    rows: IntArray,
    now: PlaneImage,
    last: PlaneImage,
    last_posed_s: float,
) -> Land | None:
    """The group that lies still, or goes on as before where telemetry does not tell; None where none is likely.

    Args:
        groups: One or more.
        seen: Their points.
        keyframe: What they are held against.
        rows: ``(n,)`` which of its points they are.
        now: The image.
        last: The one before, in which the plane was found.
        last_posed_s: Time of the last image with a plane pose, or of the first.
    """
    middles = [np.mean(seen.then[group.members], axis=0) for group in groups]
    places = [apply_homography(group.homography, middle) for group, middle in zip(groups, middles, strict=True)]
    if not np.all(np.isfinite(places)):
        return None
    drift = [_drift_of(keyframe, now, last, middle, place) for middle, place in zip(middles, places, strict=True)]
    known = [each for each in drift if each is not None]
    if len(known) < len(groups):
        steps = [
            place - apply_homography(seen.predicted, middle) for middle, place in zip(middles, places, strict=True)
        ]
        stills = [keyframe.stillness_of(rows[group.members]) for group in groups]
        if abs(now.time_s - last_posed_s) > (_UNPOSED_S if stills[0].is_watched else _NEVER_POSED_S):
            return None
        return _land_without_telemetry(groups, steps, stills, now.time_s)
    stills = [keyframe.stillness_of(rows[group.members]) for group in groups]
    likely = [
        still.likelihood(each) + _LARGER * math.log(np.count_nonzero(group.members))
        for each, group, still in zip(known, groups, stills, strict=True)
    ]
    first = int(np.argmax(likely))
    log_odds = stills[first].with_evidence(known[first])
    if log_odds < 0:
        return None
    doubts_px = [known[first].px * math.sqrt(share_moving(log_odds))]
    astray = np.zeros_like(groups[first].members)
    for each, group, chance in zip(known, groups, likely, strict=True):
        if group is not groups[first]:
            apart_px = float(np.linalg.norm(known[first].px_by_m @ (each.by_m - known[first].by_m)))
            doubts_px.append(apart_px * math.sqrt(share_moving(likely[first] - chance)))
            astray |= group.members & (likely[first] - chance > _CERTAIN)
    return Land(groups[first], astray & ~groups[first].members, log_odds, math.hypot(*doubts_px), known[first])


def _land_without_telemetry(
    groups: list[PlaneGroup], steps_px: list[FloatArray], stills: list[Stillness], time_s: float
) -> Land | None:
    """Without telemetry: what is where it was expected."""
    doubts = [float(step @ step) / _STEP_STD_PX**2 for step in steps_px]
    first = int(np.argmin(doubts))
    if doubts[first] > _MOST_DOUBT:
        return None
    doubt_px = stills[first].unwatched_px(time_s)
    if len(groups) > 1:
        other = int(np.argsort(doubts)[1])
        share = share_moving((doubts[other] - doubts[first]) / 2)
        doubt_px = math.hypot(doubt_px, float(np.linalg.norm(steps_px[other] - steps_px[first])) * math.sqrt(share))
    return Land(groups[first], np.zeros_like(groups[first].members), stills[first].log_odds, doubt_px, None)


def _drift_of(
    keyframe: Keyframe, now: PlaneImage, last: PlaneImage, then_px: FloatArray, now_px: FloatArray
) -> GroundDrift | None:
    """Drift over the ground, by telemetry, of a place of the keyframe ``(2,)`` seen at ``now_px (2,)``."""
    before, after = keyframe.plane_image.plane_pose, now.plane_pose
    if before is None or after is None:
        return None
    onto = after.from_plane()
    was_m, is_m = _on_plane(before.from_plane(), then_px), _on_plane(onto, now_px)
    ahead = apply_homography(onto, is_m + _AHEAD_M * np.eye(2))
    px_by_m = (ahead - now_px).T / _AHEAD_M
    sweep_mps = np.zeros(2)
    if last.plane_pose is not None and now.time_s > last.time_s:
        sweep_mps = (is_m - _on_plane(last.plane_pose.from_plane(), now_px)) / (now.time_s - last.time_s)
    drift = GroundDrift(now.time_s, is_m - was_m, px_by_m, sweep_mps, float(after.lens[0, 0]))
    return drift if np.all(np.isfinite([*drift.by_m, *px_by_m.ravel(), *sweep_mps])) else None


def _on_plane(from_plane: FloatArray, px: FloatArray) -> FloatArray:
    """East and north ``(2,)`` of what is seen at ``px (2,)``; NaN above the horizon."""
    return apply_homography(np.asarray(np.linalg.inv(from_plane), dtype=np.float64), px)


@dataclass(frozen=True, slots=True, eq=False)
class Lock:
    """The plane's homography in an image.

    Attributes:
        homography: ``(3, 3)`` from straight small pixels of the first image to those of this one.
        cov: ``(8, 8)`` of that, in units of ``unit``, see ``keyframes``.
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
        return place_cov_px2(self.cov, self.unit, apply_homography(self.homography, first))

    def first_std_px(self, first: FloatArray) -> float:
        """Largest standard deviation of points at ``first (n, 2)``, in pixels of the first image."""
        back = np.linalg.inv(self.homography)
        cov = place_cov_px2(compose_cov(self.cov, np.asarray(back), self.unit), self.unit, first)
        return math.sqrt(float(np.max(np.linalg.eigvalsh(cov))))


class PlaneLock:
    """Holds the plane.

    Args:
        first: The first image.
        near_px: ``(n, 2)`` small pixels around which the plane is looked at, because farther away it may be another.
        reach_px: How far around them.
    """

    def __init__(self, first: PlaneImage, near_px: FloatArray, reach_px: float) -> None:
        self._near, self._reach_px = first.view.undistort(near_px), reach_px
        self._unit = first.view.intrinsics
        self._last, self._step = np.eye(3), np.eye(3)
        self._last_image = first
        self._posed_s = first.time_s
        self._images = 0
        self._astray = np.zeros((0, 2))
        self._keyframe_in_use = self._keyframe(first, np.eye(3), np.zeros((FREE, FREE)))
        self._keyframes = [self._keyframe_in_use]

    def know_first(self, plane_pose: PlanePose | None) -> None:
        """Set the first image's pose, which may become known after it."""
        first = self._keyframes[0]
        if first.plane_image is self._last_image:
            self._last_image = replace(first.plane_image, plane_pose=plane_pose)
        first.plane_image = replace(first.plane_image, plane_pose=plane_pose)

    def follow(self, now: PlaneImage) -> Lock | None:
        """Find the plane in the next image; None where it is not found."""
        self._images += 1
        if now.plane_pose is not None:
            self._posed_s = now.time_s
        for guess in self._guesses(now.plane_pose):
            for keyframe in (self._keyframe_in_use, *self._similar_keyframes(guess, now)):
                lock = self._fit(keyframe, guess, now)
                if lock is not None:
                    self._keyframe_in_use = keyframe
                    lock = self._choose(lock, now)
                    self._step, self._last = lock.homography @ np.linalg.inv(self._last), lock.homography
                    self._last_image = now
                    return lock
        self._step = np.eye(3)
        return None

    def _guesses(self, plane_pose: PlanePose | None) -> list[FloatArray]:
        """Homographies since the first image, the likeliest first."""
        first, last = self._keyframes[0].plane_image.plane_pose, self._last_image.plane_pose
        guesses = [
            self._step @ self._last if plane_pose is None or last is None else last.onto(plane_pose) @ self._last
        ]
        if plane_pose is not None and first is not None:
            guesses.append(first.onto(plane_pose))
        return guesses

    def _similar_keyframes(self, homography: FloatArray, now: PlaneImage) -> list[Keyframe]:
        """Other keyframes that show what is seen now, the best known first."""
        shown = [
            each
            for each in self._keyframes
            if each is not self._keyframe_in_use and _shows(each, homography, now, _SOME)
        ]
        return sorted(shown, key=lambda each: each.std_px)[:_TRIED]

    def _choose(self, lock: Lock, now: PlaneImage) -> Lock:
        """Hold on to the keyframe whose place is known best of those that show the view; else make this image one."""
        if self._images % _LOOK_BACK == 0:
            std_px = lock.first_std_px(self._near)
            for keyframe in self._similar_keyframes(lock.homography, now):
                better = self._fit(keyframe, lock.homography, now) if keyframe.std_px < _BETTER * std_px else None
                if better is not None and better.first_std_px(self._near) < _BETTER * std_px:
                    self._keyframe_in_use, lock = keyframe, better
                    break
        if not _shows(self._keyframe_in_use, lock.homography, now, _RICH):
            new = self._keyframe(now, lock.homography, lock.cov + shift_cov(_SWITCH_STD_PX, self._unit), lock)
            if len(new.corners_px) >= 2 * FEWEST:
                self._keyframe_in_use = new
                self._keyframes = [*self._keyframes[:1], *self._keyframes[1:][-_KEYFRAMES:], new]
        return lock

    def _keyframe(
        self, plane_image: PlaneImage, since_first: FloatArray, cov: FloatArray, lock: Lock | None = None
    ) -> Keyframe:
        near_px = plane_image.view.distort(apply_homography(since_first, self._near))
        corners = corners_of(plane_image.small, near_px)
        if len(self._astray) and lock is not None:
            astray_px = plane_image.view.distort(apply_homography(since_first, self._astray))
            corners = corners[nearest_px(corners, lock.land_px) < nearest_px(corners, astray_px)]
        near = corners[nearest_px(corners, near_px) <= self._reach_px]
        enough = near if len(near) >= MOST_CORNERS // 2 else corners
        still = Stillness(
            plane_image.time_s, LAND_AT_FIRST if lock is None else min(lock.land.log_odds, LAND_AS_BEFORE)
        )
        return Keyframe(
            plane_image=plane_image,
            corners_px=enough,
            since_first=since_first,
            cov=cov,
            std_px=0.0 if lock is None else lock.first_std_px(self._near),
            stillness=still,
            are_known=np.ones(len(enough), dtype=np.bool_),
            others_stationarity=still.again(),
        )

    def _fit(self, keyframe: Keyframe, guess: FloatArray, now: PlaneImage) -> Lock | None:
        """The homography by one keyframe's points, near a guess."""
        onto = guess @ np.linalg.inv(keyframe.since_first)
        there_px, inside = keyframe.seen_px(now.view, onto)
        fewest = max(FEWEST, math.ceil(_LEAST_SHARE * np.count_nonzero(inside)))
        if np.count_nonzero(inside) < fewest:
            return None
        warped = now.view.warp(keyframe.plane_image.small, onto, keyframe.plane_image.view)
        now_px, found = track_lk(warped, now.small, there_px[inside], there_px[inside])
        if np.count_nonzero(found) < fewest:
            return None
        rows = np.flatnonzero(inside)[found]
        then = keyframe.plane_image.view.undistort(keyframe.corners_px[rows])
        seen = self._matched_points(keyframe.plane_image, now, then, now.view.undistort(now_px[found]), onto)
        few = fewest if seen.predicted_cov is None else _FEWEST_PREDICTED
        groups = groups_of(seen, seen.now - apply_homography(onto, then), fewest, few)
        land = land_among(groups, seen, keyframe, rows, now, self._last_image, self._posed_s) if groups else None
        if land is None or np.count_nonzero(land.group.members) < few:
            return None
        if land.drift is not None:
            keyframe.remember(rows[land.group.members], land.drift)
        if np.any(land.astray):
            self._forget(keyframe, rows[land.astray])
        whole = land.group.homography @ keyframe.since_first
        since = compose_cov(keyframe.cov, land.group.homography, self._unit)
        cov = since + land.group.cov + shift_cov(land.doubt_px, self._unit)
        return Lock(whole / np.linalg.norm(whole), cov, self._unit, land, now_px[found][land.group.members])

    def _matched_points(
        self, before: PlaneImage, after: PlaneImage, then: FloatArray, now: FloatArray, onto: FloatArray
    ) -> MatchedPoints:
        if before.plane_pose is None or after.plane_pose is None:
            return MatchedPoints(then, now, self._unit, onto, None)
        cov = predicted_cov(before.plane_pose, after.plane_pose, self._unit)
        return MatchedPoints(then, now, self._unit, before.plane_pose.onto(after.plane_pose), cov)

    def _forget(self, keyframe: Keyframe, rows: IntArray) -> None:
        """Leave corners out that do not lie still on the plane, and remember where such are."""
        back: FloatArray = np.asarray(np.linalg.inv(keyframe.since_first), dtype=np.float64)
        away = apply_homography(back, keyframe.plane_image.view.undistort(keyframe.corners_px[rows]))
        self._astray = np.concatenate([self._astray, away])[-_REMEMBERED:]
        keyframe.forget(rows)


def _shows(keyframe: Keyframe, homography: FloatArray, now: PlaneImage, least_share: float) -> bool:
    """Whether a keyframe has that share of its points in an image with this homography since the first."""
    onto: FloatArray = np.asarray(homography @ np.linalg.inv(keyframe.since_first), dtype=np.float64)
    return keyframe.is_shown(now.view, onto, least_share)


class TrackedProbes:
    """Implements ``service.ports.ImageObserver``: an observation of every tracked probe, without pixels where lost.

    Args:
        camera: The camera.
        probes: Whose pixels are those of one image: of the first, or of that of their time.
        pose_of: The pose at an image's stamp, about; None where it is not known. The first image's is asked for again.
        ground: What the probes' elevations are counted from; None for the level plane at 0.
    """

    def __init__(self, camera: Camera, probes: tuple[Probe, ...], pose_of: PoseOf, ground: Ground | None) -> None:
        times = dict.fromkeys(probe.at_ns for probe in probes)
        view = UndistortedView(camera)
        self._view = view
        self._groups = [
            _ProbeGroup(
                camera,
                PlanePoses(camera, view, pose_of, elevation_m=None),
                view,
                tuple(probe for probe in probes if probe.at_ns == at_ns),
                ground,
            )
            for at_ns in times
        ]

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """Pixels of the tracked probes in an image.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        small = self._view.small(image.pixels())
        return tuple(found for group in self._groups for found in group.look(image, small))


class _ProbeGroup:
    """Probes whose pixels are those of one image."""

    def __init__(
        self,
        camera: Camera,
        plane_poses: PlanePoses,
        view: UndistortedView,
        probes: tuple[Probe, ...],
        ground: Ground | None,
    ) -> None:
        self._camera, self._plane_poses, self._probes, self._ground = camera, plane_poses, probes, ground
        self._at_ns = probes[0].at_ns
        self._first: tuple[Image, ImageArray] | None = None
        self._lock: PlaneLock | None = None
        self._first_view = view
        self._is_missed = False
        pixels = np.array([pixel for probe in probes for pixel in probe.pixels])
        self._small_px = view.to_small(pixels)

    def look(self, image: Image, small: ImageArray) -> list[Observation]:
        """Each probe with what became of it; nothing before their time."""
        stamp_ns = image.stamp_ns
        if self._at_ns is not None and stamp_ns < self._at_ns:
            return []
        if self._first is None:
            self._is_missed |= self._at_ns is not None and stamp_ns > self._at_ns + _START_NS
            if not self._is_missed:
                self._first = replace(image, pixels=None), small
                return [Observation.in_image(image, probe.name, probe.pixels) for probe in self._probes]
        if self._first is None:
            why = "there was no image at the time that its pixels are of, or none within 0.2 s after it"
            return [Observation.in_image(image, probe.name, unseen=why) for probe in self._probes]
        first, first_small = self._first
        at_first = self._plane_poses.image_pose(first)
        if self._lock is None:  # not before, because the first image's pose may come after it
            self._first_view = self._plane_poses.view_of(at_first)
            plane_image = PlaneImage(first_small, self._first_view, 0.0, None)
            self._lock = PlaneLock(plane_image, self._small_px, _REACH * small.shape[1])
        if self._plane_poses.elevation_m is None and at_first is not None:
            pixel, elevation_m = np.array(self._probes[0].pixels[0]), self._probes[0].elevations_m(1)[0]
            self._plane_poses.find_plane(at_first, pixel, self._ground, elevation_m)
            self._lock.know_first(self._plane_poses.plane_pose(at_first))
        now = self._plane_poses.image_pose(image)
        view = self._plane_poses.view_of(now)
        time_s = (stamp_ns - first.stamp_ns) / SECOND_NS
        found = self._lock.follow(PlaneImage(small, view, time_s, self._plane_poses.plane_pose(now)))
        return [self._answer(image, probe, found, view) for probe in self._probes]

    def _answer(self, image: Image, probe: Probe, found: Lock | None, view: UndistortedView) -> Observation:
        lost = partial(Observation.in_image, image, probe.name)
        if found is None:
            return lost(unseen="the ground around it was not recognised, or what was may be water that flows")
        first_px = self._first_view.undistort(view.to_small(np.array(probe.pixels)))
        moved_px = view.to_full(view.distort(apply_homography(found.homography, first_px)))
        farthest = np.array([self._camera.width_px, self._camera.height_px]) - PIXEL_CENTRE_OFFSET_PX
        if not np.all((moved_px >= -PIXEL_CENTRE_OFFSET_PX) & (moved_px <= farthest)):
            return lost(unseen="it is out of the image")
        cov_px2 = found.cov_px2(first_px)
        homography_std_px = view.shrink * math.sqrt(float(np.max(np.linalg.eigvalsh(cov_px2))))
        if not homography_std_px <= _MOST_STD_PX:
            return lost(unseen=f"where it is in the image is known to no better than {_MOST_STD_PX:.0f} px")
        pixels = tuple((u, v) for u, v in np.round(moved_px, _DECIMALS).tolist())
        std_px = math.hypot(probe.std_px, homography_std_px, _STD_PX)
        return Observation.in_image(image, probe.name, pixels, std_px=std_px)
