"""One look at a fixed camera's steady points: by how much it has turned, or why that cannot be told."""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

import numpy as np

from aerodft.geometry.turning import Turn, find_turn
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.observation import Observation

_LEAST_AGREEING: Final = 8
_LEAST_SHARE: Final = 0.2  # of the points: strays agree by chance
_FINE: Final = 0.25  # of the limit: a turn that is known less well tells nothing
_STAY: Final = 0.4  # of the points: so many in the wrong place, and staying there, are no passers-by
_OFF: Final = 0.5  # of the limit, at the principal point: what counts as the wrong place
_LEAST_OFF_PX: Final = 2.0


class Verdict(Enum):
    """What a look says."""

    TURNED = auto()  # by how much, maybe nothing
    UNKNOWN_VIEW = auto()  # points stand still where a camera that only turned would not see them
    NOTHING = auto()


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What one observation says.

    Attributes:
        verdict: What the rest means.
        turn: ``now_SO3_reference``; None where it cannot be told.
        points: How many were found again.
    """

    verdict: Verdict
    turn: Turn | None
    points: int


class Looker:
    """Judges looks one after the other; remembers where strays were.

    Args:
        camera: The camera.
        limit_rad: What counts as moved.
    """

    def __init__(self, camera: Camera, limit_rad: float) -> None:
        self._camera = camera
        self._fine_rad = _FINE * limit_rad
        self._off_px = max(_OFF * limit_rad * camera.fx_px, _LEAST_OFF_PX)
        self._strays: dict[tuple[float, ...], FloatArray] = {}

    def judge(self, seen: Observation) -> Look:
        """What the pairs of pixels (reference, now) say."""
        pairs = np.array(seen.pixels, dtype=np.float64).reshape(-1, 2, 2)
        turn = find_turn(self._camera, pairs[:, 0], pairs[:, 1])
        staying = self._staying(pairs, turn)
        if len(pairs) >= _LEAST_AGREEING and staying >= _STAY * len(pairs):
            return Look(Verdict.UNKNOWN_VIEW, None, len(pairs))
        if turn is None or not self._tells(turn):
            return Look(Verdict.NOTHING, None, len(pairs))
        return Look(Verdict.TURNED, turn, len(pairs))

    def _tells(self, turn: Turn) -> bool:
        agreeing = int(np.count_nonzero(turn.agreeing))
        enough = agreeing >= max(_LEAST_AGREEING, _LEAST_SHARE * len(turn.agreeing))
        return enough and float(np.max(np.diag(turn.cov))) <= self._fine_rad**2

    def _staying(self, pairs: FloatArray, turn: Turn | None) -> int:
        """How many points are where the turn does not bring them, and were there at the last look too."""
        is_stray = np.ones(len(pairs), dtype=np.bool_) if turn is None else _beyond(turn.off_px, self._off_px)
        before, self._strays = self._strays, {tuple(then.tolist()): now for then, now in pairs[is_stray]}
        return sum(
            key in before and bool(np.max(np.abs(place - before[key])) <= self._off_px)
            for key, place in self._strays.items()
        )


def _beyond(off_px: FloatArray, limit_px: float) -> np.ndarray:
    """Farther off than the limit; what a turned camera should not see at all is."""
    return np.asarray(~(np.max(np.abs(off_px), axis=-1) <= limit_px))
