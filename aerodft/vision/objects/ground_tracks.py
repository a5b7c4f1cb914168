"""Who is who from image to image: tracks of objects over the ground, carried on while something hides them.

Outlines become places on the ground: each object's foot, its size, and how well that is known. Where an object is, and
how fast, a Kalman filter with constant velocity says, in metres. Its state is east, north, and their rates. Velocity
changes as white noise of a given power, so that what is not seen becomes uncertain as the time to the power of 3/2.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from aerodft.conventions import SECOND_NS
from aerodft.dft import (
    CHI2_2D_95,
    EDGE_STD_PX,
    ELEVATION,
    MAX_RELATIVE_RANGE_STD,
    GroundPoints,
    RayGeometry,
    Setup,
    project,
    upright_height,
)
from aerodft.geometry import matrix, rays_from_pixels
from aerodft.model import FloatArray, Observation, Pose
from aerodft.service import ObjectSettings, locate_observation

_TOP_STD_PX = 3.0
_HEIGHT_SHARE = 0.05  # of its height: heads bow, and footprints differ by as much
_LEAST_STD_M = 0.03  # a step is longer than a shoe: where somebody stands is not better defined
GATE: Final = 13.815510557964274
"""99.9 % quantile of chi-square with two degrees of freedom: what is farther off is another object."""
_SIZES: Final = 15  # footprints that tell how large an object is
_SHRUNK: Final = 0.75  # lower than this share of itself: its foot is hidden; narrower: one of its sides is
_PART: Final = 0.15  # a smaller share of it is nothing to know it by
_GROWN: Final = 1.4  # wider: there is somebody beside it
_SAME_HEIGHT: Final = 0.2
_ASTRAY: Final = 4.0  # times the gate: what nobody else has claimed, and what is as high, is the one that was lost
_BESIDE: Final = 0.1  # of its height
_FAR: Final = 1e6
_AT_LEAST_NS: Final = SECOND_NS
_COASTED: Final = 2  # times as long as it was seen
_STILL_M: Final = 1e-6  # a fixed camera moves by less
_TALLEST_M: Final = 4.0  # of what stands about
_RAGGED_M: Final = 0.5  # of what is seen of it

Place = tuple[FloatArray, FloatArray]
"""East and north ``(2,)`` with their covariance ``(2, 2)``."""

Match = Callable[["GroundTrack", "ObjectFootprint"], Place | None]
Below = Callable[["ObjectFootprint", float], Place | None]


@dataclass(frozen=True, slots=True, eq=False)
class ObjectFootprint:
    """One object on the ground.

    Attributes:
        place_en_m: ``(2,)`` of its foot.
        cov_m2: ``(2, 2)``, of what is its own: no error of the camera's.
        jac_px: ``(2, 2)`` derivative of the place by the foot's pixel.
        foot_px: ``(2,)``.
        top_px: ``(2,)``; the foot where it is not known.
        across_px: ``(2,)`` unit vector to the right where the vertical is down.
        height_m: NaN where it is not known.
        width_m: NaN where it is not known.
        width_px: NaN where it is not known.
    """

    place_en_m: FloatArray
    cov_m2: FloatArray
    jac_px: FloatArray
    foot_px: FloatArray
    top_px: FloatArray
    across_px: FloatArray
    height_m: float = math.nan
    width_m: float = math.nan
    width_px: float = math.nan

    def blurred_aside(self, std_px: float) -> FloatArray:
        """The covariance ``(2, 2)`` where the foot may be farther aside."""
        move = self.jac_px @ self.across_px * std_px
        return np.asarray(self.cov_m2 + np.outer(move, move))


def ground_at(setup: Setup, pose: Pose, pixels_px: FloatArray) -> GroundPoints:
    """Ground points of pixels ``(..., 2)``."""
    return project(setup.camera, pose, pixels_px, setup.elevation_m, setup.model, setup.ground)


def footprints(setup: Setup, pose: Pose, observations: tuple[Observation, ...]) -> list[ObjectFootprint]:
    """The objects of one image that stand on the ground, in a range that is known."""
    found = (_footprint(setup, pose, observation) for observation in observations)
    return [footprint for footprint in found if footprint is not None]


def below_top(
    setup: Setup, pose: Pose, footprint: ObjectFootprint, height_m: float
) -> tuple[FloatArray, FloatArray] | None:
    """Foot of an object of which the top is seen: east and north ``(2,)``, with covariance ``(2, 2)``.

    Args:
        setup: The station's circumstances.
        pose: Of the image.
        footprint: Of its upper part.
        height_m: How high it is.
    """
    if not math.isfinite(height_m):
        return None
    raised = replace(setup, elevation_m=setup.elevation_m + height_m)
    top = ground_at(raised, pose, footprint.top_px[None])
    if top.status[0]:
        return None
    jac_px, by_height = top.jac_px[0, :2], top.jac_shared[0, :2, ELEVATION] * _HEIGHT_SHARE * height_m
    cov = jac_px @ jac_px.T * _TOP_STD_PX**2 + np.outer(by_height, by_height) + np.eye(2) * _LEAST_STD_M**2
    return top.points_enu_m[0, :2], cov


def _footprint(setup: Setup, pose: Pose, observation: Observation) -> ObjectFootprint | None:
    std_px = observation.std_px or EDGE_STD_PX
    if not observation.has_outline:
        if not observation.pixels:
            return None
        foot = np.array(observation.pixels[0])
        ground = ground_at(setup, pose, foot[None])
        cov = np.eye(2) * std_px**2
        return _placed(setup, pose, ground, cov, (foot, foot, np.array([1.0, 0.0])))
    seen = locate_observation(observation, setup.camera, pose, std_px)
    ground = ground_at(setup, pose, np.stack([seen.foot_px, *seen.sides_px]))
    span = seen.sides_px[1] - seen.sides_px[0]
    width_px = float(np.linalg.norm(span))
    across = span / width_px if width_px > 0 else np.array([1.0, 0.0])
    size = _height_m(setup, pose, ground, seen.top_px), _width_m(ground), width_px
    return _placed(setup, pose, ground, seen.foot_cov_px2, (seen.foot_px, seen.top_px, across), size)


def _placed(
    setup: Setup,
    pose: Pose,
    ground: GroundPoints,
    cov_px2: FloatArray,
    pixels: tuple[FloatArray, FloatArray, FloatArray],
    size: tuple[float, float, float] = (math.nan, math.nan, math.nan),
) -> ObjectFootprint | None:
    if ground.status[0]:
        return None
    jac_px = ground.jac_px[0, :2]
    cov = jac_px @ cov_px2 @ jac_px.T + np.eye(2) * _LEAST_STD_M**2
    range_m = float(np.linalg.norm(ground.points_enu_m[0] - pose.position_enu_m))
    if setup.max_range_m is not None and range_m > setup.max_range_m:
        return None
    if not math.sqrt(float(np.max(np.linalg.eigvalsh(cov)))) <= MAX_RELATIVE_RANGE_STD * range_m:
        return None
    return ObjectFootprint(ground.points_enu_m[0, :2], cov, jac_px, *pixels, *size)


def _height_m(setup: Setup, pose: Pose, ground: GroundPoints, top_px: FloatArray) -> float:
    ray = rays_from_pixels(setup.camera, top_px) @ matrix(pose.wxyz).T
    foot = ground.points_enu_m[0]
    return float(upright_height(RayGeometry(pose.position_enu_m, np.stack([ray, ray]), np.stack([foot, foot]))))


def _width_m(ground: GroundPoints) -> float:
    if ground.status[1] or ground.status[2]:
        return math.nan
    return float(np.linalg.norm((ground.points_enu_m[2] - ground.points_enu_m[1])[:2]))


@dataclass(frozen=True, slots=True, eq=False)
class GroundState:
    """One object's state, with the errors that are its own: none of the camera's.

    Attributes:
        mean: ``(4,)`` east, north (m), rates (m/s).
        cov: ``(4, 4)``.
    """

    mean: FloatArray
    cov: FloatArray

    @property
    def place_en_m(self) -> FloatArray:
        """``(2,)``."""
        return self.mean[:2]

    @property
    def velocity_en_mps(self) -> FloatArray:
        """``(2,)``."""
        return self.mean[2:]


def initial_state(place_en_m: FloatArray, cov_m2: FloatArray, speed_mps: float) -> GroundState:
    """The state after the first footprint.

    Args:
        place_en_m: ``(2,)``.
        cov_m2: ``(2, 2)``.
        speed_mps: Standard deviation of each rate.
    """
    cov = np.zeros((4, 4))
    cov[:2, :2], cov[2, 2], cov[3, 3] = cov_m2, speed_mps**2, speed_mps**2
    return GroundState(np.array([*place_en_m, 0.0, 0.0]), cov)


def predict(state: GroundState, elapsed_s: float, acceleration_mps2: float) -> GroundState:
    """The state some time later.

    Args:
        state: The last one.
        elapsed_s: 0 or more.
        acceleration_mps2: What a rate has changed by after a second, a standard deviation.
    """
    if elapsed_s <= 0:
        return state
    on = np.eye(4)
    on[0, 2] = on[1, 3] = elapsed_s
    power = acceleration_mps2**2
    noise = np.array([[elapsed_s**3 / 3, elapsed_s**2 / 2], [elapsed_s**2 / 2, elapsed_s]]) * power
    return GroundState(on @ state.mean, on @ state.cov @ on.T + np.kron(noise, np.eye(2)))


def distance2(state: GroundState, place_en_m: FloatArray, cov_m2: FloatArray) -> float:
    """Squared Mahalanobis distance of a footprint ``(2,)`` with covariance ``(2, 2)``."""
    off = place_en_m - state.place_en_m
    return float(off @ np.linalg.solve(state.cov[:2, :2] + cov_m2, off))


def update(state: GroundState, place_en_m: FloatArray, cov_m2: FloatArray) -> GroundState:
    """The state with a footprint ``(2,)`` of covariance ``(2, 2)``; Joseph's form, whose covariance stays one.

    What is farther off than 95 of 100 are counts less, as much as makes it one of these: outlines have fringes.
    """
    excess = distance2(state, place_en_m, cov_m2) / CHI2_2D_95
    if excess > 1:
        cov_m2 = cov_m2 + (excess - 1) * (state.cov[:2, :2] + cov_m2)
    spread = state.cov[:2, :2] + cov_m2
    gain = np.linalg.solve(spread, state.cov[:2]).T
    keep = np.eye(4)
    keep[:, :2] -= gain
    mean = state.mean + gain @ (place_en_m - state.place_en_m)
    return GroundState(mean, keep @ state.cov @ keep.T + gain @ cov_m2 @ gain.T)


@dataclass(slots=True, eq=False)
class GroundTrack:
    """One object.

    Attributes:
        state: Where it is.
        seen_ns: Stamp of the last image in which its foot was seen.
        shown_ns: Stamp of the last image in which anything of it was seen.
        footprint: What was seen in the last image with its foot.
        begun_ns: Stamp of the image in which it was first seen.
        begun_en_m: ``(2,)`` where it seemed to be then.
        begun_camera_m: ``(3,)`` from where it was seen then.
        looks: In how many its foot was seen.
        number: From 1, once it is confirmed; 0 before.
        hidden: Why it is not seen in the newest image; empty where it is.
    """

    state: GroundState
    seen_ns: int
    shown_ns: int
    footprint: ObjectFootprint
    begun_ns: int
    begun_en_m: FloatArray
    begun_camera_m: FloatArray
    looks: int = 1
    number: int = 0
    hidden: str = ""
    heights_m: deque[float] = field(default_factory=lambda: deque(maxlen=_SIZES))
    widths_m: deque[float] = field(default_factory=lambda: deque(maxlen=_SIZES))

    @property
    def name(self) -> str:
        """Name of the object's measurements."""
        return f"object-{self.number}"

    def shrunk(self, footprint: ObjectFootprint) -> bool:
        """Whether only the upper part of it can be seen."""
        return footprint.height_m < _SHRUNK * self.height_m

    def may_show(self, footprint: ObjectFootprint) -> bool:
        """Whether that may be its upper part, and is enough of it."""
        return self.shrunk(footprint) and footprint.height_m > _PART * self.height_m

    def is_like(self, footprint: ObjectFootprint) -> bool:
        """Whether a footprint is about as high as the object."""
        return abs(footprint.height_m / self.height_m - 1) < _SAME_HEIGHT

    def aside_px(self, footprint: ObjectFootprint) -> float:
        """Bound of the distance between the middle of the seen outline and the object's middle, px."""
        if not self.widths_m or not footprint.width_m > 0:
            return 0.0
        share = float(np.median(self.widths_m)) / footprint.width_m
        return abs(share - 1) / 2 * footprint.width_px if not 1 / _GROWN < share < 1 / _SHRUNK else 0.0

    def shows(self, footprint: ObjectFootprint, other: ObjectFootprint) -> bool:
        """Whether it, seen with its top where ``footprint`` has it, is what the other one is a piece of as well."""
        if other is footprint:
            return True
        up = self.footprint.top_px - self.footprint.foot_px
        size_px = float(np.linalg.norm(up))
        if not size_px > 0 or not self.shrunk(other):
            return False
        for point in (other.foot_px, other.top_px):
            off = footprint.top_px - point
            along = float(off @ up) / size_px
            aside = abs(float(off @ np.array([up[1], -up[0]]))) / size_px
            if not -_BESIDE * size_px < along < (1 + _BESIDE) * size_px or aside > self.footprint.width_px:
                return False
        return True

    @property
    def height_m(self) -> float:
        """Height of the object; NaN where it is not known."""
        return float(np.median(self.heights_m)) if self.heights_m else math.nan

    def has_moved(self, camera_enu_m: FloatArray) -> bool:
        """Whether it moves, where it may as well be the top of what stands still, past which the camera has moved.

        That seems to go the other way over the ground, by the share ``h / (H - h)`` of the camera's way.
        """
        way = (camera_enu_m - self.begun_camera_m)[:2]
        way2 = float(way @ way)
        if way2 < _STILL_M**2:
            return True
        off = self.state.place_en_m - self.begun_en_m
        below_m = float(camera_enu_m[2]) - _TALLEST_M
        most = min(_TALLEST_M / below_m, 1.0) if below_m > 0 else 1.0
        rest = off + float(np.clip(-(off @ way) / way2, 0.0, most)) * way
        spread = self.state.cov[:2, :2] + np.eye(2) * _RAGGED_M**2
        return bool(rest @ np.linalg.solve(spread, rest) > GATE)

    def see(self, footprint: ObjectFootprint, stamp_ns: int) -> None:
        """Take a footprint for its own, foot and all."""
        if self.aside_px(footprint) == 0.0:
            self.remember_size(footprint)
        self.footprint, self.seen_ns, self.hidden = footprint, stamp_ns, ""
        self.looks += 1

    def remember_size(self, footprint: ObjectFootprint) -> None:
        """Learn from a footprint of the whole object."""
        self.heights_m.extend([footprint.height_m] if math.isfinite(footprint.height_m) else [])
        self.widths_m.extend([footprint.width_m] if math.isfinite(footprint.width_m) else [])


