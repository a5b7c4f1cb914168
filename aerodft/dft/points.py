"""What is found for all ground points of an image at once, before it is told apart by probe."""

import math
from dataclasses import dataclass, replace

import numpy as np

from aerodft.dft.projection import GroundPoints
from aerodft.dft.uncertainty import point_covariances, slant_ranges
from aerodft.geometry.geodesy import lat_lon
from aerodft.geometry.rotation import camera_angles
from aerodft.model.arrays import FloatArray
from aerodft.model.measurement import GeoPoint
from aerodft.model.pose import GeoOrigin, Pose


@dataclass(frozen=True, slots=True)
class ImagePoints:
    """Ground points of an image, and what is found for all of them at once.

    Attributes:
        ground: The ``(k,)`` points with what they depend on.
        shared_cov: ``(k, s, s)``, see ``shared_covariance``.
        cov_enu_m2: ``(k, 3, 3)``.
        range_m: ``(k,)`` from the camera.
        range_std_m: ``(k,)``.
        ground_m: ``(k, 3)`` in the ground frame.
        geo: ``k`` points; None without an origin.
    """

    ground: GroundPoints
    shared_cov: FloatArray
    cov_enu_m2: FloatArray
    range_m: FloatArray
    range_std_m: FloatArray
    ground_m: FloatArray
    geo: tuple[GeoPoint, ...] | None

    def __getitem__(self, rows: slice) -> "ImagePoints":
        return ImagePoints(
            self.ground[rows],
            self.shared_cov[rows],
            self.cov_enu_m2[rows],
            self.range_m[rows],
            self.range_std_m[rows],
            self.ground_m[rows],
            None if self.geo is None else self.geo[rows],
        )

    def upright(self, origin: GeoOrigin | None, pose: Pose, height_m: float) -> "ImagePoints":
        """An object's base and top: the second point is put on the vertical above the first."""
        points = np.stack([self.ground.points_enu_m[0], self.ground.points_enu_m[0] + [0.0, 0.0, height_m]])
        return replace(
            self,
            ground=replace(self.ground, points_enu_m=points),
            range_m=np.linalg.norm(points - pose.position_enu_m, axis=-1),
            ground_m=to_ground_frame(pose, points),
            geo=_geo(origin, points),
        )


def image_points(
    ground: GroundPoints, origin: GeoOrigin | None, pose: Pose, shared_cov: FloatArray, std_px: FloatArray
) -> ImagePoints:
    """Covariances, ranges, ground frame and geodetic places of an image's points, in one go."""
    with np.errstate(invalid="ignore", over="ignore"):  # misses are NaN, and have infinite derivatives
        cov_enu_m2 = point_covariances(ground, shared_cov, std_px)
        range_m, range_std_m = slant_ranges(ground, pose.position_enu_m, shared_cov, std_px)
    ground_m = to_ground_frame(pose, ground.points_enu_m)
    geo = _geo(origin, ground.points_enu_m)
    return ImagePoints(ground, shared_cov, cov_enu_m2, range_m, range_std_m, ground_m, geo)


def to_ground_frame(pose: Pose, points_enu_m: FloatArray) -> FloatArray:
    """ENU points ``(..., 3)`` in the camera's ground frame: X right, Y ahead, Z up, origin at its foot."""
    _, _, heading = camera_angles(pose.wxyz)
    sin, cos = math.sin(heading), math.cos(heading)
    away = points_enu_m - pose.position_enu_m * [1, 1, 0]
    return np.asarray(away @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]))


def _geo(origin: GeoOrigin | None, points: FloatArray) -> tuple[GeoPoint, ...] | None:
    if origin is None:
        return None
    plane = origin.alt_msl_m
    return tuple(
        GeoPoint(lat_rad=float(lat), lon_rad=float(lon), alt_msl_m=None if plane is None else plane + float(up))
        for (lat, lon), up in zip(lat_lon(origin, points[:, :2]), points[:, 2], strict=True)
    )
