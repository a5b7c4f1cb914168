"""What is found for all ground points of many images at once, before it is told apart by image and probe."""

from dataclasses import dataclass, replace

import numpy as np

from aerodft.dft.projection import ELEVATION, GroundPoints
from aerodft.dft.uncertainty import PointSpread, point_spread
from aerodft.geometry.geodesy import lat_lon
from aerodft.geometry.rotation import camera_angles
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import GeoOrigin, Pose


@dataclass(frozen=True, slots=True)
class ImagePoints:
    """Ground points of ``n`` images, of ``k`` pixels in each.

    Attributes:
        pixels_px: ``(k, 2)`` the same in each, or ``(n, k, 2)``.
        pose: The ``(n,)`` poses.
        origin: Of ENU; None where it is not known where that is.
        ground: The ``(n, k)`` points with what they depend on.
        shared_cov: ``(n, s, s)``, see ``shared_covariance``; 0 for the elevation.
        elevation_std_m: ``(k,)``.
        std_px: ``(k,)``.
        spread: How well they are known.
    """

    pixels_px: FloatArray
    pose: Pose
    origin: GeoOrigin | None
    ground: GroundPoints
    shared_cov: FloatArray
    elevation_std_m: FloatArray
    std_px: FloatArray
    spread: PointSpread

    def probe(self, image: int, first: int, stop: int) -> "ProbePoints":
        """The points of one image from ``first`` to ``stop`` (half-open)."""
        rows = (image, slice(first, stop))
        cov = self.shared_cov[image].copy()
        cov[ELEVATION, ELEVATION] = self.elevation_std_m[first] ** 2
        return ProbePoints(
            self.ground[rows],
            cov,
            self.spread.cov_enu_m2[rows],
            self.spread.range_m[rows],
            self.spread.range_std_m[rows],
        )


@dataclass(frozen=True, slots=True)
class ProbePoints:
    """One probe's ``k`` points in one image.

    Attributes:
        ground: The points.
        shared_cov: ``(s, s)``, see ``shared_covariance``.
        cov_enu_m2: ``(k, 3, 3)``.
        range_m: ``(k,)`` from the camera.
        range_std_m: ``(k,)``.
    """

    ground: GroundPoints
    shared_cov: FloatArray
    cov_enu_m2: FloatArray
    range_m: FloatArray
    range_std_m: FloatArray

    def first(self, count: int) -> "ProbePoints":
        """The first ``count`` of them."""
        rows = slice(count)
        return replace(
            self,
            ground=self.ground[rows],
            cov_enu_m2=self.cov_enu_m2[rows],
            range_m=self.range_m[rows],
            range_std_m=self.range_std_m[rows],
        )


def image_points(
    pixels_px: FloatArray,
    ground: GroundPoints,
    origin: GeoOrigin | None,
    pose: Pose,
    shared_cov: FloatArray,
    elevation_std_m: FloatArray,
    std_px: FloatArray,
) -> ImagePoints:
    """The points of images with how well they are known; arguments as the attributes."""
    with np.errstate(invalid="ignore", over="ignore"):  # misses are NaN, and have infinite derivatives
        spread = point_spread(ground, pose.position_enu_m, shared_cov, elevation_std_m, std_px)
    return ImagePoints(pixels_px, pose, origin, ground, shared_cov, elevation_std_m, std_px, spread)


def to_ground_frame(pose: Pose, points_enu_m: FloatArray) -> FloatArray:
    """ENU points ``(..., 3)`` in the camera's ground frame: X right, Y ahead, Z up, origin at its foot.

    Of several poses ``(n,)`` each has its own points ``(n, k, 3)``.
    """
    _, _, heading = camera_angles(pose.wxyz)
    foot = pose.position_enu_m[..., :2]
    if heading.ndim:
        heading, foot = heading[..., None], foot[..., None, :]
    sin, cos = np.sin(heading), np.cos(heading)
    east, north = points_enu_m[..., 0] - foot[..., 0], points_enu_m[..., 1] - foot[..., 1]
    return np.stack([east * cos - north * sin, east * sin + north * cos, points_enu_m[..., 2]], axis=-1)


def lat_lon_alt(origin: GeoOrigin, points_enu_m: FloatArray) -> FloatArray:
    """Latitude, longitude (rad) and altitude (m MSL) of ENU points, ``(..., 3)``; NaN where the plane's is unknown."""
    plane = np.nan if origin.alt_msl_m is None else origin.alt_msl_m
    places = lat_lon(origin, points_enu_m[..., :2])
    return np.concatenate([places, (plane + points_enu_m[..., 2])[..., None]], axis=-1)
