"""Who is who from image to image: tracks of objects over the ground, carried on while something hides them."""

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import FloatArray
from aerodft.service.objects import ObjectSettings
from aerodft.vision.ground_filter import GATE, GroundState, begun, distance2, predicted, updated
from aerodft.vision.sights import Sight

_SIZES: Final = 15  # sights that tell how large an object is
_SHRUNK: Final = 0.75  # lower than this share of itself: its foot is hidden; narrower: one of its sides is
_GROWN: Final = 1.4  # wider: there is somebody beside it
_ALIKE: Final = 0.2
_ASTRAY: Final = 4.0  # times the gate: what nobody else has claimed, and what is as high, is the one that was lost
_NEAR_TOP: Final = 0.4  # of its height in the image: whose head shows there is no one new
_LEAST_NEAR_PX: Final = 12.0
_FAR: Final = 1e6


@dataclass(slots=True, eq=False)
class GroundTrack:
    """One object.

    Attributes:
        state: Where it is.
        seen_ns: Stamp of the last image in which its foot was seen.
        sight: What was seen then.
        looks: In how many its foot was seen.
        number: From 1, once it is confirmed; 0 before.
        hidden: Why it is not seen in the newest image; empty where it is.
    """

    state: GroundState
    seen_ns: int
    sight: Sight
    looks: int = 1
    number: int = 0
    hidden: str = ""
    heights_m: deque[float] = field(default_factory=lambda: deque(maxlen=_SIZES))
    widths_m: deque[float] = field(default_factory=lambda: deque(maxlen=_SIZES))

    @property
    def name(self) -> str:
        """What its measurements are called."""
        return f"object-{self.number}"

    def shrunk(self, sight: Sight) -> bool:
        """Whether only the upper part of it can be seen."""
        return bool(self.heights_m) and sight.height_m < _SHRUNK * float(np.median(self.heights_m))

    def is_like(self, sight: Sight) -> bool:
        """Whether it is as high as this."""
        if not self.heights_m:
            return False
        return abs(sight.height_m / float(np.median(self.heights_m)) - 1) < _ALIKE

    def aside_px(self, sight: Sight) -> float:
        """By how much the middle of what is seen may be beside its middle, px."""
        if not self.widths_m or not sight.width_m > 0:
            return 0.0
        share = float(np.median(self.widths_m)) / sight.width_m
        return abs(share - 1) / 2 * sight.width_px if not 1 / _GROWN < share < 1 / _SHRUNK else 0.0

    def see(self, sight: Sight, cov_m2: FloatArray, stamp_ns: int) -> None:
        """Take a sight for its own."""
        self.state = updated(self.state, sight.place_en_m, cov_m2)
        if self.aside_px(sight) == 0.0:
            self.remember_size(sight)
        self.sight, self.seen_ns, self.hidden = sight, stamp_ns, ""
        self.looks += 1

    def remember_size(self, sight: Sight) -> None:
        """Learn from a sight of the whole object."""
        self.heights_m.extend([sight.height_m] if math.isfinite(sight.height_m) else [])
        self.widths_m.extend([sight.width_m] if math.isfinite(sight.width_m) else [])


