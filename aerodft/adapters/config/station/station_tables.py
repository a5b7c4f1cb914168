"""The tables of a station's configuration file, with their defaults and checks; and its probes and inputs from them."""

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, ClassVar, Final, Self

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.camera import KnownPointTable, PoseTable
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.origin import OriginTable
from aerodft.adapters.config.station.ground import GroundTable
from aerodft.adapters.config.station.live_tables import LiveCalibrationTable, LiveLandmarkTable, StationMarkersTable
from aerodft.adapters.config.station.station_config import (
    Device,
    ImageInput,
    ImageSettings,
    Rate,
    Stills,
    StreamInput,
    VideoFile,
)
from aerodft.adapters.config.tables import NOT_IN_CONFIG_ID, ROWS, UNLESS_ZERO, FromFile, SiAttribute, Table, si_value
from aerodft.adapters.config.telemetry_tables import TelemetryTable
from aerodft.adapters.timestamps import datetime_to_unix_ns, iso_to_unix_ns, parse_offset, unix_ns_to_iso
from aerodft.dft import PROBE_KINDS, at_own_heights, probe_end
from aerodft.errors import ConfigError, Reason, UsageError, counted
from aerodft.model import (
    FIXED_POINTS,
    Camera,
    KnownPoint,
    PixelSource,
    Probe,
    ProbeKind,
    ProjectionModel,
)
from aerodft.service import OBJECTS

Polygon = Annotated[tuple[keys.Pixel, ...], Field(strict=False, min_length=3)]


class CameraMotionTable(Table):
    """Settings of the watch over a fixed camera: the reference, and the rotation that counts as moved."""

    limit_deg: Annotated[float, Field(ge=0.01, le=45)] = 0.2
    every_s: Annotated[float, Field(ge=0, le=3600), NOT_IN_CONFIG_ID] = 1.0
    confirm_looks: Annotated[int, Field(ge=1, le=100)] = 3
    lever_arm_m: keys.NonNegative = 0.2
    ignore: Annotated[keys.Many[Polygon], NOT_IN_CONFIG_ID] = ()
    reference: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None


class ObjectsTable(Table):
    """Settings of detecting and following moving objects; the defaults are those of ``ObjectSettings``."""

    detect: bool = True
    every_s: Annotated[keys.Duration, NOT_IN_CONFIG_ID] = 0.0
    shadows: Annotated[bool, NOT_IN_CONFIG_ID] = True
    min_area_px: Annotated[int, Field(ge=1, le=10_000_000), NOT_IN_CONFIG_ID] = 60
    ignore: Annotated[keys.Many[Polygon], NOT_IN_CONFIG_ID] = ()
    std_px: keys.Positive = 2.0
    speed_mps: keys.Positive = 3.0
    acceleration_mps2: keys.Positive = 0.5
    confirm_looks: Annotated[int, Field(ge=1, le=1000)] = 3
    track_timeout_s: keys.Duration = 5.0
    distances_within_m: keys.NonNegative = 0.0


class HintsTable(Table):
    """Pixels that a person marked as water or land in the first image."""

    water: Annotated[keys.Many[keys.Pixel], SiAttribute("water_px")] = ()
    land: Annotated[keys.Many[keys.Pixel], SiAttribute("land_px")] = ()


class RiverTable(Table):
    """Settings of finding banks for probes of kind ``river``; the defaults are those of ``RiverSettings``."""

    every_s: keys.Duration = 1.0
    spacing_m: keys.Positive = 1.0
    seed: Annotated[keys.Pixel | None, SiAttribute("seed_px")] = None
    hints: HintsTable = HintsTable()
    max_range_m: keys.Positive | None = None


def river_probes(probes: tuple[Probe, ...]) -> tuple[Probe, ...]:
    """The probes whose banks may be looked for."""
    return tuple(each for each in probes if each.kind == ProbeKind.RIVER and each.source is PixelSource.OBSERVED)


_EDGE_PX = -0.5  # pixel (0, 0) is the centre of the top-left pixel


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


