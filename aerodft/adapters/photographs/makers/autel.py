"""Autel's tags: Pix4D's (pitch 0 looks straight down) in older firmware, DJI's in newer.

The EVO Lite 640T (XL715) writes Pix4D's tags with pitches against the horizon: 0 ahead, -90 straight down.
"""

import math
from typing import Final

from aerodft.adapters.photographs.dialect import (
    MAX_HEIGHT_M,
    Dialect,
    PhotoPose,
    TagReader,
    pix4d_attitude,
    stds,
)
from aerodft.adapters.photographs.makers import dji
from aerodft.adapters.photographs.tags import PhotoTags
from aerodft.model import FloatArray

_STD: Final = stds(height_m=2.0, horizontal_m=3.0, tilt_deg=1.5, pan_deg=1.0, roll_deg=1.0, heading_deg=5.0)
_FROM_HORIZON: Final = ("xl715",)
_PAST_NADIR_RAD: Final = math.radians(30)  # no gimbal looks farther behind its own foot


def _recognises(tags: PhotoTags) -> bool:
    return "autel" in tags.make or "autel" in tags.xmp.get("rdf:about", "").casefold() or _is_from_horizon(tags)


def _is_from_horizon(tags: PhotoTags) -> bool:
    return any(model in tags.model.casefold() for model in _FROM_HORIZON)


def read(tags: PhotoTags) -> PhotoPose:
    """The pose by Autel's tags."""
    is_older = "autel" in tags.xmp.get("rdf:about", "").casefold()
    if dji.is_written_so(tags) and not (is_older and "Camera:Pitch" in tags.xmp):
        return dji.read(tags, "Autel (tags as of DJI)")
    reader = TagReader(tags)
    lat_rad, lon_rad = reader.place()
    height_m = None
    if relative := next((name for name in tags.xmp if name.endswith(":RelativeAltitude")), None):
        height_m = reader.number(relative, -MAX_HEIGHT_M, MAX_HEIGHT_M)
    else:
        reader.say("this photograph of an Autel states no height above take-off")
    return reader.pose(
        dialect="Autel",
        wxyz=_attitude(reader),
        lat_rad=lat_rad,
        lon_rad=lon_rad,
        height_home_m=height_m,
        altitude_m=reader.altitude_m(),
        std=_STD,
        std_source="assumed of a stabilised gimbal",
    )


def _attitude(reader: TagReader) -> FloatArray | None:
    pitch_rad = reader.angle_rad("Camera:Pitch")
    if pitch_rad is None:
        return None
    is_from_horizon = _is_from_horizon(reader.tags)
    if pitch_rad < 0 and not is_from_horizon:
        if pitch_rad > -_PAST_NADIR_RAD:
            said = f"Camera:Pitch is {math.degrees(pitch_rad):g} deg, from straight down or from the horizon"
            reader.say(f"{said}: Autel's firmware differs, it is not used")
            return None
        is_from_horizon = True
    if is_from_horizon:
        reader.say("Camera:Pitch counts from the horizon here, against Pix4D's definition")
        return reader.yaw_pitch_roll("Camera:Yaw", "Camera:Pitch", "Camera:Roll")
    return pix4d_attitude(reader)


DIALECT: Final = Dialect(name="Autel", recognises=_recognises, read=read)
