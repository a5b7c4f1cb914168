"""Where a station's output goes: the bus and the recorder."""

from dataclasses import dataclass
from pathlib import Path


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