def _as_stated(seconds: object) -> object:
    return seconds


Instant = Annotated[int, BeforeValidator(_instant), PlainSerializer(unix_ns_to_iso)]
SecondsOrAuto = Annotated[keys.TimeOffset | None, BeforeValidator(_seconds_or_auto), PlainSerializer(_as_stated)]
Url = Annotated[str, keys.matching(r"[a-z0-9+]+:\S+", 'a URL like "udp://0.0.0.0:5600"')]


class StationTable(Table):
    """Name of the station."""

    name: Annotated[keys.Slug, SiAttribute("station"), NOT_IN_CONFIG_ID]
    origin: OriginTable | None = None
    tick_ms: Annotated[int, Field(ge=1, le=1000)] = 50


_INPUTS: Final[dict[str, tuple[type[ImageInput], str]]] = {
    "video": (VideoFile, "path"),
    "stills": (Stills, "folder"),
    "stream": (StreamInput, "url"),
    "device": (Device, "path"),
    "rate_hz": (Rate, "rate_hz"),
}
"""What the images' five inputs are: the class, and which of its attributes has the key's value."""


class ImagesTable(Table):
    """Source of images; at most one of the five inputs."""

    video: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None
    start: Annotated[Instant | None, SiAttribute("start_ns"), NOT_IN_CONFIG_ID] = None
    stills: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None
    pattern: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None
    utc_offset: Annotated[Annotated[str, AfterValidator(_offset)] | None, NOT_IN_CONFIG_ID] = None
    stream: Annotated[Url | None, NOT_IN_CONFIG_ID] = None
    device: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None
    rate_hz: Annotated[Annotated[float, Field(gt=0, le=1000)] | None, NOT_IN_CONFIG_ID] = None
    time_offset_s: SecondsOrAuto = 0.0
    time_drift: Annotated[float, Field(ge=-0.5, le=0.5), UNLESS_ZERO] = 0.0
    time_reference: Annotated[Instant | None, SiAttribute("time_reference_ns")] = None
    time_std_s: keys.Duration = 0.0

    @model_validator(mode="after")
    def _one_input(self) -> Self:
        inputs = [key for key in _INPUTS if getattr(self, key) is not None]
        if len(inputs) > 1:
            raise impossible(
                inputs[1], got=Reason(f"it stands beside {inputs[0]}"), expected=f"one of {', '.join(_INPUTS)}"
            )
        for key, owner in (("start", "video"), ("pattern", "stills"), ("utc_offset", "stills")):
            if getattr(self, key) is not None and getattr(self, owner) is None:
                raise impossible(key, got=Reason(f"it stands without {owner}"), expected=f"{owner} beside it")
        if self.time_drift and self.time_reference is None:
            expected = "time_reference beside it, the instant of the camera's clock at which time_offset_s holds"
            raise impossible("time_drift", got=Reason("it stands without time_reference"), expected=expected)
        if self.time_offset_s is None and (self.time_drift or self.time_reference is not None):
            raise impossible("time_offset_s", got='"auto" beside a drift', expected="a number, or no drift")
        return self


class ObservationsTable(Table):
    """Source of observed pixels."""

    files: Annotated[keys.Many[keys.Text], NOT_IN_CONFIG_ID] = ()
    topic: Annotated[bool, NOT_IN_CONFIG_ID] = True
    time_offset_s: keys.TimeOffset = 0.0
    match_tolerance_s: keys.Duration = 0.02


class LimitsTable(Table):
    """Limits beyond which nothing is measured."""

    max_range_m: keys.Positive | None = None


class RecordTable(Table):
    """The recorder."""

    folder: Annotated[keys.Text, SiAttribute(into=Path, out=str)] = "recordings"
    image_hz: keys.NonNegative = 1.0
    video: bool = True
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] = 80
    segment_s: Annotated[float, Field(ge=1, le=86_400)] = 900.0
    segment_mb: Annotated[float, Field(ge=1, le=100_000)] = 2000.0


