"""A station as it is configured: the pipeline's settings, and where its input and output are."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from aerodft.adapters.config.camera import FixedPose
from aerodft.adapters.config.station.ground import GroundTable
from aerodft.adapters.config.tables import Table
from aerodft.adapters.outputs import default_outputs
from aerodft.conventions import SECOND_NS
from aerodft.model import Calibration, MarkerSurvey
from aerodft.service import (
    CameraMotionSettings,
    LiveCalibration,
    ObjectSettings,
    PipelineSettings,
    RiverSettings,
    SigningSettings,
)
from aerodft.service.clocks import ImageClock


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
    """A video file.

    Attributes:
        path: The file.
        start_ns: UTC of its first instant; None to take the container's.
        later: Files that go on after it, each with the UTC of its first instant: drones cut a video at 4 GB.
    """

    path: Path
    start_ns: int | None = None
    later: tuple[tuple[Path, int], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Stills:
    """A folder of stills; ``pattern`` says how a name tells the time, ``utc_offset`` whose time EXIF means."""

    folder: Path
    pattern: str | None = None
    utc_offset: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamInput:
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


ImageInput: TypeAlias = VideoFile | Stills | StreamInput | Device | Rate


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageSettings:
    """Source of images.

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
    """Source of observed pixels, and the offset of their stamps."""

    files: tuple[Path, ...] = ()
    topic: bool = True
    time_offset_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """Roles of the topics in another tool's recording; empty where the topics themselves tell.

    Attributes:
        mavlink: Of the telemetry.
        images: Of the images or the video, at most one.
        camera: Of the camera's calibration, at most one.
    """

    mavlink: tuple[str, ...] = ()
    images: tuple[str, ...] = ()
    camera: tuple[str, ...] = ()


def stated_start_ns(configured: ImageInput | None, video: Path) -> int | None:
    """UTC of a video's first image, where the station's images are that video and it says so."""
    if not isinstance(configured, VideoFile) or configured.path.resolve() != video.resolve():
        return None
    return configured.start_ns


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationConfig:
    """One station, from one file.

    ``pipeline.fixed_pose``, ``.ground`` and ``.config_id`` follow from the rest: after a ``dataclasses.replace`` that
    touches what numbers depend on, pass the result through :func:`with_derived_settings`.

    Attributes:
        pipeline: What the numbers depend on.
        link: None where the file names no connection.
        images: Image input.
        observations: Observation input.
        outputs: The settings of outputs beside the recording, by their tables.
        record: The recorder.
        fixed_pose: What ``pipeline.fixed_pose`` was made of; None where telemetry gives the pose.
        ground: What ``pipeline.ground`` was made of; None for level ground.
        calibration: Biases to correct the telemetry with.
        live: Landmarks that refine them while the station measures, those of markers included; None where there are
            none.
        markers: Markers that are looked for in the images; None where there are none.
        camera_motion: How a fixed camera is watched for bumps; None where it is not.
        objects: How what moves is followed; None where it is not.
        river: How banks are looked for; None where they are not.
        topics: Of other tools' recordings.
    """

    pipeline: PipelineSettings
    link: Link | None = None
    images: ImageSettings = field(default_factory=ImageSettings)
    observations: ObservationSettings = field(default_factory=ObservationSettings)
    outputs: Mapping[str, Table] = field(default_factory=default_outputs)
    record: RecordSettings = field(default_factory=RecordSettings)
    fixed_pose: FixedPose | None = None
    ground: GroundTable | None = None
    calibration: Calibration | None = None
    live: LiveCalibration | None = None
    markers: MarkerSettings | None = None
    camera_motion: CameraMotionSettings | None = None
    objects: ObjectSettings | None = None
    river: RiverSettings | None = None
    topics: Topics = field(default_factory=Topics)

    @property
    def image_offset_s(self) -> float:
        """Offset of the image source's stamps: the configured one and that of the calibration."""
        return self.images.time_offset_s + (0.0 if self.calibration is None else self.calibration.bias.time_s)

    @property
    def image_clock(self) -> ImageClock:
        """Clock that maps stamps of the image source to UTC."""
        return ImageClock(
            offset_ns=round(self.image_offset_s * SECOND_NS),
            drift=self.images.time_drift,
            reference_ns=self.images.time_reference_ns or 0,
        )
