"""What lies on top of a measured object (the paper's Section 5.4): the level plane through its top."""

import math
from dataclasses import dataclass, replace

import numpy as np

from aerodft.dft.projection import ELEVATION
from aerodft.dft.quantities import Gradient
from aerodft.dft.record import Record
from aerodft.dft.seen import Seen, dependence
from aerodft.dft.values import scalar_with_gradient
from aerodft.model.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ObjectTop:
    """The top of an upright object, and what its elevation depends on.

    Attributes:
        elevation_m: Of the top.
        by_shared: ``(s,)`` derivative by the errors that it shares with all points of the image.
        own_std_m: What the pixels of base and top alone make of its standard deviation.
        ground_elevation_std_m: Of the ground that the object stands on; one of the shared errors.
    """

    elevation_m: float
    by_shared: FloatArray
    own_std_m: float
    ground_elevation_std_m: float

    def levelled(self, record: Record) -> Record:
        """The record on the level plane through the top, instead of on the ground."""
        raised = replace(
            record.request.probe, elevation_m=self.elevation_m, elevation_std_m=self.ground_elevation_std_m
        )
        request = replace(record.request, probe=raised, on_top_of=None)
        return replace(record, request=request, setup=replace(record.setup, ground=None))

    def by_errors(self, shared: FloatArray) -> FloatArray:
        """Derivatives ``(s,)`` by the ground's errors, of such by errors that have the top's elevation as one."""
        return np.asarray(shared @ self._follows)

    def covariance(self, shared_cov: FloatArray) -> FloatArray:
        """``shared_cov (s, s)`` with the top's elevation, which depends on all the others, in place of the ground's."""
        cov = self._follows @ shared_cov @ self._follows.T
        cov[ELEVATION, ELEVATION] += self.own_std_m**2
        return np.asarray(cov)

    @property
    def _follows(self) -> FloatArray:
        follows = np.eye(len(self.by_shared))
        follows[ELEVATION] = self.by_shared
        return follows


def object_top(seen: Seen) -> ObjectTop:
    """The top of an object whose base and top are seen."""
    height, by = scalar_with_gradient(seen)
    base_up = np.zeros_like(by.by_points)
    base_up[0, 2] = 1.0
    shared, own = dependence(seen, Gradient(by.by_camera, by.by_directions, by.by_points + base_up))
    elevation = float(seen.ground.points_enu_m[0, 2]) + height
    return ObjectTop(
        elevation, shared, float(seen.std_px * np.linalg.norm(own)), math.sqrt(seen.shared_cov[ELEVATION, ELEVATION])
    )
