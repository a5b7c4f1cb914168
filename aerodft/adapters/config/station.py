"""A station as it is configured: the pipeline's settings, and where its input and output are."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from aerodft.adapters.images.clock import ImageClock
from aerodft.adapters.mavlink.signing_settings import SigningSettings
from aerodft.conventions import SECOND_NS
from aerodft.model.calibration import Calibration
from aerodft.model.marker import MarkerSurvey
from aerodft.model.pose import PoseStd
from aerodft.service.objects import ObjectSettings
from aerodft.service.settings import LiveCalibration, PipelineSettings
from aerodft.service.watching import WatchSettings
from aerodft.vision.river_observer import RiverLook


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """The live MAVLink connection.

    Attributes:
        connection: pymavlink's connection string.
        baud: Baud rate of a serial device.
        signing: How its frames are signed; None where they are not.
    """

    connection: str
    baud: int = 57600
    signing: SigningSettings | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoFile:
    """A video file; ``start_ns`` is the UTC of its first instant, None to take the container's."""

    path: Path
    start_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Stills:
    """A folder of stills; ``pattern`` says how a name tells the time, ``utc_offset`` whose time EXIF means."""

    folder: Path
    pattern: str | None = None
    utc_offset: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """A live stream, by URL."""

    url: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Device:
    """A local capture device, such as ``/dev/video0``."""

    path: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Rate:
    """No images: stamps alone, at a rate."""

    rate_hz: float


ImageInput: TypeAlias = VideoFile | Stills | Stream | Device | Rate


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageSettings:
    """Where images come from.

    Attributes:
        source: None where the configuration names none (the command line may, else stamps at a rate).
        time_offset_s: Added to every stamp of the source.
        time_drift: Added to it for every second since the reference.
        time_reference_ns: An instant by the source's own clock; None without a drift.
        is_auto: Offset and drift are to be found from a video and a log.
    """

    source: ImageInput | None = None
    time_offset_s: float = 0.0
    time_drift: float = 0.0
    time_reference_ns: int | None = None
    is_auto: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservationSettings:
    """Where observed pixels come from, and what is added to their stamps."""

    files: tuple[Path, ...] = ()
    topic: bool = True
    time_offset_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerSettings:
    """Markers that are looked for in the station's images, each a landmark of its live calibration.

    Attributes:
        survey: The markers, in metres east, north and up of the station's origin.
        ignore: Ids that are there too, and that nobody has surveyed.
        every_s: Least time between two images that are looked at; 0 for all of them.
    """

    survey: MarkerSurvey
    ignore: frozenset[int] = frozenset()
    every_s: float = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Watch:
    """A fixed camera that is watched for bumps.

    Attributes:
        settings: What counts as moved.
        reference: The image that its pose is the pose of; None for the first good one.
    """

    settings: WatchSettings
    reference: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ZenohSettings:
    """The bus: loopback only and no multicast, unless somebody writes otherwise."""

    enabled: bool = True
    listen: str = "tcp/127.0.0.1:7447"
    connect: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordSettings:
    """The recorder.

    Attributes:
        folder: Against the current directory.
        image_hz: JPEGs per second that are kept; 0 records no images at all.
        video: Whether the packets of an H.264 stream are kept as they come, in place of JPEGs.
        jpeg_quality: 1 to 100.
        segment_s: A new file begins after this time ...
        segment_mb: ... or at this size.
    """

    folder: Path = Path("recordings")
    image_hz: float = 1.0
    video: bool = True
    jpeg_quality: int = 80
    segment_s: float = 900.0
    segment_mb: float = 2000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """What the topics of another tool's recording are; empty where they tell it themselves.

    Attributes:
        mavlink: Of the telemetry.
        images: Of the images or the video, at most one.
        camera: Of the camera's calibration, at most one.
    """

    mavlink: tuple[str, ...] = ()
    images: tuple[str, ...] = ()
    camera: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class SlopedGround:
    """Ground that is a tilted plane.

    Attributes:
        slope_rad: Against the horizontal.
        uphill_azimuth_rad: Where it rises to, clockwise from north.
        point_rad: WGS84 latitude and longitude of its point at height 0; None for the origin, or what is right below
            a fixed camera.
    """

    slope_rad: float
    uphill_azimuth_rad: float
    point_rad: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TerrainGround:
    """Ground from an elevation model; see ``adapters.terrain.load_elevation``.

    Attributes:
        path: The raster.
        sha256: Of its bytes, in hexadecimal digits: what the numbers depend on, wherever it lies.
        radius_m: How far around the origin it is read.
        cell_m: Distance of the nodes; None for that of its pixels.
        band: Of the heights, from 1.
        fill_msl_m: Height of what has no data; None to leave holes.
        refraction: Refraction coefficient of sight lines.
    """

    path: Path
    sha256: str
    radius_m: float
    cell_m: float | None = None
    band: int = 1
    fill_msl_m: float | None = None
    refraction: float


GroundShape: TypeAlias = SlopedGround | TerrainGround


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationConfig:
    """One station, from one file.

    ``pipeline.fixed_pose``, ``.ground`` and ``.config_id`` follow from the rest: after a ``dataclasses.replace`` that
    touches what numbers depend on, pass the result through :func:`aerodft.adapters.config.resolved.refreshed`.

    Attributes:
        pipeline: What the numbers depend on.
        link: None where the file names no connection.
        images: Image input.
        observations: Observation input.
        zenoh: The bus.
        record: The recorder.
        fixed_pose: What ``pipeline.fixed_pose`` was made of; None where telemetry gives the pose.
        ground: What ``pipeline.ground`` was made of; None for level ground.
        calibration: Biases to correct the telemetry with.
        live: Landmarks that refine them while the station measures, those of markers included; None where there are
            none.
        markers: Markers that are looked for in the images; None where there are none.
        watch: How a fixed camera is watched for bumps; None where it is not.
        objects: How what moves is followed; None where it is not.
        river: How banks are looked for; None where they are not.
        topics: Of other tools' recordings.
    """

    pipeline: PipelineSettings
    link: Link | None = None
    images: ImageSettings = field(default_factory=ImageSettings)
    observations: ObservationSettings = field(default_factory=ObservationSettings)
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    record: RecordSettings = field(default_factory=RecordSettings)
    fixed_pose: FixedPose | None = None
    ground: GroundShape | None = None
    calibration: Calibration | None = None
    live: LiveCalibration | None = None
    markers: MarkerSettings | None = None
    watch: Watch | None = None
    objects: ObjectSettings | None = None
    river: RiverLook | None = None
    topics: Topics = field(default_factory=Topics)

    @property
    def image_offset_s(self) -> float:
        """What is added to the stamps of the image source: as configured, and as the calibration found it."""
        return self.images.time_offset_s + (0.0 if self.calibration is None else self.calibration.time_offset_s)

    @property
    def image_clock(self) -> ImageClock:
        """How stamps of the image source become UTC."""
        return ImageClock(
            offset_ns=round(self.image_offset_s * SECOND_NS),
            drift=self.images.time_drift,
            reference_ns=self.images.time_reference_ns or 0,
        )
