"""The tables that say where a pose comes from: a vehicle's telemetry, or a fixed camera's own statement."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from aerodft.adapters.config.attitude import AttitudeTable
from aerodft.adapters.config.bias_tables import BiasTable, check_lens_covariance
from aerodft.adapters.config.calibration import check_local, check_position
from aerodft.adapters.config.covariance import as_rows, checked_covariance
from aerodft.adapters.config.fixed_pose import FixedPose, std_of
from aerodft.adapters.config.health_tables import HealthTable, ZoomTable
from aerodft.adapters.config.tables import (
    Count,
    Duration,
    Gap,
    HeadingDeg,
    Latitude,
    Longitude,
    Many,
    NonNegative,
    Order,
    Positive,
    Real,
    RollDeg,
    Table,
    Text,
    TiltDeg,
    impossible,
    matching,
)
from aerodft.adapters.mavlink.signing_settings import RADIO_STATUS
from aerodft.errors import ConfigError
from aerodft.model.pose import PoseStd

_POSITION_STD_M = 2.0
_HEADING_STD_DEG = 2.0
HeightName = Literal["rangefinder", "terrain", "home", "manual"]


class HeightStdTable(Table):
    """Standard deviation of each height source, metres."""

    rangefinder: NonNegative = 0.2
    terrain: NonNegative = 3.0
    home: NonNegative = 1.0
    manual: NonNegative = 0.5


class HeightTable(Table):
    """Which height is believed; without an order a manual one is the last."""

    order: Order[HeightName] | None = None
    home_above_plane_m: Real = 0.0
    manual_m: Positive | None = None
    min_m: NonNegative = 1.0
    max_gap_s: Gap = 2.0
    rangefinder_gap_s: Gap = 1.0
    terrain_gap_s: Gap = 5.0
    terrain_max_distance_m: Positive = 150.0
    lean_std_deg: Annotated[float, Field(ge=0, le=45)] = 0.2
    std_m: HeightStdTable = HeightStdTable()

    @model_validator(mode="after")
    def _manual_height_is_there(self) -> Self:
        if "manual" in (self.order or ()) and self.manual_m is None:
            raise impossible("manual_m", got="nothing", expected='metres, because "manual" is in order')
        return self


class TelemetryBiasTable(BiasTable):
    """Biases written into the station's own file, with the id of the calibration that they came from."""

    calibration_id: Text | None = None


class SigningTable(Table):
    """The key of a signed link."""

    key_file: Text
    state_file: Text | None = None
    link_id: Annotated[int, Field(ge=0, le=255)] = 0
    accept_unsigned: Many[Annotated[str, matching(r"[A-Z][A-Z0-9_]*", 'a message like "RADIO_STATUS"')]] = (
        RADIO_STATUS,
    )


class TelemetryTable(Table):
    """The vehicle, and how its telemetry becomes a pose."""

    connection: Text | None = None
    baud: Count = 57600
    signing: SigningTable | None = None
    system: Annotated[int, Field(ge=1, le=255)] | None = None
    component: Annotated[int, Field(ge=1, le=255)] | None = None
    gimbal: Annotated[int, Field(ge=1, le=255)] | None = None
    wait_s: Duration = 2.0
    horizontal_std_m: NonNegative = 2.0
    height: HeightTable = HeightTable()
    attitude: AttitudeTable = AttitudeTable()
    health: HealthTable = HealthTable()
    zoom: ZoomTable = ZoomTable()
    calibration: Text | None = None
    bias: TelemetryBiasTable | None = None

    @model_validator(mode="after")
    def _one_calibration(self) -> Self:
        if self.calibration and self.bias:
            raise impossible("bias", got="it beside calibration", expected="one of the two")
        return self

    @model_validator(mode="after")
    def _a_link_to_sign(self) -> Self:
        if self.signing is not None and self.connection is None:
            raise impossible("signing", got="it without connection", expected="connection beside it")
        return self


class PoseStdTable(Table):
    """How well a fixed camera's stated pose is known; unknown heading and position are exact by definition."""

    height_m: NonNegative = 0.1
    tilt_deg: NonNegative = 1.0
    pan_deg: NonNegative = 1.0
    roll_deg: NonNegative = 1.0
    heading_deg: NonNegative | None = None
    horizontal_m: NonNegative | None = None


class PoseTable(Table):
    """A fixed camera's pose, or the calibration file that has it."""

    calibration: Text | None = None
    calibration_id: Text | None = None
    height_agl_m: Positive | None = None
    tilt_deg: TiltDeg | None = None
    roll_deg: RollDeg = 0.0
    heading_deg: HeadingDeg | None = None
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    alt_msl_m: Real | None = None
    east_m: Real = 0.0
    north_m: Real = 0.0
    std: PoseStdTable = PoseStdTable()
    covariance: Many[Many[Real]] | None = None
    lens_covariance: Many[Many[Real]] | None = None

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
        check_position(self.lat_deg, self.lon_deg)
        check_local(self.lat_deg, self.east_m, self.north_m)
        check_lens_covariance(self.covariance, self.lens_covariance)
        return self


def fixed_pose_from(table: PoseTable, where: str) -> FixedPose:
    """A fixed camera's stated pose.

    Raises:
        ConfigError: Height or tilt is not stated, or the covariance is none.
    """
    if table.height_agl_m is None or table.tilt_deg is None:
        raise ConfigError("pose", where=where, got="a calibration", expected="height_agl_m and tilt_deg")
    std = _stated_std(table.std, knows_heading=table.heading_deg is not None, knows_position=table.lat_deg is not None)
    covariance: tuple[tuple[float, ...], ...] = ()
    if table.covariance is not None:
        of = "east, north, up, then rotation about the camera's x, y, z"
        cov = checked_covariance(table.covariance, 6, where=where, key="pose.covariance", of=of)
        covariance, std = as_rows(cov), std_of(cov)
    return FixedPose(
        height_agl_m=table.height_agl_m,
        tilt_rad=math.radians(table.tilt_deg),
        roll_rad=math.radians(table.roll_deg),
        heading_rad=math.radians(table.heading_deg or 0.0),
        lat_rad=None if table.lat_deg is None else math.radians(table.lat_deg),
        lon_rad=None if table.lon_deg is None else math.radians(table.lon_deg),
        alt_msl_m=table.alt_msl_m,
        std=std,
        covariance=covariance,
        lens_covariance=tuple(map(tuple, table.lens_covariance or ())),
        east_m=table.east_m,
        north_m=table.north_m,
        calibration=table.calibration_id,
    )


def _stated_std(table: PoseStdTable, *, knows_heading: bool, knows_position: bool) -> PoseStd:
    heading_deg = _HEADING_STD_DEG if knows_heading else 0.0
    horizontal_m = _POSITION_STD_M if knows_position else 0.0
    return PoseStd(
        height_agl_m=table.height_m,
        horizontal_m=horizontal_m if table.horizontal_m is None else table.horizontal_m,
        tilt_rad=math.radians(table.tilt_deg),
        pan_rad=math.radians(table.pan_deg),
        roll_rad=math.radians(table.roll_deg),
        heading_rad=math.radians(heading_deg if table.heading_deg is None else table.heading_deg),
    )
