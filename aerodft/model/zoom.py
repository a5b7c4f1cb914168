"""What a vehicle's reports make of the camera that the configuration names."""

from dataclasses import dataclass
from enum import StrEnum


class ZoomSource(StrEnum):
    """The message that a camera's view is known from."""

    CAMERA_SETTINGS = "CAMERA_SETTINGS"
    CAMERA_FOV_STATUS = "CAMERA_FOV_STATUS"
    VIDEO_STREAM_INFORMATION = "VIDEO_STREAM_INFORMATION"


@dataclass(frozen=True, slots=True, kw_only=True)
class Zoom:
    """A camera's focal length at one stamp, against that of its file.

    Attributes:
        magnification: Focal length over that of the file.
        std: Standard deviation of the magnification.
        source: Where it is known from.
    """

    magnification: float
    std: float
    source: ZoomSource
