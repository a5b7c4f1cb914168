"""A fixed camera's pose: as it is stated or calibrated, and as the pipeline takes it."""

import math
from dataclasses import asdict, dataclass, field, replace
from typing import Annotated, ClassVar, Self, TypeVar

import numpy as np
from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.covariance import COVARIANCE, POSE_ROWS, check_covariance, check_lens_covariance, symmetric
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.tables import ROWS, UNLESS_ZERO, SiAttribute, Table, Uncertain, si_value, to_deg
from aerodft.errors import ConfigError
from aerodft.geometry import Ground, camera_pose, east_north
from aerodft.model import CODE_OF, FloatArray, GeoOrigin, GimbalSource, HeightSource, Pose, PoseSample, PoseStd, Status
from aerodft.service import ErrorStd
from aerodft.service.pose import ground_below, raised_by_ground

AngleStd = Annotated[float, Field(ge=0, le=180)]
StdsT = TypeVar("StdsT", PoseStd, ErrorStd)


class StdTable(Table):
    """Standard deviations; a default applies to what is left out."""

    height_m: Annotated[keys.NonNegative | None, SiAttribute("height_agl_m")] = None
    horizontal_m: keys.NonNegative | None = None
    tilt_deg: AngleStd | None = None
    pan_deg: AngleStd | None = None
    roll_deg: AngleStd | None = None
    heading_deg: AngleStd | None = None


def stds_from(table: StdTable, default: StdsT) -> StdsT:
    """The standard deviations that a validated table describes; ``default`` applies to what it leaves out."""
    stated = asdict(si_value(ErrorStd, table))
    return replace(default, **{name: std for name, std in stated.items() if std is not None})


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedPose:
    """A fixed camera's pose as it was stated or calibrated.

    Attributes:
        height_agl_m: Above the measured plane, or above uneven ground right below the camera.
        tilt_rad: From straight down.
        roll_rad: Right side down.
        heading_rad: Clockwise from true north; 0 where unknown, which makes ENU turn with the camera.
        lat_rad: WGS84; None where unknown.
        lon_rad: WGS84; None where unknown.
        alt_msl_m: Of the camera; None where unknown.
        std: How well all this is known.
        covariance: 6 rows of 6, as ``Pose.cov`` has them; where it is there, it takes the place of ``std``.
        lens_covariance: 6 rows, as ``Pose.lens_cov`` has them; empty where pose and lens were not found together.
        east_m: Of the camera, in a local frame without latitude and longitude.
        north_m: Of the camera, in that frame.
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

    def pose_on_level_ground(self, east_m: float = 0.0, north_m: float = 0.0) -> Pose:
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
    """Standard deviations of a full covariance ``(6, 6)``; that of the heading is in the three rotations."""
    east, north, up, tilt, pan, roll = np.diag(cov).tolist()
    return PoseStd(
        height_agl_m=math.sqrt(up),
        horizontal_m=math.sqrt((east + north) / 2),
        tilt_rad=math.sqrt(tilt),
        pan_rad=math.sqrt(pan),
        roll_rad=math.sqrt(roll),
    )


def pose_sample(fixed: FixedPose, origin: GeoOrigin | None, ground: Ground | None = None) -> PoseSample:
    """A fixed camera's pose as the pipeline takes it.

    Args:
        fixed: The pose.
        origin: The station's ENU origin; without one, the camera's foot is the origin.
        ground: What the height is counted from, right below the camera; None for the level plane at 0.

    Returns:
        A sample with stamp 0, in ENU of ``origin`` where the camera's position is known, else above its own foot.

    Raises:
        ConfigError: There is no ground below the camera.
    """
    origin, east_m, north_m = place_in_enu(fixed, origin)
    pose = fixed.pose_on_level_ground(east_m, north_m)
    if ground is not None:
        pose = _on_ground(pose, ground)
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


def _on_ground(pose: Pose, ground: Ground) -> Pose:
    below = ground_below(ground, pose.position_enu_m[None, :2])
    if below.status[0] != CODE_OF[Status.OK]:
        hint = "check the position, or set fill_msl_m or radius_m in [ground]"
        raise ConfigError("below the pose", got=below.what(below.status[0]), expected="ground", hint=hint)
    return raised_by_ground(Pose.concatenate([pose]), below.height_m, below.slope).rows(0)


def place_in_enu(fixed: FixedPose, origin: GeoOrigin | None) -> tuple[GeoOrigin | None, float, float]:
    """Place of a fixed camera: an ENU origin, and the camera's east and north (m) there.

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


