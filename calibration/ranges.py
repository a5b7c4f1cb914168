"""Many slant ranges of one guess at once: what ``conditions`` says of each of them, in one pass over all pixels."""

from collections.abc import Mapping

import numpy as np

from aerodft.dft.projection import POSITION, project
from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import SlantRange
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import Pose
from calibration.state import State


class Ranges:
    """Slant ranges from a pinhole camera to level ground.

    Args:
        evidence: By the index of the observation.

    Attributes:
        owner: ``(k,)`` those indices.
        std_px: ``(k,)`` of the pixels.
    """

    def __init__(self, evidence: Mapping[int, SlantRange]) -> None:
        self.owner = np.array(list(evidence), dtype=np.intp)
        given = evidence.values()
        self.std_px = np.array([each.std_px for each in given], dtype=np.float64)
        self._pixels = np.array([each.pixel for each in given], dtype=np.float64).reshape(-1, 2)
        self._known_m = np.array([each.range_m for each in given], dtype=np.float64)
        self._std_m = np.array([each.std_m for each in given], dtype=np.float64)

    def found(self, state: State) -> tuple[FloatArray, FloatArray]:
        """What each is off by in its standard deviations ``(k,)``, by the shared errors ``(k, s)``; NaN of a miss."""
        pose = Pose(position_enu_m=state.position_m, wxyz=state.wxyz)
        ground = project(state.camera, pose, self._pixels, state.elevation_m, ProjectionModel.PINHOLE)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            away = ground.points_enu_m - state.position_m
            range_m = np.sqrt(np.sum(away * away, axis=-1))
            towards = away / range_m[:, None]
            shared = np.einsum("ki,kij->kj", towards, ground.jac_shared)
            shared[:, POSITION] -= towards
            own = np.einsum("ki,kij->kj", towards, ground.jac_px)
            variance = self.std_px**2 * np.sum(own * own, axis=-1) + self._std_m**2
            std_m = np.sqrt(variance * (1 + 1e-12))
            return (range_m - self._known_m) / std_m, shared / std_m[:, None]
