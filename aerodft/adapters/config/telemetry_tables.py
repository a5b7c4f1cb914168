"""The table ``[telemetry]``: the vehicle, and how its telemetry becomes a pose, a height and a camera's view."""

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal, Self

from pydantic import AfterValidator, Field, create_model, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.camera import BiasTable
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.tables import (
    AS_SHARE,
    NOT_IN_CONFIG_ID,
    UNLESS_ZERO,
    SiAttribute,
    Table,
    si_value,
    to_percent,
    to_s,
)
from aerodft.errors import Reason
from aerodft.model import GimbalSource, HeightSource, ReportFrame
from aerodft.service import (
    HEIGHT_SOURCES,
    RADIO_STATUS,
    AngleScale,
    HeightSettings,
    TelemetrySettings,
    reported_sources,
)
from aerodft.service.attitude import GIMBAL_MOUNTS

MAX_ANGLE_FACTOR: Final = 1e7  # degrees in a field of 1e-7 degrees, the finest unit that MAVLink has
_FRAMES = {"auto": None, **{str(frame): frame for frame in ReportFrame}}
_AXES = {"auto": None, **{str(axes): axes for axes in GIMBAL_MOUNTS}}
_LON_FIRST = {"auto": None, "lat,lon": False, "lon,lat": True}
_IS_DEMAND = {"auto": None, "measured": False, "demand": True}
ZoomName = Literal["CAMERA_SETTINGS", "CAMERA_FOV_STATUS", "VIDEO_STREAM_INFORMATION", "subtitles", "klv"]
PitchDeg = Annotated[float, Field(ge=-180, le=180)]
Percent = Annotated[float, Field(ge=0, le=100)]
ZoomPoint = Annotated[tuple[Percent, keys.Positive], Field(strict=False)]


if TYPE_CHECKING:  # what the table of sources makes of these is known when it runs
    AttitudeName = str
    AxesName = str
    HeightName = str
    HeightStdTable = Table
else:
    AxesName = Literal[tuple(_AXES)]
    AttitudeName = Literal[tuple(map(str, (*reported_sources(), GimbalSource.FIXED_MOUNT)))]
    HeightName = Literal[tuple(map(str, HEIGHT_SOURCES))]
    HeightStdTable = create_model(
        "HeightStdTable",
        __base__=Table,
        __doc__="Standard deviation of each height source, metres.",
        **{name: (keys.NonNegative, reader.std_m) for name, reader in HEIGHT_SOURCES.items()},
    )


class HeightTable(Table):
    """Which height is believed; without an order a manual one is the last."""

    order: keys.Order[HeightName] | None = None
    home_above_plane_m: keys.Real = 0.0
    home_above_plane_std_m: Annotated[keys.NonNegative, UNLESS_ZERO] = 0.0
    manual_m: keys.Positive | None = None
    min_m: keys.NonNegative = 1.0
    max_gap_s: keys.Gap = 2.0
    rangefinder_gap_s: keys.Gap = 1.0
    terrain_gap_s: keys.Gap = 5.0
    terrain_max_distance_m: keys.Positive = 150.0
    lean_std_deg: Annotated[float, Field(ge=0, le=45)] = 0.2
    std_m: Annotated[
        HeightStdTable,
        SiAttribute(
            into=lambda table: {HeightSource(name): std_m for name, std_m in table},
            out=lambda stds_m: HeightStdTable(**{str(source): std_m for source, std_m in stds_m.items()}),
        ),
    ] = HeightStdTable()

    @model_validator(mode="after")
    def _manual_height_is_there(self) -> Self:
        if "manual" in (self.order or ()) and self.manual_m is None:
            raise impossible("manual_m", got="nothing", expected='metres, because "manual" is in order')
        return self


class FixedMountTable(Table):
    """A camera bolted to the vehicle: yaw, pitch (0 forward, -90 straight down), roll against its body."""

    yaw_deg: keys.HeadingDeg = 0.0
    pitch_deg: PitchDeg
    roll_deg: keys.RollDeg = 0.0


class CameraOnGimbalTable(FixedMountTable):
    """Mount of the camera on its gimbal: yaw, pitch (negative: it looks lower than the gimbal says), roll."""

    pitch_deg: PitchDeg = 0.0


def _no_zero(factor: float) -> float:
    if factor == 0:
        raise impossible("", got="0", expected="a factor other than 0")
    return factor


Factor = Annotated[float, Field(ge=-MAX_ANGLE_FACTOR, le=MAX_ANGLE_FACTOR), AfterValidator(_no_zero)]


