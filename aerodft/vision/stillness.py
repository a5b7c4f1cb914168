"""Whether points that are followed lie still on the ground or flow with the water, by what telemetry says.

Telemetry is off by more than images are, but what it is off by changes slowly; water leaves the place where it was at
its own speed. So it takes a second or two to tell, and until it is told the points may be either.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model.arrays import FloatArray

_JITTER_RAD: Final = 0.002  # what telemetry is off by anew in every image, ...
_DRIFT_RADPS: Final = 0.0025  # ... by how much that changes in a second, ...
_DRIFT_MPS: Final = 0.1  # ... and the same of its position, ...
_DRIFT_S: Final = 12.0  # ... for no longer than this
_LATE_S: Final = 0.1  # it may be early or late by so much, always by the same
_FLOW_MPS: Final = 1.0  # of water, in each direction
_COMMIT_S: Final = 1.0  # evidence of so long is remembered, and new evidence begun
_SURE: Final = 10.0  # log odds: no evidence is beyond doubt
LAND_AT_FIRST: Final = 0.85
"""Log odds that clicked points are on land, before anything has moved: 70 of 100."""
LAND_AS_BEFORE: Final = 3.0
"""Log odds, at most, that points of a new keyframe are on land because those of the one before were."""


@dataclass(frozen=True, slots=True, eq=False)
class Gone:
    """Where points are, over what they were believed to lie on.

    Attributes:
        time_s: When.
        by_m: ``(2,)`` east and north of where telemetry sees them, from where it saw them in their keyframe.
        px_by_m: ``(2, 2)`` derivative of their pixels by east and north.
        sweep_mps: ``(2,)`` how fast the line of sight there sweeps over the ground.
        focal_px: The image's focal length.
    """

    time_s: float
    by_m: FloatArray
    px_by_m: FloatArray
    sweep_mps: FloatArray
    focal_px: float

    @property
    def px(self) -> float:
        """How far they have gone."""
        return float(np.linalg.norm(self.px_by_m @ self.by_m))


class Stillness:
    """What is known of some points of a keyframe.

    Args:
        time_s: Of the keyframe.
        log_odds: That they lie still, by then.
    """

    def __init__(self, time_s: float, log_odds: float) -> None:
        self.log_odds = log_odds
        self._begun_s = time_s
        self._since_s, self._by_m = time_s, np.zeros(2)
        self._sweep_mps: FloatArray | None = None
        self._last: Gone | None = None

    def again(self) -> "Stillness":
        """Of other points of that keyframe, of which nothing is known yet."""
        return Stillness(self._begun_s, LAND_AT_FIRST)

    def with_evidence(self, gone: Gone) -> float:
        """The log odds that they lie still, with what an image says of them."""
        elapsed_s = gone.time_s - self._since_s
        still2 = self._still_px(gone) ** 2
        flowing2 = still2 + (_FLOW_MPS * elapsed_s) ** 2 * abs(float(np.linalg.det(gone.px_by_m)))
        step = gone.px_by_m @ (gone.by_m - self._by_m)
        gain = math.log(flowing2 / still2) - float(step @ step) / 2 * (1 / still2 - 1 / flowing2)
        return float(np.clip(self.log_odds + gain, -_SURE, _SURE))

    def remember(self, gone: Gone) -> bool:
        """Take an image's evidence for good, once there is enough of it; whether there was."""
        if self._sweep_mps is None:
            self._sweep_mps = gone.sweep_mps
        self._last = gone
        if abs(gone.time_s - self._since_s) < _COMMIT_S:
            return False
        self.log_odds = self.with_evidence(gone)
        self._since_s, self._by_m, self._sweep_mps = gone.time_s, gone.by_m, gone.sweep_mps
        return True

    @property
    def is_watched(self) -> bool:
        """Whether telemetry has said anything of them yet."""
        return self._last is not None

    def unwatched_px(self, time_s: float) -> float:
        """What they may have gone by now, a standard deviation, while telemetry says nothing."""
        if self._last is None:
            return 0.0
        scale = math.sqrt(abs(float(np.linalg.det(self._last.px_by_m))))
        return _FLOW_MPS * abs(time_s - self._last.time_s) * scale * math.sqrt(share_moving(self.log_odds))

    def likelihood(self, gone: Gone) -> float:
        """The logarithm of how likely its points seem to have gone there if they lie still, but for a constant."""
        step = gone.px_by_m @ (gone.by_m - self._by_m)
        return -float(step @ step) / (2 * self._still_px(gone) ** 2)

    def _still_px(self, gone: Gone) -> float:
        """How far points that lie still may seem to have gone, a standard deviation in each coordinate."""
        elapsed_s = abs(gone.time_s - self._since_s)
        metres = math.hypot(
            _DRIFT_MPS * min(elapsed_s, _DRIFT_S),
            0.0 if self._sweep_mps is None else _LATE_S * float(np.linalg.norm(gone.sweep_mps - self._sweep_mps)),
        )
        turned = math.hypot(_JITTER_RAD, _DRIFT_RADPS * min(elapsed_s, _DRIFT_S))
        return math.hypot(turned * gone.focal_px, metres * math.sqrt(abs(float(np.linalg.det(gone.px_by_m)))))


def share_moving(log_odds: float) -> float:
    """The probability that goes with log odds of lying still."""
    return 1 / (1 + math.exp(min(log_odds, 700.0)))
