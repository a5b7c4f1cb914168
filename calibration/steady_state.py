"""From look to look: whether a fixed camera rests, was bumped, is moving, or cannot be told."""

from typing import Final

import numpy as np

from aerodft.geometry.rotation import to_rotation_vector
from aerodft.geometry.turning import Turn
from aerodft.model.arrays import FloatArray
from aerodft.model.steadiness import Steadiness
from aerodft.service.watching import WatchSettings
from calibration.steady_level import Level, Scatter
from calibration.steady_look import Look, Verdict

_RARE: Final = 6.0  # standard deviations about each axis: once in millions of looks
_NOTED: Final = 3.0
_BACK: Final = 0.9  # of the limit: who is within it again, by more than noise


class SteadyState:
    """A function of the looks that it was given, in their order.

    Args:
        settings: The limit, and how many looks must agree.

    Attributes:
        state: What the looks so far come to.
        since_ns: The first look that came to that.
        moved_ns: The first look that saw the camera where it rests by now, beyond the limit; None if it is within.
        told_ns: The last look that told by how much the camera has turned.
        has_looked: Whether there were looks enough to say that none tells.
        level: Where the camera looks; None before the first look that told.
        off_rad: How far the last look was ``(3,)`` from there; zero where that may be chance.
    """

    def __init__(self, settings: WatchSettings) -> None:
        self.state = Steadiness.UNCHECKED
        self.since_ns = 0
        self.moved_ns: int | None = None
        self.told_ns: int | None = None
        self.has_looked = False
        self.level: Level | None = None
        self.off_rad: FloatArray = np.zeros(3)
        self._settings = settings
        self._scatter = Scatter(settings.limit_rad)
        self._elsewhere: list[Turn] = []
        self._strange = self._nothing = self._beyond = 0
        self._left_ns = 0  # the first look of those that may come to a move

    @property
    def variance_rad2(self) -> float:
        """Of single images about each axis."""
        return self._scatter.variance_rad2

    def take(self, stamp_ns: int, look: Look) -> None:
        """Go on with a look."""
        before = self.state
        if look.turn is not None:
            self._strange = self._nothing = 0
            self.told_ns = stamp_ns
            self.state = self._told(stamp_ns, look.turn)
        elif look.verdict is Verdict.UNKNOWN_VIEW:
            self._strange, self._nothing = self._strange + 1, 0
            self.state = Steadiness.UNKNOWN_VIEW if self._strange >= self._settings.confirm else Steadiness.MOVING
        else:
            self._nothing += 1
            if self._nothing >= self._settings.confirm:
                self.has_looked = True
                rested = before in {Steadiness.STEADY, Steadiness.MOVED}
                self.state = Steadiness.UNCHECKED if rested else before
        if self.state is not before or not self.since_ns:
            self.since_ns = stamp_ns

    def _told(self, stamp_ns: int, turn: Turn) -> Steadiness:
        if self.level is None:
            self.level = Level(turn)
        elif np.linalg.norm(off_rad := self.level.off(turn)) > max(self._settings.limit_rad, self._chance_rad(1.0)):
            return self._jumped(stamp_ns, turn, off_rad)
        else:
            self.level = self._followed(self.level, turn, off_rad)
        self._elsewhere = []
        return self._within(stamp_ns, self.level)

    def _followed(self, level: Level, turn: Turn, off_rad: FloatArray) -> Level:
        """Where the camera looks, with a look that is near; where the last few agree on a step, by these alone."""
        is_chance = np.linalg.norm(off_rad) <= self._chance_rad(1.0) * _NOTED / _RARE
        self.off_rad = np.zeros(3) if is_chance else off_rad
        self._scatter.learn(off_rad)
        level.add(turn)
        few = self._settings.confirm
        stepped = np.linalg.norm(level.step(few)) > self._chance_rad(1 / few + 1 / max(level.looks - few, 1))
        return Level.over(level.newest(few)) if stepped else level

    def _jumped(self, stamp_ns: int, turn: Turn, off_rad: FloatArray) -> Steadiness:
        """A look far from where the camera was: believed once enough in a row agree with each other."""
        close_rad = max(self._settings.limit_rad / 2, self._chance_rad(2.0))
        if self._elsewhere and np.linalg.norm(Level.over(self._elsewhere).off(turn)) > close_rad:
            self._elsewhere = []
        if not self._elsewhere:
            self._left_ns = stamp_ns
        self._elsewhere.append(turn)
        self.off_rad = off_rad
        if len(self._elsewhere) < self._settings.confirm:
            return Steadiness.MOVING
        self.level, self.off_rad = Level.over(self._elsewhere), np.zeros(3)
        self._elsewhere, self._beyond, self.moved_ns = [], self._settings.confirm, None
        return self._within(stamp_ns, self.level)

    def _within(self, stamp_ns: int, level: Level) -> Steadiness:
        """Whether the camera has moved: by where it looks now, against where it looked at first."""
        angle_rad = float(np.linalg.norm(to_rotation_vector(level.wxyz)))
        limit_rad = self._settings.limit_rad * (1.0 if self.moved_ns is None else _BACK)
        if angle_rad <= limit_rad:
            self._beyond, self.moved_ns = 0, None
            return Steadiness.STEADY
        if not self._beyond:
            self._left_ns = stamp_ns
        self._beyond += 1
        if self.moved_ns is None and self._beyond < self._settings.confirm:
            is_drift = self.state is Steadiness.STEADY  # then it is known where the camera is
            return Steadiness.STEADY if is_drift else Steadiness.MOVING
        self.moved_ns = self.moved_ns or self._left_ns
        return Steadiness.MOVED

    def _chance_rad(self, variances: float) -> float:
        """What chance does not reach, where so many times a look's variance adds up."""
        return float(_RARE * np.sqrt(variances * self._scatter.most_rad2))
