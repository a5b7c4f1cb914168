"""SIYI's photographs: EXIF alone; unless the autopilot feeds the camera its position is near 0, 0, its date 1970."""

from typing import Final

from aerodft.adapters.photographs.dialect import Dialect, PhotoPose, TagReader, stds
from aerodft.adapters.photographs.tags import PhotoTags

_STD: Final = stds(height_m=2.0, horizontal_m=5.0, tilt_deg=2.0, pan_deg=2.0, roll_deg=2.0, heading_deg=10.0)


def read(tags: PhotoTags) -> PhotoPose:
    """The position of a SIYI photograph; it says no angle and no height."""
    reader = TagReader(tags)
    lat_rad, lon_rad = reader.place()
    reader.say("SIYI states no angle of the gimbal and no height above take-off: take both from the autopilot's log")
    return reader.pose(dialect="SIYI", lat_rad=lat_rad, lon_rad=lon_rad, std=_STD, std_source="assumed")


DIALECT: Final = Dialect(name="SIYI", recognises=lambda tags: tags.make.startswith("siyi"), read=read)