class AngleScaleTable(Table):
    """Factors of a gimbal's reported angles: -1 inverts a sign, 100 corrects degrees in a field of centidegrees."""

    yaw: Factor = 1.0
    pitch: Factor = 1.0
    roll: Factor = 1.0


if TYPE_CHECKING:
    GimbalScalesTable = Table
else:
    _SCALED = list(map(str, reported_sources()))
    GimbalScalesTable = create_model(
        "GimbalScalesTable",
        __base__=Table,
        __doc__="Sources whose reported angles have a wrong sign or unit.",
        **dict.fromkeys(_SCALED, (AngleScaleTable | None, None)),
    )


def _scales_from(table: GimbalScalesTable) -> tuple[tuple[GimbalSource, AngleScale], ...]:
    return tuple((GimbalSource(name), si_value(AngleScale, each)) for name, each in table if each is not None)


def _scales_table(scales: tuple[tuple[GimbalSource, AngleScale], ...]) -> GimbalScalesTable | None:
    tables = {str(source): AngleScaleTable.from_si(scale) for source, scale in scales}
    return GimbalScalesTable(**tables) if tables else None


_GIMBALS: Final = tuple(map(str, reported_sources(own_statements=False)))
_OWN_STATEMENTS: Final = tuple(map(str, reported_sources(own_statements=True)))


def _with_own_statements(order: tuple[str, ...]) -> tuple[GimbalSource, ...]:
    """Sources of an order; all gimbals' are followed by what cameras state themselves, which comes in no such log."""
    return tuple(map(GimbalSource, (*order, *_OWN_STATEMENTS) if order == _GIMBALS else order))


def _without_own_statements(order: tuple[GimbalSource, ...]) -> tuple[str, ...]:
    """The order as files have it: ids of configurations that were written before photographs stay as they are."""
    names = tuple(map(str, order))
    return _GIMBALS if names == (*_GIMBALS, *_OWN_STATEMENTS) else names


class AttitudeTable(Table):
    """Which attitude is believed, how a gimbal's reports are read, and how well they are known."""

    order: Annotated[keys.Order[AttitudeName], SiAttribute(into=_with_own_statements, out=_without_own_statements)] = (
        _GIMBALS
    )
    scale: Annotated[GimbalScalesTable, SiAttribute(into=_scales_from, out=_scales_table)] = GimbalScalesTable()
    fixed_mount: FixedMountTable | None = None
    camera_on_gimbal: CameraOnGimbalTable | None = None
    frame: Annotated[
        Literal["auto", "earth", "body"],
        SiAttribute(into=_FRAMES.get, out=lambda frame: None if frame is None else str(frame)),
    ] = "auto"
    axes: Annotated[
        AxesName,
        SiAttribute(into=_AXES.get, out=lambda axes: None if axes is None else str(axes)),
    ] = "auto"
    feedback: Annotated[
        Literal["auto", "measured", "demand"],
        SiAttribute("is_demand", into=_IS_DEMAND.get, out={True: "demand", False: "measured"}.get),
    ] = "auto"
    delay_s: Annotated[keys.Duration, SiAttribute(out=lambda delay_ns: to_s(delay_ns) or None)] = 0.0
    lag_s: keys.Duration = 0.3
    slew_dps: keys.Rate = 60.0
    max_gap_s: keys.Gap = 1.0
    tilt_std_deg: Annotated[keys.NonNegative, SiAttribute("std.tilt_deg")] = 1.0
    pan_std_deg: Annotated[keys.NonNegative, SiAttribute("std.pan_deg")] = 1.0
    roll_std_deg: Annotated[keys.NonNegative, SiAttribute("std.roll_deg")] = 1.0
    heading_std_deg: Annotated[keys.NonNegative, SiAttribute("std.heading_deg")] = 2.0

    @model_validator(mode="after")
    def _fixed_mount_is_there(self) -> Self:
        if "fixed" in self.order and self.fixed_mount is None:
            raise impossible("fixed_mount", got="nothing", expected='a table, because "fixed" is in order')
        return self


class HealthTable(Table):
    """Limits of the vehicle's health beyond which its telemetry is not believed."""

    heartbeat_s: keys.Gap = 5.0
    max_test_ratio: Annotated[keys.Positive, SiAttribute("max_ratio")] = 1.0
    gps_s: keys.Gap = 4.0
    gps_horizontal_std_m: Annotated[keys.Positive, SiAttribute("horizontal_std_m")] = 3.0
    gps_vertical_std_m: Annotated[keys.Positive, SiAttribute("vertical_std_m")] = 5.0
    max_loss_percent: Annotated[Percent, SiAttribute("loss_share", *AS_SHARE)] = 10.0


