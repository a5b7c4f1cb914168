"""How a recording is made."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from aerodft.adapters.mcap.channels import Channel
from aerodft.model.camera import Camera


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderSettings:
    """How a recording is made.

    Attributes:
        station: Name in topics.
        camera: Recorded as a Foxglove calibration.
        lossless: Wait for the disk instead of shedding; for input that can wait.
        max_image_hz: JPEGs per second that are kept; 0 for no images at all.
        video: Whether packets of a video that is H.264 already are kept in place of JPEGs.
        jpeg_quality: 0 to 100.
        queue_bytes: Data that may wait for the disk before it is shed.
        lossless_queue_bytes: Data that may wait for it before who brings more waits as well.
        queued_images: Images that may wait for the encoder before they are shed.
        segment_bytes: Size beyond which a new segment begins.
        segment_s: Time after which a new segment begins.
    """

    station: str
    camera: Camera
    lossless: bool = False
    max_image_hz: float = 5.0
    video: bool = True
    jpeg_quality: int = 85
    queue_bytes: int = 64 << 20
    lossless_queue_bytes: int = 16 << 20
    queued_images: int = 4
    segment_bytes: int = 2 << 30
    segment_s: float = 900.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesSettings:
    """How a series is written.

    Attributes:
        folder: Where.
        stem: First part of the file names.
        metadata: Keys and values, by name, that every segment carries.
        channels: Known from the start.
        compress: Whether chunks are compressed.
        segment_bytes: Size beyond which a new segment begins.
        segment_s: Length of time, by log times, after which a new segment begins.
        spare_bytes: Room that is allocated ahead.
    """

    folder: Path
    stem: str
    metadata: Mapping[str, dict[str, str]] = field(default_factory=dict)
    channels: tuple[Channel, ...] = ()
    compress: bool
    segment_bytes: int
    segment_s: float
    spare_bytes: int
