"""River widths at many transects of one image, with their joint covariance.

All widths of an image share the errors of pose, lens and water elevation; an error of a bank along its transect is that
bank's own, except for the part common to all banks of an image.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft.covariance import Z95, shared_covariance
from aerodft.dft.probe_kinds import MAX_RELATIVE_RANGE_STD
from aerodft.dft.projection import FOCAL, GroundPoints, project
from aerodft.dft.request import Setup
from aerodft.model import Batch, BoolArray, FloatArray, Pose

_DRAW_COUNT: Final = 4000
_SEED: Final = 7


@dataclass(frozen=True, slots=True, eq=False)
class BankPair:
    """Bank pixels at the two ends of each width, with their errors.

    Attributes:
        pixels_px: ``(n, 2, 2)``: left, then right bank.
        across_px: ``(n, 2, 2)`` unit vectors along the transect in the image, from water to land.
        std_px: ``(n, 2)`` standard deviation along ``across_px``, independent between banks.
        common_px: Standard deviation of the outward error common to all banks, along ``across_px``.
        alternative_width_delta_m: ``(n,)`` widening by another reading of the image, one std of one shared error.
    """

    pixels_px: FloatArray
    across_px: FloatArray
    std_px: FloatArray
    common_px: float
    alternative_width_delta_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class RiverWidths(Batch):
    """Widths of one image, with their joint covariance.

    Attributes:
        width_m: ``(n,)`` horizontal; NaN where an end has no ground.
        shared: ``(n, s)`` change of each width by one standard deviation of each independent shared error, m.
        own_m: ``(n,)`` standard deviation of each width's independent error.
        relative_range_std: ``(n,)`` relative standard deviation of the less certain end's slant range.
        points_enu_m: ``(n, 2, 3)``.
        shift: ``(n, s)`` displacement of each transect downstream by one standard deviation of each shared error, m;
            None where places are exact.
        by_cause: ``(n, 2)`` derivative of each width by an error of the stamp (s) and of the focal length (share);
            None where unknown.
    """

    width_m: FloatArray
    shared: FloatArray
    own_m: FloatArray
    relative_range_std: FloatArray
    points_enu_m: FloatArray
    shift: FloatArray | None = None
    by_cause: FloatArray | None = None

    @property
    def std_m(self) -> FloatArray:
        """Standard deviations ``(n,)``."""
        return np.asarray(np.sqrt(np.sum(self.shared**2, axis=-1) + self.own_m**2))

    @property
    def ci95_m(self) -> FloatArray:
        """95 % intervals ``(n, 2)``, not below 0."""
        half = Z95 * self.std_m
        return np.stack([np.maximum(self.width_m - half, 0.0), self.width_m + half], axis=-1)

    @property
    def usable(self) -> BoolArray:
        """Which widths ``(n,)`` have ground at both ends, with a range that is known well enough."""
        with np.errstate(invalid="ignore"):
            return np.asarray(np.isfinite(self.width_m) & (self.relative_range_std <= MAX_RELATIVE_RANGE_STD))

    def covariance(self) -> FloatArray:
        """Joint covariance ``(n, n)``, m^2."""
        return self.shared @ self.shared.T + np.diag(self.own_m**2)

    def median(self, used: BoolArray) -> tuple[float, float, tuple[float, float]]:
        """Median of the used widths, its standard deviation and its 95 % interval, m.

        Shared errors do not average out. The errors are drawn: a median has no useful derivative.
        """
        width, shared, own = self.width_m[used], self.shared[used], self.own_m[used]
        generator = np.random.default_rng(_SEED)
        errors = generator.standard_normal((_DRAW_COUNT, shared.shape[1])) @ shared.T
        errors += generator.standard_normal((_DRAW_COUNT, len(width))) * own
        medians = np.median(width + errors, axis=-1)
        middle = float(np.median(width))
        low, high = (float(each) for each in np.quantile(medians, [0.025, 0.975]))
        return middle, float(np.std(medians)), (max(low, 0.0), high)


def river_widths(setup: Setup, pose: Pose, banks: BankPair) -> RiverWidths:
    """Measure widths between pairs of bank pixels; pinhole model, level water at ``setup.elevation_m``."""
    count = len(banks.pixels_px)
    ground = project(setup.camera, pose, banks.pixels_px, setup.elevation_m, setup.model)
    points = ground.points_enu_m
    with np.errstate(invalid="ignore", divide="ignore"):
        difference = (points[:, 0] - points[:, 1]) * [1.0, 1.0, 0.0]
        width = np.linalg.norm(difference, axis=-1)
        unit = difference / width[:, None]
    by_points = np.stack([unit, -unit], axis=1)
    jac_shared = np.einsum("nki,nkis->ns", by_points, ground.jac_shared)
    by_offset = np.einsum("nki,nkij,nkj->nk", by_points, ground.jac_px, banks.across_px)
    own = np.sqrt(np.sum(np.square(by_offset * banks.std_px), axis=-1))
    root = _symmetric_root(shared_covariance(setup.camera, pose, np.array(setup.surface_std_m)))
    common = banks.common_px * by_offset.sum(axis=-1)
    shared = np.concatenate([jac_shared @ root, common[:, None], banks.alternative_width_delta_m[:, None]], axis=-1)
    downstream = np.stack([unit[:, 1], -unit[:, 0], np.zeros(count)], axis=-1)
    moved = np.einsum("ni,nkis->ns", downstream, ground.jac_shared) / 2 @ root
    by_stamp = jac_shared[:, :6] @ np.concatenate([pose.velocity_enu_mps, pose.rate_cam_radps])
    by_focal = jac_shared[:, FOCAL] @ np.array([setup.camera.fx_px, setup.camera.fy_px])
    return RiverWidths(
        width_m=width,
        shared=shared,
        own_m=own,
        relative_range_std=_relative_range_std(ground, pose, root),
        points_enu_m=points.reshape(count, 2, 3),
        shift=np.pad(moved, ((0, 0), (0, 2))),  # errors of the banks move no transect
        by_cause=np.stack([by_stamp, by_focal], axis=-1),
    )


def _symmetric_root(covariance: FloatArray) -> FloatArray:
    """Symmetric root ``(s, s)`` of a covariance, which may be singular.

    Similar covariances have similar roots: an error that several images share is the same column in each.
    """
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def _relative_range_std(ground: GroundPoints, pose: Pose, root: FloatArray) -> FloatArray:
    """Relative standard deviation ``(n,)`` of the less certain end's slant range."""
    sightlines = ground.points_enu_m - pose.position_enu_m
    with np.errstate(invalid="ignore", divide="ignore"):
        range_m = np.linalg.norm(sightlines, axis=-1)
        jac_shared = ground.jac_shared.copy()
        jac_shared[..., :3] -= np.eye(3)  # the camera's own motion is not seen from the ground point
        by = np.einsum("nki,nkis->nks", sightlines / range_m[..., None], jac_shared) @ root
        return np.asarray(np.max(np.linalg.norm(by, axis=-1) / range_m, axis=-1))