def _curve_from(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    return tuple((AS_SHARE[0](percent), times) for percent, times in points)


def _curve_points(curve: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...] | None:
    return tuple((to_percent(level), times) for level, times in curve) or None


class ZoomTable(Table):
    """Settings for reports of the camera's view; the camera file is the reference."""

    order: keys.Many[ZoomName] = ("CAMERA_SETTINGS", "CAMERA_FOV_STATUS", "VIDEO_STREAM_INFORMATION")
    at_percent: Annotated[Percent, SiAttribute("level", *AS_SHARE)] = 0.0
    curve: Annotated[keys.Many[ZoomPoint], SiAttribute(into=_curve_from, out=_curve_points)] = ()
    reported_hfov_deg: keys.FieldOfViewDeg | None = None
    hfov_std_deg: keys.NonNegative = 0.5
    std_percent_per_doubling: Annotated[keys.NonNegative, SiAttribute("std_per_doubling", *AS_SHARE)] = 2.0
    camera: Annotated[int, Field(ge=1, le=255)] | None = None
    stream: Annotated[int, Field(ge=0, le=255)] | None = None
    max_gap_s: keys.Gap = 2.0

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if len(self.curve) == 1 or any(after[0] <= before[0] for before, after in pairwise(self.curve)):
            expected = "two or more [percent, times], percent ascending, like [[0, 1.0], [100, 6.0]]"
            raise impossible("curve", got=f"{[list(point) for point in self.curve]}", expected=expected)
        return self


class TelemetryBiasTable(BiasTable):
    """Biases written into the station's own file, with the id of the calibration that they came from."""

    calibration_id: keys.Text | None = None


class SigningTable(Table):
    """The key of a signed link."""

    key_file: keys.Text
    state_file: keys.Text | None = None
    link_id: Annotated[int, Field(ge=0, le=255)] = 0
    accept_unsigned: keys.Many[Annotated[str, keys.matching(r"[A-Z][A-Z0-9_]*", 'a message like "RADIO_STATUS"')]] = (
        RADIO_STATUS,
    )


class TelemetryTable(Table):
    """The vehicle, and how its telemetry becomes a pose."""

    INSTEAD_OF: ClassVar = {"calibration": ("bias",)}

    connection: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None
    baud: Annotated[keys.Count, NOT_IN_CONFIG_ID] = 57600
    signing: Annotated[SigningTable | None, NOT_IN_CONFIG_ID] = None
    system: Annotated[int, Field(ge=1, le=255)] | None = None
    component: Annotated[int, Field(ge=1, le=255)] | None = None
    gimbal: Annotated[int, Field(ge=1, le=255)] | None = None
    wait_s: keys.Duration = 2.0
    horizontal_std_m: Annotated[keys.NonNegative, SiAttribute("attitude.std.horizontal_m")] = 2.0
    height: HeightTable = HeightTable()
    attitude: AttitudeTable = AttitudeTable()
    health: HealthTable = HealthTable()
    zoom: ZoomTable = ZoomTable()
    calibration: keys.Text | None = None
    bias: Annotated[TelemetryBiasTable | None, NOT_IN_CONFIG_ID] = None
    gps_order: Annotated[
        Literal["auto", "lat,lon", "lon,lat"],
        SiAttribute("gps_lon_first", into=_LON_FIRST.get, out={False: "lat,lon", True: "lon,lat"}.get),
    ] = "auto"
    columns: Annotated[dict[str, keys.Text], NOT_IN_CONFIG_ID] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _known_columns(self) -> Self:
        from aerodft.adapters.telemetry import COLUMN_KEYS  # noqa: PLC0415 - loads what reads logs and images

        for key in self.columns.keys() - set(COLUMN_KEYS):
            raise impossible("columns", got=key, expected=f"one of {', '.join(COLUMN_KEYS)}")
        return self

    @model_validator(mode="after")
    def _a_link_to_sign(self) -> Self:
        if self.signing is not None and self.connection is None:
            raise impossible("signing", got=Reason("it stands without connection"), expected="connection beside it")
        return self


def telemetry_from(table: TelemetryTable) -> TelemetrySettings:
    """Telemetry settings of the tables."""
    order, height = HeightSettings().order, si_value(HeightSettings, table.height)
    if table.height.order is None:
        by_default = order if table.height.manual_m is None else (*order, HeightSource.MANUAL)
        height = replace(height, order=by_default)
    return si_value(TelemetrySettings, table, height=height)