_TOPICS = SiAttribute(into=lambda said: (said,) if isinstance(said, str) else said, out=lambda topics: topics or None)
_ONE_TOPIC = SiAttribute(into=lambda said: (said,) if said else (), out=lambda topics: topics[0] if topics else None)


class TopicsTable(Table):
    """Which topic is what in another tool's recording, where its channels do not tell."""

    mavlink: Annotated[keys.Many[keys.Text] | keys.Text, _TOPICS] = ()
    images: Annotated[keys.Text | None, _ONE_TOPIC] = None
    camera: Annotated[keys.Text | None, _ONE_TOPIC] = None


def _kind(name: str) -> ProbeKind:
    kind = ProbeKind(name)
    if kind not in PROBE_KINDS:
        hint = "what moves is followed with [objects]" if kind == ProbeKind.TRACK else ""
        raise impossible("", got=f'"{kind}"', expected=f"one of {', '.join(PROBE_KINDS)}", hint=hint)
    return kind


class ProbeTable(Table):
    """One thing to measure."""

    INSTEAD_OF: ClassVar = {"on_top_of": ("elevation_m", "elevation_std_m")}

    name: keys.Slug
    kind: Annotated[str, AfterValidator(_kind)]
    pixels: Annotated[keys.Many[keys.End] | None, ROWS] = None
    observed: Annotated[bool, SiAttribute("source", out=lambda source: source is PixelSource.OBSERVED or None)] = False
    tracked: Annotated[bool, SiAttribute("source", out=lambda source: source is PixelSource.TRACKED or None)] = False
    at: Annotated[Instant | None, SiAttribute("at_ns")] = None
    std_px: keys.NonNegative = 1.0
    elevation_m: keys.Elevations = 0.0
    elevation_std_m: keys.ElevationStds = 0.0
    on_top_of: keys.Slug | None = None

    @model_validator(mode="after")
    def _fixed_or_observed(self) -> Self:
        if self.observed and self.pixels is not None:
            raise impossible("pixels", got=Reason("it stands beside observed = true"), expected="one of the two")
        if self.observed and self.tracked:
            raise impossible("tracked", got=Reason("it stands beside observed = true"), expected="one of the two")
        if self.at is not None and not self.tracked:
            raise impossible(
                "at", got=Reason("it stands without tracked = true"), expected="the time of the image of tracked pixels"
            )
        if not self.observed and self.pixels is None:
            raise impossible("pixels", got="nothing", expected="[[u, v], ...], or observed = true")
        kind = PROBE_KINDS[ProbeKind(self.kind)]
        if self.pixels is not None and not kind.takes_pixels(len(self.pixels)):
            expected = f"{kind.pixels_wanted} for {self.kind}"
            raise impossible("pixels", got=counted(len(self.pixels), "pixel"), expected=expected)
        count = self.elevation_count if self.pixels is None else len(self.pixels)
        if any(isinstance(end, str) for end in self.pixels or ()):
            if self.on_top_of is not None:
                expected = "[u, v]: the object has the height"
                raise impossible("pixels", got=Reason("a surveyed point stands beside on_top_of"), expected=expected)
        elif wrong := kind.wrong_elevations(self.elevation_m, self.elevation_std_m, count):
            raise impossible("elevation_m", got=wrong, expected=f"{kind.elevations_wanted(count)} of {self.kind}")
        return self

    @property
    def elevation_count(self) -> int:
        """Number of elevations: of points that are observed, of which nobody knows yet how many there are."""
        stated = (self.elevation_m, self.elevation_std_m)
        return max(len(each) if isinstance(each, tuple) else 1 for each in stated)


class StationCameraTable(FromFile):
    """A station's camera, and how it projects."""

    model: Annotated[ProjectionModel, Field(strict=False)] = ProjectionModel.PINHOLE


_NOT_IN_THE_PAPER = {"ground": "level ground only"} | dict.fromkeys(
    ("landmark", "markers", "camera_motion", "objects", "river"), "no roll"
)
"""Tables that the equations of the paper have no place for, and what they know instead."""


