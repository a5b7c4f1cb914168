"""Where a fixed camera looks, out of many looks: a mean over the last ones, and how far single images scatter."""

from collections import deque
from typing import Final

import numpy as np

from aerodft.geometry.rotation import from_rotation_vector, inverse, multiply, to_rotation_vector
from aerodft.geometry.turning import Turn
from aerodft.model.arrays import FloatArray

_WINDOW: Final = 10
_MEMORY: Final = 60  # looks
_EXPECTED_LOOKS: Final = 4  # that the expectation counts for, against what is seen
_EXPECTED: Final = 0.15  # of the limit: standard deviation of a mast in the wind, about an axis
_STRONG: Final = 0.25  # of the limit: in as strong a wind as may be, before a few looks have told better
_SHARED_PX: Final = 0.03  # what all points of a look are off by together, as trackers and sensors make it


class Scatter:
    """How far a camera turns to and fro between images, each axis alike.

    Args:
        limit_rad: What counts as moved.
    """

    def __init__(self, limit_rad: float) -> None:
        self._weight = float(_EXPECTED_LOOKS)
        self._strong_rad2 = (_STRONG * limit_rad) ** 2
        self.variance_rad2 = (_EXPECTED * limit_rad) ** 2

    @property
    def most_rad2(self) -> float:
        """What the variance may be, about each axis."""
        is_known = self._weight >= _EXPECTED_LOOKS + _WINDOW
        return self.variance_rad2 if is_known else max(self.variance_rad2, self._strong_rad2)

    def learn(self, off_rad: FloatArray) -> None:
        """Take in how far a look was ``(3,)`` from where the camera looks on the whole."""
        self._weight = min(self._weight + 1, float(_MEMORY))
        self.variance_rad2 += (float(np.mean(np.square(off_rad))) - self.variance_rad2) / self._weight


class Level:
    """The mean over the last looks of a camera that rests."""

    def __init__(self, first: Turn) -> None:
        self._base_wxyz = first.wxyz
        self._turns: deque[Turn] = deque([first], maxlen=_WINDOW)
        self._mean_rad = np.zeros(3)

    @classmethod
    def over(cls, turns: list[Turn]) -> "Level":
        """Over some looks, at least one."""
        level = cls(turns[0])
        for turn in turns[1:]:
            level.add(turn)
        return level

    @property
    def wxyz(self) -> FloatArray:
        """``(4,)`` ``now_SO3_reference``."""
        return multiply(from_rotation_vector(self._mean_rad), self._base_wxyz)

    @property
    def looks(self) -> int:
        """How many it is the mean of."""
        return len(self._turns)

    @property
    def last(self) -> Turn:
        """The newest of them."""
        return self._turns[-1]

    def add(self, turn: Turn) -> None:
        """Take in a look; the oldest one leaves."""
        self._turns.append(turn)
        self._mean_rad = np.mean([_between(self._base_wxyz, each) for each in self._turns], axis=0)

    def off(self, turn: Turn) -> FloatArray:
        """How far a look is from here: a small rotation ``(3,)`` about the camera's axes now."""
        return _between(self.wxyz, turn)

    def newest(self, count: int) -> list[Turn]:
        """The last looks."""
        return list(self._turns)[-count:]

    def step(self, count: int) -> FloatArray:
        """From all looks but the last ``count`` to these, ``(3,)``; zero where that leaves none."""
        offs = [_between(self._base_wxyz, each) for each in self._turns]
        if len(offs) <= count:
            return np.zeros(3)
        return np.asarray(np.mean(offs[-count:], axis=0) - np.mean(offs[:-count], axis=0))

    def covariance(self, focal_px: float, variance_rad2: float) -> FloatArray:
        """``(3, 3)`` of where a single image looks, by the looks' own errors and by how far images scatter.

        Errors of the looks are not averaged away: the points' places in the reference are the same in all of them.
        """
        measured = np.mean([each.cov for each in self._turns], axis=0)
        scatter = (_SHARED_PX / focal_px) ** 2 + variance_rad2 * (1 + 1 / len(self._turns))
        return np.asarray(measured + scatter * np.eye(3))


def _between(wxyz: FloatArray, turn: Turn) -> FloatArray:
    return to_rotation_vector(multiply(turn.wxyz, inverse(wxyz)))
