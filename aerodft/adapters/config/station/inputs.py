"""Where a station's input comes from: telemetry, images, observed pixels, other tools' topics."""

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from aerodft.service import SigningSettings


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


def stated_start_ns(configured: ImageInput | None, video: Path) -> int | None:
    """UTC of a video's first image, where the station's images are that video and it says so."""
    if not isinstance(configured, VideoFile) or configured.path.resolve() != video.resolve():
        return None
    return configured.start_ns
