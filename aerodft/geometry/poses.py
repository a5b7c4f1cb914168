"""Where a camera is: poses and their covariance from angles and stds, and WGS84 to the station's ENU frame by PROJ."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from aerodft.geometry.rotation import camera_attitude, from_rotation_vector, matrix, multiply
from aerodft.model import FloatArray, GeoOrigin, Pose, PoseStd

if TYPE_CHECKING:
    from pyproj import Transformer

UNKNOWN_HEADING_VAR: Final = (2 * math.pi) ** 2
"""Variance of an unknown heading, one turn of std: larger values would only drown the other errors numerically."""


def pose_covariance(enu_wxyz_cam: FloatArray, std: FloatArray) -> FloatArray:
    """Covariance ``(..., 6, 6)`` of poses (ENU position, small rotation in camera axes) from independent stds.

    Tilt, pan and roll are rotations about the camera's x, y and z; the heading's is about the vertical, a turn at most.

    Args:
        enu_wxyz_cam: ``(..., 4)``.
        std: ``(..., 7)`` in the order of the fields of ``PoseStd``; broadcast.
    """
    # Python's square: numpy's differs in the last bit once in a thousand, and recomputing must give identical bytes.
    variances = np.array([each**2 for each in std.ravel().tolist()]).reshape(std.shape)
    height, horizontal, tilt, pan, roll, heading, _ = np.moveaxis(variances, -1, 0)
    up_cam = matrix(enu_wxyz_cam)[..., 2, :]
    cov = np.zeros((*up_cam.shape[:-1], 6, 6))
    for axis, variance in enumerate((horizontal, horizontal, height, tilt, pan, roll)):
        cov[..., axis, axis] = variance
    heading = np.minimum(heading, UNKNOWN_HEADING_VAR)
    cov[..., 3:, 3:] += heading[..., None, None] * up_cam[..., :, None] * up_cam[..., None, :]
    return cov


def extrapolate_pose(pose: Pose, elapsed_s: float) -> Pose:
    """The pose extrapolated by ``elapsed_s`` (negative: backwards) with its velocity and its angular rate."""
    turn = from_rotation_vector(pose.rate_cam_radps * elapsed_s)
    position = pose.position_enu_m + pose.velocity_enu_mps * elapsed_s
    return replace(pose, position_enu_m=position, wxyz=multiply(pose.wxyz, turn))


def camera_pose(
    *,
    height_agl_m: float,
    tilt_rad: float,
    roll_rad: float = 0.0,
    heading_rad: float = 0.0,
    std: PoseStd | None = None,
    east_m: float = 0.0,
    north_m: float = 0.0,
) -> Pose:
    """Pose of a camera at ``(east_m, north_m)``, ``height_agl_m`` above the measured plane."""
    std = std or PoseStd()
    wxyz = camera_attitude(tilt_rad, roll_rad, heading_rad)
    return Pose(
        position_enu_m=np.array([east_m, north_m, height_agl_m]),
        wxyz=wxyz,
        cov=pose_covariance(wxyz, std.values),
        time_std_s=std.time_s,
    )


@lru_cache(maxsize=32)
def _transformer(origin: GeoOrigin) -> "Transformer":
    """PROJ's transformer from WGS84 longitude, latitude and height to ENU about the origin."""
    from pyproj import Transformer  # noqa: PLC0415 - 12 MB, and what has no place on earth does without

    lat_deg, lon_deg, height_m = math.degrees(origin.lat_rad), math.degrees(origin.lon_rad), origin.alt_msl_m or 0.0
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat_deg!r} +lon_0={lon_deg!r} +h_0={float(height_m)!r}"
    )


def east_north(origin: GeoOrigin, lat_rad: npt.ArrayLike, lon_rad: npt.ArrayLike) -> FloatArray:
    """East and north (m) of WGS84 points on the measured plane, ``(..., 2)``.

    The plane's own altitude is used for all of them, so that a camera and its foot share one east and north.
    """
    lat_rad, lon_rad = np.asarray(lat_rad, dtype=np.float64), np.asarray(lon_rad, dtype=np.float64)
    height = np.full_like(lat_rad, origin.alt_msl_m or 0.0)
    east, north, _ = _transformer(origin).transform(lon_rad, lat_rad, height, radians=True)
    return np.stack([np.asarray(east), np.asarray(north)], axis=-1)


def lat_lon(origin: GeoOrigin, east_north_m: FloatArray) -> FloatArray:
    """WGS84 latitude and longitude (rad) of points of the measured plane, ``(..., 2)`` to ``(..., 2)``.

    The plane is flat in ENU; over 1 km this differs from the curved earth by 8 cm in height, not in position.
    """
    east_north_m = np.asarray(east_north_m, dtype=np.float64)
    east, north = east_north_m[..., 0], east_north_m[..., 1]
    lon, lat, _ = _transformer(origin).transform(east, north, np.zeros_like(east), radians=True, direction="INVERSE")
    return np.stack([np.asarray(lat), np.asarray(lon)], axis=-1)
