"""Pix4D's tags (``Camera:Yaw``, ``Pitch``, ``Roll``), as senseFly and other mapping drones write them."""

from dataclasses import replace
from typing import Final

from aerodft.adapters.photographs.dialect import Dialect, PhotoPose, TagReader, pix4d_attitude, stds
from aerodft.adapters.photographs.tags import PhotoTags

_STD: Final = stds(height_m=2.0, horizontal_m=3.0, tilt_deg=3.0, pan_deg=3.0, roll_deg=3.0, heading_deg=5.0)


def _read_as(tags: PhotoTags, name: str) -> PhotoPose:
    reader = TagReader(tags)
    lat_rad, lon_rad = reader.place()
    stated_m = reader.number("Camera:GPSXYAccuracy", 0.0, 1000.0)
    reader.say(f"{name} states no height above take-off")
    return reader.pose(
        dialect=name,
        wxyz=pix4d_attitude(reader),
        lat_rad=lat_rad,
        lon_rad=lon_rad,
        altitude_m=reader.altitude_m(),
        std=replace(_STD, horizontal_m=stated_m) if stated_m else _STD,
        std_source="assumed of a camera that is fixed to a wing",
    )


def is_written_so(tags: PhotoTags) -> bool:
    """Whether a photograph has an attitude in Pix4D's tags, whoever made it."""
    return tags.xmp.keys() >= {"Camera:Yaw", "Camera:Pitch"}


SENSEFLY: Final = Dialect(
    name="senseFly",
    recognises=lambda tags: "sensefly" in tags.make and is_written_so(tags),
    read=lambda tags: _read_as(tags, "senseFly"),
)
DIALECT: Final = Dialect(
    name="Pix4D's tags",
    recognises=is_written_so,
    read=lambda tags: _read_as(tags, "a drone with Pix4D's tags"),
)
