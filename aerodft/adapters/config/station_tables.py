"""The tables of a station's configuration file, with their defaults and checks."""

from datetime import datetime
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from aerodft.adapters.config.live_tables import LandmarkTable, LiveTable
from aerodft.adapters.config.object_tables import ObjectsTable
from aerodft.adapters.config.pose_tables import PoseTable, TelemetryTable
from aerodft.adapters.config.river_tables import RiverTable
from aerodft.adapters.config.tables import (
    Duration,
    HeadingDeg,
    Latitude,
    Longitude,
    Many,
    NonNegative,
    Pixel,
    Positive,
    Real,
    Slug,
    Table,
    Text,
    TimeOffset,
    impossible,
    matching,
)
from aerodft.adapters.config.watch_tables import WatchTable
from aerodft.adapters.timestamps import datetime_to_unix_ns, iso_to_unix_ns, parse_offset
from aerodft.model.probe import ASKED_KINDS, ProbeKind, pixels_wanted, takes_pixels

_ONE_INPUT = ("video", "stills", "stream", "device", "rate_hz")


def _instant(value: object) -> object:
    """Text or a TOML date and time to UTC nanoseconds; an integer is that already."""
    if isinstance(value, datetime):
        if value.tzinfo is None:
            raise impossible("", got=value.isoformat(), expected="an offset from UTC", hint="end it with Z or +01:00")
        return datetime_to_unix_ns(value)
    if isinstance(value, str):
        try:
            return iso_to_unix_ns(value)
        except ValueError as error:
            raise impossible("", got=f'"{value}"', expected='like "2026-11-21T01:57:26.5Z"', hint=str(error)) from None
    return value


def _seconds_or_auto(value: object) -> object:
    """A number as it is; None for ``auto``."""
    if value == "auto":
        return None
    if isinstance(value, str):
        raise impossible("", got=f'"{value}"', expected='a number of seconds, or "auto"')
    return value


def _offset(value: str) -> str:
    try:
        parse_offset(value)
    except ValueError:
        raise impossible("", got=f'"{value}"', expected='an offset from UTC like "+02:00"') from None
    return value


class OriginTable(Table):
    """A point of the measured plane."""

    lat_deg: Latitude
    lon_deg: Longitude
    alt_msl_m: Real | None = None


class StationTable(Table):
    """Who measures."""

    name: Slug
    origin: OriginTable | None = None
    tick_ms: Annotated[int, Field(ge=1, le=1000)] = 50


class ImagesTable(Table):
    """Where images come from; at most one of the five inputs."""

    video: Text | None = None
    start: Annotated[int | None, BeforeValidator(_instant)] = None
    stills: Text | None = None
    pattern: Text | None = None
    utc_offset: Annotated[str, AfterValidator(_offset)] | None = None
    stream: Annotated[str, matching(r"[a-z0-9+]+:\S+", 'a URL like "udp://0.0.0.0:5600"')] | None = None
    device: Text | None = None
    rate_hz: Annotated[float, Field(gt=0, le=1000)] | None = None
    time_offset_s: Annotated[TimeOffset | None, BeforeValidator(_seconds_or_auto)] = 0.0
    time_drift: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    time_reference: Annotated[int | None, BeforeValidator(_instant)] = None
    time_std_s: Duration = 0.0

    @model_validator(mode="after")
    def _one_input(self) -> Self:
        given = [key for key in _ONE_INPUT if getattr(self, key) is not None]
        if len(given) > 1:
            raise impossible(given[1], got=f"it beside {given[0]}", expected=f"one of {', '.join(_ONE_INPUT)}")
        for key, owner in (("start", "video"), ("pattern", "stills"), ("utc_offset", "stills")):
            if getattr(self, key) is not None and getattr(self, owner) is None:
                raise impossible(key, got=f"it without {owner}", expected=f"{owner} beside it")
        if self.time_drift and self.time_reference is None:
            expected = "time_reference beside it, the instant of the camera's clock at which time_offset_s holds"
            raise impossible("time_drift", got="it without time_reference", expected=expected)
        if self.time_offset_s is None and (self.time_drift or self.time_reference is not None):
            raise impossible("time_offset_s", got='"auto" beside a drift', expected="a number, or no drift")
        return self


class ObservationsTable(Table):
    """Where observed pixels come from."""

    files: Many[Text] = ()
    topic: bool = True
    time_offset_s: TimeOffset = 0.0
    match_tolerance_s: Duration = 0.02


class LimitsTable(Table):
    """What is not believed."""

    max_range_m: Positive | None = None


Endpoint = Annotated[str, matching(r"(tcp|udp|tls|quic|ws)/\S+:\d+", 'like "tcp/127.0.0.1:7447"')]


class ZenohTable(Table):
    """The bus."""

    enabled: bool = True
    listen: Endpoint = "tcp/127.0.0.1:7447"
    connect: Many[Endpoint] = ()


class RecordTable(Table):
    """The recorder."""

    folder: Text = "recordings"
    image_hz: NonNegative = 1.0
    video: bool = True
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] = 80
    segment_s: Annotated[float, Field(ge=1, le=86_400)] = 900.0
    segment_mb: Annotated[float, Field(ge=1, le=100_000)] = 2000.0


class TopicsTable(Table):
    """Which topic is what in another tool's recording, where its channels do not tell."""

    mavlink: Many[Text] | Text = ()
    images: Text | None = None
    camera: Text | None = None


