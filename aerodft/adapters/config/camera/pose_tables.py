"""The tables of a fixed camera's pose: as it is stated in a station's file, and as a calibration found it."""

import math
from typing import Annotated, Self

from pydantic import model_validator

from aerodft.adapters.config.camera.bias_tables import check_lens_covariance
from aerodft.adapters.config.camera.fixed_pose import FixedPose, std_of
from aerodft.adapters.config.covariance import as_rows, checked_covariance
from aerodft.adapters.config.tables import (
    ROWS,
    UNLESS_ZERO,
    HeadingDeg,
    Latitude,
    Longitude,
    Many,
    NonNegative,
    Positive,
    Real,
    RollDeg,
    SiAttribute,
    Table,
    Text,
    TiltDeg,
    Uncertain,
    impossible,
    si_value,
    to_deg,
)
from aerodft.errors import ConfigError
from aerodft.model import PoseStd

_POSITION_STD_M = 2.0
_HEADING_STD_DEG = 2.0


class PoseStdTable(Table):
    """How well a fixed camera's stated pose is known; unknown heading and position are exact by definition."""

    height_m: Annotated[NonNegative, SiAttribute("height_agl_m")] = 0.1
    tilt_deg: NonNegative = 1.0
    pan_deg: NonNegative = 1.0
    roll_deg: NonNegative = 1.0
    heading_deg: NonNegative | None = None
    horizontal_m: NonNegative | None = None


class PoseTable(Table):
    """A fixed camera's pose, or the calibration file that has it."""

    calibration: Annotated[Text | None, SiAttribute("file")] = None
    calibration_id: Annotated[Text | None, SiAttribute("calibration")] = None
    height_agl_m: Positive | None = None
    tilt_deg: TiltDeg | None = None
    roll_deg: RollDeg = 0.0
    heading_deg: Annotated[
        HeadingDeg | None, SiAttribute("heading_rad", into=lambda angle_deg: math.radians(angle_deg or 0.0), out=to_deg)
    ] = None
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    alt_msl_m: Real | None = None
    east_m: Annotated[Real, UNLESS_ZERO] = 0.0
    north_m: Annotated[Real, UNLESS_ZERO] = 0.0
    std: PoseStdTable = PoseStdTable()
    covariance: Annotated[Many[Many[Real]] | None, ROWS] = None
    lens_covariance: Annotated[Many[Many[Real]] | None, ROWS] = None

    @model_validator(mode="after")
    def _stated_or_calibrated(self) -> Self:
        others = sorted(self.model_fields_set - {"calibration"})
        if self.calibration and others:
            raise impossible(others[0], got="it beside calibration", expected="one of the two")
        if not self.calibration:
            missing = [key for key in ("height_agl_m", "tilt_deg") if getattr(self, key) is None]
            if missing:
                raise impossible(missing[0], got="nothing", expected="height_agl_m and tilt_deg, or calibration")
        if self.covariance is not None and "std" in self.model_fields_set:
            raise impossible("covariance", got="it beside std", expected="one of the two")
        _check_place(self)
        return self


class CalibratedPoseTable(Table):
    """A fixed camera's pose, each number with or without its standard deviation."""

    height_agl_m: Uncertain[Positive]
    tilt_deg: Uncertain[TiltDeg]
    roll_deg: Uncertain[RollDeg] = Uncertain(value=0.0)
    heading_deg: Uncertain[HeadingDeg] = Uncertain(value=0.0)
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    alt_msl_m: Real | None = None
    east_m: Real = 0.0
    north_m: Real = 0.0
    covariance: Annotated[Many[Many[Real]] | None, ROWS] = None
    lens_covariance: Annotated[Many[Many[Real]] | None, ROWS] = None

    @model_validator(mode="after")
    def _position_is_whole(self) -> Self:
        _check_place(self)
        return self


def _check_place(table: PoseTable | CalibratedPoseTable) -> None:
    """Refuse half of a position, a local place beside one, and covariances that do not fit (for validators)."""
    if (table.lat_deg is None) != (table.lon_deg is None):
        missing = "lat_deg" if table.lat_deg is None else "lon_deg"
        raise impossible(missing, got="nothing", expected="both lat_deg and lon_deg, or none of them")
    if table.lat_deg is not None and (table.east_m or table.north_m):
        raise impossible("east_m" if table.east_m else "north_m", got="it beside lat_deg", expected="one of the two")
    check_lens_covariance(table.covariance, table.lens_covariance)


def fixed_pose_from(table: PoseTable, where: str) -> FixedPose:
    """A fixed camera's stated pose.

    Raises:
        ConfigError: Height or tilt is not stated, or the covariance is none.
    """
    if table.height_agl_m is None or table.tilt_deg is None:
        raise ConfigError("pose", where=where, got="a calibration", expected="height_agl_m and tilt_deg")
    if table.covariance is not None:
        of = "east, north, up, then rotation about the camera's x, y, z"
        cov = checked_covariance(table.covariance, 6, where=where, key="pose.covariance", of=of)
        return si_value(FixedPose, table, covariance=as_rows(cov), std=std_of(cov))
    horizontal_m, heading_deg = table.std.horizontal_m, table.std.heading_deg
    if horizontal_m is None:
        horizontal_m = 0.0 if table.lat_deg is None else _POSITION_STD_M
    if heading_deg is None:
        heading_deg = 0.0 if table.heading_deg is None else _HEADING_STD_DEG
    std = si_value(PoseStd, table.std, horizontal_m=horizontal_m, heading_rad=math.radians(heading_deg))
    return si_value(FixedPose, table, std=std)


def pose_table(fixed: FixedPose) -> PoseTable:
    """The table of a station's fixed pose; reading it gives an equal pose."""
    return PoseTable.from_si(fixed, **({"std": None} if fixed.covariance else {}))


def calibrated_pose_from(table: CalibratedPoseTable, identity: str, where: str) -> FixedPose:
    """The pose that a calibration found.

    Raises:
        ConfigError: Its covariance is none.
    """
    covariance: tuple[tuple[float, ...], ...] = ()
    if table.covariance is not None:
        covariance = as_rows(checked_covariance(table.covariance, 6, where=where, key="pose.covariance"))
    std = si_value(PoseStd, table, part="std")
    return si_value(FixedPose, table, std=std, covariance=covariance, calibration=identity)


def calibrated_pose_table(found: FixedPose) -> CalibratedPoseTable:
    """The table of a pose that a calibration found; reading it gives an equal pose, but for its id."""
    in_degrees = {} if found.lat_rad is None else {"east_m": None, "north_m": None}
    return CalibratedPoseTable.from_si(found, stds=found.std, **in_degrees)
