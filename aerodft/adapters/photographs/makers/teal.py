"""Teal's tags (``exif:Camera*`` and ``exif:Platform*``): the camera against the vehicle, the vehicle against NED."""

from typing import Final

from aerodft.adapters.photographs.dialect import Dialect, PhotoPose, TagReader, stds
from aerodft.adapters.photographs.tags import PhotoTags
from aerodft.geometry import multiply
from aerodft.model import FloatArray

_STD: Final = stds(height_m=2.0, horizontal_m=3.0, tilt_deg=2.0, pan_deg=1.5, roll_deg=1.5, heading_deg=5.0)


def read(tags: PhotoTags) -> PhotoPose:
    """The pose by Teal's tags."""
    reader = TagReader(tags)
    lat_rad, lon_rad = reader.place()
    reader.say("Teal states no height above take-off")
    return reader.pose(
        dialect="Teal",
        wxyz=_attitude(reader),
        lat_rad=lat_rad,
        lon_rad=lon_rad,
        altitude_m=reader.altitude_m(),
        std=_STD,
        std_source="assumed of a stabilised gimbal on a vehicle's own attitude",
    )


def _attitude(reader: TagReader) -> FloatArray | None:
    camera, platform = (
        reader.yaw_pitch_roll(*(f"exif:{of}{axis}" for axis in ("Yaw", "Pitch", "Roll")))
        for of in ("Camera", "Platform")
    )
    if camera is None or platform is None:
        return None
    return multiply(platform, camera)


DIALECT: Final = Dialect(
    name="Teal",
    recognises=lambda tags: {"exif:CameraPitch", "exif:PlatformPitch"} <= tags.xmp.keys(),
    read=read,
)