class GroundTracks:
    """Tracks of all objects that a camera sees.

    Args:
        settings: How they are followed.
    """

    def __init__(self, settings: ObjectSettings) -> None:
        self._settings = settings
        self._tracks: list[GroundTrack] = []
        self._stamp_ns: int | None = None
        self._camera_enu_m: FloatArray = np.zeros(3)
        self._count = 0

    @property
    def confirmed(self) -> tuple[GroundTrack, ...]:
        """Tracks of confirmed objects, in order of their confirmation."""
        return tuple(track for track in self._tracks if track.number)

    def advance(self, stamp_ns: int, footprints: list[ObjectFootprint], below: Below, camera_enu_m: FloatArray) -> bool:
        """Follow into the next image.

        Args:
            stamp_ns: Its stamp.
            footprints: What is seen in it.
            below: Where an object stands of which only the top is seen, by its height; None where that is not known.
            camera_enu_m: ``(3,)`` where the camera is.

        Returns:
            Whether that was done: what is older than the last image is left out.
        """
        if self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            return False
        elapsed_s = 0.0 if self._stamp_ns is None else (stamp_ns - self._stamp_ns) / SECOND_NS
        self._stamp_ns, self._camera_enu_m = stamp_ns, camera_enu_m
        for track in self._tracks:
            track.state = predict(track.state, elapsed_s, self._settings.acceleration_mps2)
        open_tracks = [track for track in self._tracks if track.seen_ns != stamp_ns]
        self._begin(self._assign(open_tracks, footprints, stamp_ns, below), stamp_ns)
        self._end(stamp_ns)
        return True

    def drop(self, gone: list[GroundTrack]) -> None:
        """Give tracks up."""
        self._tracks = [track for track in self._tracks if track not in gone]

    def _assign(
        self, tracks: list[GroundTrack], footprints: list[ObjectFootprint], stamp_ns: int, below: Below
    ) -> list[ObjectFootprint]:
        """Let every track take the footprint that is its own, if there is one; what is left belongs to nobody."""
        for track in tracks:
            track.hidden = "not seen"

        def whole(track: GroundTrack, footprint: ObjectFootprint) -> Place | None:
            return (
                None
                if track.shrunk(footprint)
                else (footprint.place_en_m, footprint.blurred_aside(track.aside_px(footprint)))
            )

        def upper_part(track: GroundTrack, footprint: ObjectFootprint) -> Place | None:
            return below(footprint, track.height_m) if track.number and track.may_show(footprint) else None

        def astray(track: GroundTrack, footprint: ObjectFootprint) -> Place | None:
            return whole(track, footprint) if track.number and track.is_like(footprint) else None

        for match, gate in ((whole, GATE), (upper_part, GATE), (astray, _ASTRAY * GATE)):
            left = [track for track in tracks if track.hidden == "not seen"]
            shown: list[tuple[GroundTrack, ObjectFootprint]] = []
            for row, column, place in _pairs(left, footprints, match, gate):
                if any(track.shows(first, footprints[column]) for track, first in shown):
                    continue
                self._take(left[row], footprints[column], place, stamp_ns, has_foot=match is not upper_part)
                shown.append((left[row], footprints[column]))
            footprints = [
                footprint
                for footprint in footprints
                if not any(track.shows(first, footprint) for track, first in shown)
            ]
        return footprints

    def _take(
        self, track: GroundTrack, footprint: ObjectFootprint, place: Place, stamp_ns: int, *, has_foot: bool
    ) -> None:
        track.state, track.shown_ns = update(track.state, *place), stamp_ns
        if not has_foot:
            track.hidden = "its foot is hidden"
            return
        track.see(footprint, stamp_ns)
        is_known = bool(track.number) or track.looks < self._settings.confirm_looks
        if not is_known and track.has_moved(self._camera_enu_m):
            self._count += 1
            track.number = self._count

    def _begin(self, footprints: list[ObjectFootprint], stamp_ns: int) -> None:
        for footprint in footprints:
            state = initial_state(footprint.place_en_m, footprint.cov_m2, self._settings.speed_mps)
            begun = stamp_ns, footprint.place_en_m, self._camera_enu_m
            track = GroundTrack(state, stamp_ns, stamp_ns, footprint, *begun)
            track.remember_size(footprint)
            self._tracks.append(track)

    def _end(self, stamp_ns: int) -> None:
        """Give up what was not seen for too long, or for much longer than it was; what is not confirmed, at once."""
        most_ns = round(self._settings.track_timeout_s * SECOND_NS)
        least_ns = min(_AT_LEAST_NS, most_ns)
        self._tracks = [
            track
            for track in self._tracks
            if track.shown_ns == stamp_ns
            or (
                track.number
                and stamp_ns - track.shown_ns
                <= min(max(_COASTED * (track.shown_ns - track.begun_ns), least_ns), most_ns)
            )
        ]


def _pairs(
    tracks: list[GroundTrack], footprints: list[ObjectFootprint], match: Match, gate: float
) -> list[tuple[int, int, Place]]:
    """Tracks and footprints paired as near as can be, all together: indices, and the footprint's place; best first."""
    costs = np.full((len(tracks), len(footprints)), _FAR)
    places: dict[tuple[int, int], Place] = {}
    for row, track in enumerate(tracks):
        for column, footprint in enumerate(footprints):
            place = match(track, footprint)
            if place is not None and (off := distance2(track.state, *place)) <= gate:
                costs[row, column] = off + math.log(np.linalg.det(track.state.cov[:2, :2] + place[1]))
                places[row, column] = place
    best = zip(*(each.tolist() for each in linear_sum_assignment(costs)), strict=True)
    paired = sorted((pair for pair in best if pair in places), key=lambda pair: float(costs[pair]))
    return [(row, column, places[row, column]) for row, column in paired]
