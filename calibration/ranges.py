"""Many ranges or lengths of one guess at once: what ``conditions`` says of each, in one pass over all pixels."""

from collections.abc import Mapping, Sequence

import numpy as np

from aerodft.dft.projection import POSITION, project
from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import KnownLength, SlantRange
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import Pose
from calibration.state import State


class Stds:
    """What is known of numbers, and how well.

    Args:
        evidence: The pieces of evidence.
        known: Their numbers, m.
    """

    def __init__(self, evidence: Sequence[SlantRange | KnownLength], known: Sequence[float]) -> None:
        self.px = np.array([each.std_px for each in evidence], dtype=np.float64)
        self._metres = np.array([each.std_m for each in evidence], dtype=np.float64)
        self._known_m = np.array(known, dtype=np.float64)

    def off(self, value_m: FloatArray, by_shared: FloatArray, by_pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What values ``(k,)`` are off by in their standard deviations, by the shared errors ``(k, s)``.

        Args:
            value_m: The values.
            by_shared: ``(k, s)`` by the shared errors.
            by_pixels: ``(k, p)`` by all of their pixels.
        """
        variance = self.px**2 * np.sum(by_pixels * by_pixels, axis=-1) + self._metres**2
        std_m = np.sqrt(variance * (1 + 1e-12))
        return (value_m - self._known_m) / std_m, by_shared / std_m[:, None]


class Ranges:
    """Slant ranges from a pinhole camera to level ground.

    Args:
        evidence: By the index of the observation.

    Attributes:
        owner: ``(k,)`` those indices.
        stds: How well they are known.
    """

    def __init__(self, evidence: Mapping[int, SlantRange]) -> None:
        given = list(evidence.values())
        self.owner = np.array(list(evidence), dtype=np.intp)
        self.stds = Stds(given, [each.range_m for each in given])
        self._pixels = np.array([each.pixel for each in given], dtype=np.float64)

    def found(self, state: State) -> tuple[FloatArray, FloatArray]:
        """As ``Stds.off``; NaN of a miss."""
        pose = Pose(position_enu_m=state.position_m, wxyz=state.wxyz)
        ground = project(state.camera, pose, self._pixels, state.elevation_m, ProjectionModel.PINHOLE)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            away = ground.points_enu_m - state.position_m
            range_m = np.sqrt(np.sum(away * away, axis=-1))
            towards = away / range_m[:, None]
            shared = np.einsum("ki,kij->kj", towards, ground.jac_shared)
            shared[:, POSITION] -= towards
            return self.stds.off(range_m, shared, np.einsum("ki,kij->kj", towards, ground.jac_px))


class Lengths:
    """Horizontal lengths between two points of level ground, or of a level above it, seen by a pinhole camera.

    Args:
        evidence: By the index of the observation.

    Attributes:
        owner: ``(k,)`` those indices.
        stds: How well they are known.
    """

    def __init__(self, evidence: Mapping[int, KnownLength]) -> None:
        given = list(evidence.values())
        self.owner = np.array(list(evidence), dtype=np.intp)
        self.stds = Stds(given, [each.length_m for each in given])
        self._pixels = np.array([each.pixels for each in given], dtype=np.float64)
        self._elevation_m = np.array([[each.elevation_m] for each in given], dtype=np.float64)

    def found(self, state: State) -> tuple[FloatArray, FloatArray]:
        """As ``Stds.off``; NaN where one of the points is missed."""
        pose = Pose(position_enu_m=state.position_m, wxyz=state.wxyz)
        up_m = state.elevation_m + self._elevation_m
        ground = project(state.camera, pose, self._pixels, up_m, ProjectionModel.PINHOLE)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            apart = ground.points_enu_m[:, 1, :2] - ground.points_enu_m[:, 0, :2]
            length_m = np.sqrt(np.sum(apart * apart, axis=-1))
            along = apart / length_m[:, None]
            by_points = np.stack([-along, along], axis=1)
            shared = np.einsum("kpi,kpij->kj", by_points, ground.jac_shared[:, :, :2])
            own = np.einsum("kpi,kpij->kpj", by_points, ground.jac_px[:, :, :2])
            return self.stds.off(length_m, shared, own.reshape(len(own), -1))