class ConfigTable(Table):
    """A station's whole file."""

    station: StationTable
    camera: StationCameraTable
    telemetry: TelemetryTable | None = None
    pose: Annotated[PoseTable | None, SiAttribute("fixed_pose")] = None
    ground: GroundTable | None = None
    images: ImagesTable = ImagesTable()
    observations: ObservationsTable = ObservationsTable()
    limits: LimitsTable = LimitsTable()
    record: Annotated[RecordTable, NOT_IN_CONFIG_ID] = RecordTable()
    topics: Annotated[TopicsTable, NOT_IN_CONFIG_ID] = TopicsTable()
    probe: Annotated[keys.Many[ProbeTable], SiAttribute("probes")] = ()
    known_point: Annotated[keys.Many[KnownPointTable], NOT_IN_CONFIG_ID] = ()
    landmark: keys.Many[LiveLandmarkTable] = ()
    live_calibration: Annotated[LiveCalibrationTable, SiAttribute("live")] = LiveCalibrationTable()
    markers: StationMarkersTable | None = None
    camera_motion: CameraMotionTable | None = None
    objects: ObjectsTable | None = None
    river: Annotated[RiverTable | None, NOT_IN_CONFIG_ID] = None

    @model_validator(mode="after")
    def _telemetry_or_pose(self) -> Self:
        if (self.telemetry is None) == (self.pose is None):
            got = "neither of them" if self.pose is None else "both of them"
            raise impossible("", got=got, expected="either [telemetry] or [pose]", hint="[pose] is for a fixed camera")
        if self.camera_motion is not None and self.pose is None:
            hint = "a camera that moves has no image to be held against"
            raise impossible("camera_motion", got=Reason("it stands beside [telemetry]"), expected="[pose]", hint=hint)
        if self.pose is not None and (tracked := next((each.name for each in self.probe if each.tracked), None)):
            got, hint = (
                f'tracked = true of "{tracked}" beside [pose]',
                "a fixed camera's pixels stay, or follow its turns with [camera_motion]",
            )
            raise impossible("probe", got=got, expected="[telemetry]", hint=hint)
        for key in ("landmark", "markers"):
            if getattr(self, key) and self.telemetry is None:
                hint = "find a fixed camera's pose with aerodft calibrate"
                raise impossible(key, got=Reason("it stands beside [pose]"), expected="[telemetry]", hint=hint)
        return self

    @model_validator(mode="after")
    def _suits_the_model(self) -> Self:
        stated = (key for key in _NOT_IN_THE_PAPER if getattr(self, key))
        if self.camera.model is ProjectionModel.DFT and (key := next(stated, None)):
            expected = f'"pinhole", or no {"[[landmark]]" if key == "landmark" else f"[{key}]"}'
            hint = f"the equations of the paper know {_NOT_IN_THE_PAPER[key]}"
            raise impossible(key, got=Reason('it stands beside camera.model = "dft"'), expected=expected, hint=hint)
        return self

    @model_validator(mode="after")
    def _suits_the_probes(self) -> Self:
        for name in (each.name for each in self.probe):
            if self.camera_motion is not None and name == FIXED_POINTS:
                expected = "another name: the points that stand still have this one"
                raise impossible("probe.name", got=f'"{name}", beside [camera_motion]', expected=expected)
            if self.objects is not None and (name == OBJECTS or name.startswith("object-")):
                expected = "another name: objects that move have such names"
                raise impossible("probe.name", got=f'"{name}", beside [objects]', expected=expected)
        if self.river is not None and not any(each.kind == ProbeKind.RIVER and each.observed for each in self.probe):
            expected = 'a [[probe]] with kind = "river" and observed = true'
            raise impossible("river", got="no probe that is measured from banks", expected=expected)
        return self