class PointTable(Table):
    """A point of sloping ground."""

    lat_deg: Latitude
    lon_deg: Longitude


_SLOPE_KEYS = ("uphill_azimuth_deg", "point")
_TERRAIN_KEYS = ("sha256", "radius_m", "cell_m", "band", "fill_msl_m", "refraction")


class GroundTable(Table):
    """Ground that is not level: a slope, or an elevation model."""

    slope_deg: Annotated[float, Field(ge=0, lt=90)] | None = None
    uphill_azimuth_deg: HeadingDeg | None = None
    point: PointTable | None = None
    terrain: Text | None = None
    sha256: Annotated[str, matching(r"[0-9a-f]{64}", "64 hexadecimal digits")] | None = None
    radius_m: Positive | None = None
    cell_m: Positive | None = None
    band: Annotated[int, Field(ge=1, le=65535)] = 1
    fill_msl_m: Real | None = None
    refraction: Annotated[float, Field(ge=0, lt=1)] | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.slope_deg is None) == (self.terrain is None):
            got = "neither of them" if self.terrain is None else "both of them"
            raise impossible("", got=got, expected="either slope_deg with uphill_azimuth_deg, or terrain")
        owner, others = ("slope_deg", _TERRAIN_KEYS) if self.terrain is None else ("terrain", _SLOPE_KEYS)
        if beside := [key for key in others if key in self.model_fields_set]:
            raise impossible(beside[0], got=f"it beside {owner}", expected="one of the two")
        if self.terrain is None and self.uphill_azimuth_deg is None:
            raise impossible("uphill_azimuth_deg", got="nothing", expected="where the ground rises to, from north")
        return self


def _asked(kind: ProbeKind) -> ProbeKind:
    if kind not in ASKED_KINDS:
        hint = "what moves is followed with [objects]"
        raise impossible("", got=f'"{kind}"', expected=", ".join(ASKED_KINDS), hint=hint)
    return kind


class ProbeTable(Table):
    """One thing to measure."""

    name: Slug
    kind: Annotated[ProbeKind, Field(strict=False), AfterValidator(_asked)]
    pixels: Many[Pixel] | None = None
    observed: bool = False
    tracked: bool = False
    at: Annotated[int, BeforeValidator(_instant)] | None = None
    std_px: NonNegative = 1.0
    elevation_m: Real = 0.0
    elevation_std_m: NonNegative = 0.0
    on_top_of: Slug | None = None

    @model_validator(mode="after")
    def _fixed_or_observed(self) -> Self:
        if self.observed and self.pixels is not None:
            raise impossible("pixels", got="it beside observed = true", expected="one of the two")
        if self.observed and self.tracked:
            raise impossible("tracked", got="it beside observed = true", expected="one of the two")
        if self.at is not None and not self.tracked:
            raise impossible("at", got="it without tracked = true", expected="the time of the image of tracked pixels")
        if not self.observed and self.pixels is None:
            raise impossible("pixels", got="nothing", expected="[[u, v], ...], or observed = true")
        if self.pixels is not None and not takes_pixels(self.kind, len(self.pixels)):
            raise impossible(
                "pixels", got=f"{len(self.pixels)} of them", expected=f"{pixels_wanted(self.kind)} for {self.kind}"
            )
        elevation = sorted(self.model_fields_set & {"elevation_m", "elevation_std_m"})
        if self.on_top_of is not None and elevation:
            raise impossible(elevation[0], got="it beside on_top_of", expected="one of the two")
        return self


class ConfigTable(Table):
    """A station's whole file; ``camera`` and ``markers`` are validated once it is known whether a file has them."""

    station: StationTable
    camera: dict[str, Any]
    telemetry: TelemetryTable | None = None
    pose: PoseTable | None = None
    images: ImagesTable = ImagesTable()
    observations: ObservationsTable = ObservationsTable()
    limits: LimitsTable = LimitsTable()
    ground: GroundTable | None = None
    zenoh: ZenohTable = ZenohTable()
    record: RecordTable = RecordTable()
    probe: Many[ProbeTable] = ()
    landmark: Many[LandmarkTable] = ()
    markers: dict[str, Any] | None = None
    calibration: LiveTable = LiveTable()
    watch: WatchTable | None = None
    objects: ObjectsTable | None = None
    river: RiverTable | None = None
    topics: TopicsTable = TopicsTable()

    @model_validator(mode="after")
    def _telemetry_or_pose(self) -> Self:
        if (self.telemetry is None) == (self.pose is None):
            got = "neither of them" if self.pose is None else "both of them"
            raise impossible("", got=got, expected="either [telemetry] or [pose]", hint="[pose] is for a fixed camera")
        if self.watch is not None and self.pose is None:
            hint = "a camera that moves has no image to be held against"
            raise impossible("watch", got="it beside [telemetry]", expected="[pose]", hint=hint)
        if self.pose is not None and (tracked := next((each.name for each in self.probe if each.tracked), None)):
            got, hint = f'tracked = true of "{tracked}" beside [pose]', "a fixed camera's pixels stay where they are"
            raise impossible("probe", got=got, expected="[telemetry]", hint=hint)
        for key in ("landmark", "markers"):
            if getattr(self, key) and self.telemetry is None:
                hint = "find a fixed camera's pose with aerodft calibrate"
                raise impossible(key, got="it beside [pose]", expected="[telemetry]", hint=hint)
        return self