class GroundTracks:
    """All tracks of a camera.

    Args:
        settings: How they are followed.
    """

    def __init__(self, settings: ObjectSettings) -> None:
        self._settings = settings
        self._tracks: list[GroundTrack] = []
        self._stamp_ns: int | None = None
        self._count = 0

    @property
    def confirmed(self) -> tuple[GroundTrack, ...]:
        """The objects that are followed, in the order in which they came."""
        return tuple(track for track in self._tracks if track.number)

    def advance(self, stamp_ns: int, sights: list[Sight]) -> bool:
        """Follow into the next image.

        Args:
            stamp_ns: Its stamp.
            sights: What is seen in it.

        Returns:
            Whether that was done: what is older than the last image is left out.
        """
        if self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            return False
        elapsed_s = 0.0 if self._stamp_ns is None else (stamp_ns - self._stamp_ns) / SECOND_NS
        self._stamp_ns = stamp_ns
        for track in self._tracks:
            track.state = predicted(track.state, elapsed_s, self._settings.acceleration_mps2)
        open_tracks = [track for track in self._tracks if track.seen_ns != stamp_ns]
        left = self._assign(open_tracks, sights, stamp_ns)
        self._begin([sight for sight in left if not self._is_part(sight, stamp_ns)], stamp_ns)
        self._end(stamp_ns)
        return True

    def drop(self, gone: list[GroundTrack]) -> None:
        """Give tracks up."""
        self._tracks = [track for track in self._tracks if track not in gone]

    def _assign(self, tracks: list[GroundTrack], sights: list[Sight], stamp_ns: int) -> list[Sight]:
        """Let every track take the sight that is its own, if there is one; what is left belongs to nobody."""
        for track in tracks:
            track.hidden = "not seen"
        left = self._pair(tracks, sights, GATE, stamp_ns)
        astray = [track for track in tracks if track.number and track.hidden]
        return self._pair(astray, left, _ASTRAY * GATE, stamp_ns)

    def _pair(self, tracks: list[GroundTrack], sights: list[Sight], gate: float, stamp_ns: int) -> list[Sight]:
        """Pair tracks and sights, as near as they can be, all together; what is left."""
        costs = np.full((len(tracks), len(sights)), _FAR)
        for row, track in enumerate(tracks):
            for column, sight in enumerate(sights):
                cov = sight.blurred_aside(track.aside_px(sight))
                off = distance2(track.state, sight.place_en_m, cov)
                if off <= gate and (gate <= GATE or track.is_like(sight)):
                    costs[row, column] = off + math.log(np.linalg.det(track.state.cov[:2, :2] + cov))
        taken: set[int] = set()
        for best in zip(*linear_sum_assignment(costs), strict=True):
            if costs[best] < _FAR:
                self._take(tracks[best[0]], sights[best[1]], stamp_ns)
                taken.add(int(best[1]))
        return [sight for column, sight in enumerate(sights) if column not in taken]

    def _take(self, track: GroundTrack, sight: Sight, stamp_ns: int) -> None:
        if track.shrunk(sight):
            track.hidden = "its foot is hidden"
            return
        track.see(sight, sight.blurred_aside(track.aside_px(sight)), stamp_ns)
        if not track.number and track.looks >= self._settings.confirm:
            self._count += 1
            track.number = self._count

    def _is_part(self, sight: Sight, stamp_ns: int) -> bool:
        """Whether it is the upper part of an object whose foot is hidden."""
        for track in self._tracks:
            if track.seen_ns == stamp_ns or not track.number:
                continue
            size_px = float(np.linalg.norm(track.sight.top_px - track.sight.foot_px))
            near_px = max(_NEAR_TOP * size_px, _LEAST_NEAR_PX)
            if track.shrunk(sight) and np.linalg.norm(sight.top_px - track.sight.top_px) < near_px:
                track.hidden = "its foot is hidden"
                track.sight = _with_top(track.sight, sight.top_px)
                return True
        return False

    def _begin(self, sights: list[Sight], stamp_ns: int) -> None:
        for sight in sights:
            state = begun(sight.place_en_m, sight.cov_m2, self._settings.speed_mps)
            track = GroundTrack(state, stamp_ns, sight)
            track.remember_size(sight)
            self._tracks.append(track)

    def _end(self, stamp_ns: int) -> None:
        """Give up what was not seen for too long; what is not confirmed, at once."""
        limit_ns = stamp_ns - round(self._settings.forget_s * SECOND_NS)
        self._tracks = [
            track for track in self._tracks if track.seen_ns == stamp_ns or (track.number and track.seen_ns >= limit_ns)
        ]


def _with_top(sight: Sight, top_px: FloatArray) -> Sight:
    """A sight moved in the image, so that its top is there."""
    move = top_px - sight.top_px
    return replace(sight, foot_px=sight.foot_px + move, top_px=top_px)