def probes_from(tables: tuple[ProbeTable, ...], camera: Camera, points: Mapping[str, KnownPoint]) -> tuple[Probe, ...]:
    """The configured probes.

    Args:
        tables: Of the probes.
        camera: In whose image fixed pixels must lie.
        points: Surveyed points by name, whose heights count from the measured plane.

    Raises:
        ConfigError: A name twice, a fixed pixel outside the camera's image, an unknown surveyed point, or a probe on
            top of what is no height.
    """
    names = [table.name for table in tables]
    for index, table in enumerate(tables):
        if table.name in names[:index]:
            raise ConfigError(f"probe[{index}].name", got=f'"{table.name}" again', expected="a name of its own")
        if table.on_top_of is not None:
            _check_object(table.on_top_of, tables, f"probe[{index}].on_top_of")
    probes = tuple(_probe(table, points) for table in tables)
    for probe in probes:
        _check_in_image(probe, camera)
    return probes


def _probe(table: ProbeTable, points: Mapping[str, KnownPoint]) -> Probe:
    """A probe of its table, with pixels and heights of the surveyed points that it names."""
    if table.pixels is None:
        return si_value(Probe, table, source=_source(table))
    stated = table.elevation_m, table.elevation_std_m
    try:
        ends = [probe_end(end, points) for end in table.pixels]
        pixels, elevation_m, std_m = at_own_heights(ProbeKind(table.kind), ends, *stated)
    except UsageError as error:
        got, expected = error.got, error.expected
        raise ConfigError(f'probe "{table.name}": {error.what}', got=got, expected=expected) from None
    return si_value(Probe, table, source=_source(table), pixels=pixels, elevation_m=elevation_m, elevation_std_m=std_m)


def _check_in_image(probe: Probe, camera: Camera) -> None:
    right_px, bottom_px = camera.width_px + _EDGE_PX, camera.height_px + _EDGE_PX
    for u, v in probe.pixels:
        if not (_EDGE_PX <= u <= right_px and _EDGE_PX <= v <= bottom_px):
            raise ConfigError(
                f'probe "{probe.name}" lies outside the image',
                got=f"pixel ({u:g}, {v:g})",
                expected=f"within (-0.5, -0.5) to ({right_px:g}, {bottom_px:g}) of {camera.name}",
            )


def _source(table: ProbeTable) -> PixelSource:
    if table.tracked:
        return PixelSource.TRACKED
    return PixelSource.OBSERVED if table.observed else PixelSource.FIXED


def _check_object(name: str, tables: tuple[ProbeTable, ...], key: str) -> None:
    """Refuse to lie on top of anything but an object that stands on the ground, seen in fixed pixels."""
    found = next((table for table in tables if table.name == name), None)
    if found is None:
        got = f'"{name}", which is not there'
    elif found.kind != ProbeKind.HEIGHT:
        got = f'"{name}", which measures a {found.kind}'
    elif found.observed or found.tracked:
        got = f'"{name}", of which the pixels are {_source(found)}'
    elif found.on_top_of is not None:
        got = f'"{name}", which lies on top of "{found.on_top_of}"'
    else:
        return
    expected = "a height on the ground with pixels of its own"
    raise ConfigError(f"{key}: lies on no object", got=got, expected=expected)


def images_from(table: ImagesTable, folder: Path) -> ImageSettings:
    """Image settings of the tables; relative paths start from ``folder``."""
    offset_s = table.time_offset_s
    source: ImageInput | None = None
    key = next((key for key in _INPUTS if getattr(table, key) is not None), None)
    if key is not None:
        kind, attribute = _INPUTS[key]
        stated = getattr(table, key)
        source = si_value(kind, table, **{attribute: folder / stated if key in ("video", "stills") else stated})
    return si_value(ImageSettings, table, source=source, time_offset_s=offset_s or 0.0, is_auto=offset_s is None)


def images_table(settings: ImageSettings, time_std_s: float) -> ImagesTable:
    """The table of where images come from, and of their stamps' std; reading it gives equal settings."""
    stated: dict[str, object] = {"time_offset_s": "auto"} if settings.is_auto else {}
    for key, (kind, attribute) in _INPUTS.items():
        if isinstance(settings.source, kind):
            value = getattr(settings.source, attribute)
            stated[key] = str(value.absolute()) if isinstance(value, Path) else value
    return ImagesTable.from_si(settings, settings.source, time_std_s=time_std_s, **stated)