_ANGLES = ("height_agl_m", "tilt_deg", "roll_deg", "heading_deg")
_PLACE = ("lat_deg", "lon_deg", "alt_msl_m", "east_m", "north_m")
_STATED_STD = PoseStd(
    height_agl_m=0.1,
    horizontal_m=2.0,
    tilt_rad=math.radians(1.0),
    pan_rad=math.radians(1.0),
    roll_rad=math.radians(1.0),
    heading_rad=math.radians(2.0),
)
"""Of what somebody states of a fixed camera; a heading or position that is not stated is exact by definition."""


def _radians(angle_deg: float | None) -> float:
    return math.radians(angle_deg or 0.0)


class _PlacedTable(Table):
    """Place of a camera, and the full covariance of its pose."""

    INSTEAD_OF: ClassVar = {"lat_deg": ("east_m", "north_m")}

    lat_deg: keys.Latitude | None = None
    lon_deg: keys.Longitude | None = None
    alt_msl_m: keys.Real | None = None
    east_m: Annotated[keys.Real, UNLESS_ZERO] = 0.0
    north_m: Annotated[keys.Real, UNLESS_ZERO] = 0.0
    covariance: Annotated[keys.Matrix | None, COVARIANCE] = None
    lens_covariance: Annotated[keys.Matrix | None, ROWS] = None

    @model_validator(mode="after")
    def _position_and_covariances_are_whole(self) -> Self:
        if (self.lat_deg is None) != (self.lon_deg is None):
            missing = "lat_deg" if self.lat_deg is None else "lon_deg"
            raise impossible(missing, got="nothing", expected="both lat_deg and lon_deg, or none of them")
        check_covariance(self.covariance, 6, POSE_ROWS)
        check_lens_covariance(self.covariance, self.lens_covariance)
        return self


class PoseTable(_PlacedTable):
    """A fixed camera's pose, or the calibration file that has it."""

    INSTEAD_OF: ClassVar = {
        "calibration": (*_ANGLES, *_PLACE, "std", "covariance", "lens_covariance", "calibration_id"),
        "covariance": ("std",),
        **_PlacedTable.INSTEAD_OF,
    }

    calibration: Annotated[keys.Text | None, SiAttribute("file")] = None
    calibration_id: Annotated[keys.Text | None, SiAttribute("calibration")] = None
    height_agl_m: keys.Positive | None = None
    tilt_deg: keys.TiltDeg | None = None
    roll_deg: keys.RollDeg = 0.0
    heading_deg: Annotated[keys.HeadingDeg | None, SiAttribute("heading_rad", into=_radians, out=to_deg)] = None
    std: StdTable = StdTable()

    @model_validator(mode="after")
    def _stated_or_calibrated(self) -> Self:
        if not self.calibration:
            missing = [key for key in ("height_agl_m", "tilt_deg") if getattr(self, key) is None]
            if missing:
                raise impossible(missing[0], got="nothing", expected="height_agl_m and tilt_deg, or calibration")
        return self


class CalibratedPoseTable(_PlacedTable):
    """A fixed camera's pose, each number with or without its standard deviation."""

    height_agl_m: Uncertain[keys.Positive]
    tilt_deg: Uncertain[keys.TiltDeg]
    roll_deg: Uncertain[keys.RollDeg] = Uncertain(value=0.0)
    heading_deg: Uncertain[keys.HeadingDeg] = Uncertain(value=0.0)


def fixed_pose_from(table: PoseTable) -> FixedPose:
    """A fixed camera's stated pose."""
    if table.covariance is not None:
        return si_value(FixedPose, table, std=std_of(symmetric(table.covariance)))
    std = replace(
        _STATED_STD,
        horizontal_m=0.0 if table.lat_deg is None else _STATED_STD.horizontal_m,
        heading_rad=0.0 if table.heading_deg is None else _STATED_STD.heading_rad,
    )
    return si_value(FixedPose, table, std=stds_from(table.std, std))


def calibrated_pose_from(table: CalibratedPoseTable, identity: str) -> FixedPose:
    """The pose that a calibration found."""
    return si_value(FixedPose, table, std=si_value(PoseStd, table, part="std"), calibration=identity)
