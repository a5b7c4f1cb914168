"""A fixed camera's pose: as it is stated or calibrated, and as the pipeline takes it."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from aerodft.errors import ConfigError
from aerodft.geometry import Ground, camera_pose, east_north
from aerodft.model import CODE_OF, FloatArray, GeoOrigin, GimbalSource, HeightSource, Pose, PoseSample, PoseStd, Status
from aerodft.service.pose import ground_below, raised_by_ground


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedPose:
    """A fixed camera's pose as it was stated or calibrated.

    Attributes:
        height_agl_m: Above the measured plane, or above uneven ground right below the camera.
        tilt_rad: From straight down.
        roll_rad: Right side down.
        heading_rad: Clockwise from true north; 0 where unknown, which makes ENU turn with the camera.
        lat_rad: WGS84; None where unknown.
        lon_rad: Likewise.
        alt_msl_m: Of the camera, likewise.
        std: How well all this is known.
        covariance: 6 rows of 6, as ``Pose.cov`` has them; where it is there, it takes the place of ``std``.
        lens_covariance: 6 rows, as ``Pose.lens_cov`` has them; empty where pose and lens were not found together.
        east_m: Of the camera, in a local frame without latitude and longitude.
        north_m: Likewise.
        calibration: Id of the calibration that it came from.
    """

    height_agl_m: float
    tilt_rad: float
    roll_rad: float = 0.0
    heading_rad: float = 0.0
    lat_rad: float | None = None
    lon_rad: float | None = None
    alt_msl_m: float | None = None
    std: PoseStd = field(default_factory=PoseStd)
    covariance: tuple[tuple[float, ...], ...] = ()
    lens_covariance: tuple[tuple[float, ...], ...] = ()
    east_m: float = 0.0
    north_m: float = 0.0
    calibration: str | None = None

    def standing(self, east_m: float = 0.0, north_m: float = 0.0) -> Pose:
        """The pose above level ground, at a place of the ENU."""
        return camera_pose(
            height_agl_m=self.height_agl_m,
            tilt_rad=self.tilt_rad,
            roll_rad=self.roll_rad,
            heading_rad=self.heading_rad,
            std=self.std,
            east_m=east_m,
            north_m=north_m,
        )


def std_of(cov: FloatArray) -> PoseStd:
    """What a full covariance ``(6, 6)`` comes to in people's words; the heading is in the three rotations."""
    east, north, up, tilt, pan, roll = np.diag(cov).tolist()
    return PoseStd(
        height_agl_m=math.sqrt(up),
        horizontal_m=math.sqrt((east + north) / 2),
        tilt_rad=math.sqrt(tilt),
        pan_rad=math.sqrt(pan),
        roll_rad=math.sqrt(roll),
    )


def pose_sample(
    fixed: FixedPose, origin: GeoOrigin | None, ground: Ground | None = None, where: str = ""
) -> PoseSample:
    """A fixed camera's pose as the pipeline takes it.

    Args:
        fixed: The pose.
        origin: The station's ENU origin; without one, the camera's foot is the origin.
        ground: What the height is counted from, right below the camera; None for the level plane at 0.
        where: File that the pose is from, for messages.

    Returns:
        A sample with stamp 0, in ENU of ``origin`` where the camera's position is known, else above its own foot.

    Raises:
        ConfigError: There is no ground below the camera.
    """
    origin, east_m, north_m = placed(fixed, origin)
    pose = fixed.standing(east_m, north_m)
    if ground is not None:
        pose = _on_ground(pose, ground, where)
    datum_m = float(pose.position_enu_m[2]) - fixed.height_agl_m
    if fixed.covariance:
        pose = replace(pose, cov=np.array(fixed.covariance))
    if fixed.lens_covariance:
        pose = replace(pose, lens_cov=np.array(fixed.lens_covariance))
    return PoseSample(
        stamp_ns=0,
        status=Status.OK,
        pose=pose,
        std=fixed.std,
        origin=origin,
        lat_rad=fixed.lat_rad,
        lon_rad=fixed.lon_rad,
        alt_msl_m=fixed.alt_msl_m,
        height_source=HeightSource.CALIBRATION if fixed.calibration else HeightSource.MANUAL,
        height_datum="plane",
        datum_enu_m=datum_m,
        attitude_source=GimbalSource.MANUAL,
        calibration=fixed.calibration,
    )


def _on_ground(pose: Pose, ground: Ground, where: str) -> Pose:
    below = ground_below(ground, pose.position_enu_m[None, :2])
    if below.status[0] != CODE_OF[Status.OK]:
        hint = "check the position, or set fill_msl_m or radius_m in [ground]"
        raise ConfigError("below the pose", where=where, got=below.what(below.status[0]), expected="ground", hint=hint)
    return raised_by_ground(Pose.joined([pose]), below.height_m, below.slope).rows(0)


def placed(fixed: FixedPose, origin: GeoOrigin | None) -> tuple[GeoOrigin | None, float, float]:
    """Where a fixed camera is: an ENU origin with its east and north (m) there.

    Args:
        fixed: The camera's pose.
        origin: The station's ENU origin; without one, the camera's foot is the origin.

    Returns:
        No origin where the camera's position is unknown.
    """
    if fixed.lat_rad is None or fixed.lon_rad is None:
        return None, fixed.east_m, fixed.north_m
    if origin is None:
        foot_msl_m = None if fixed.alt_msl_m is None else fixed.alt_msl_m - fixed.height_agl_m
        return GeoOrigin(lat_rad=fixed.lat_rad, lon_rad=fixed.lon_rad, alt_msl_m=foot_msl_m), 0.0, 0.0
    east_m, north_m = map(float, east_north(origin, fixed.lat_rad, fixed.lon_rad))
    return origin, east_m, north_m
