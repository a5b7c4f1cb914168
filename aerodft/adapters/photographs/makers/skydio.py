"""Skydio's tags (``drone-skydio``): Euler angles of the camera in NED.

``CameraOrientationQuatNED`` is not read: it is that of other axes, half a turn about the optical axis away.
"""

from typing import Final

from aerodft.adapters.photographs.dialect import Dialect, PhotoPose, TagReader, stds
from aerodft.adapters.photographs.tags import PhotoTags

_STD: Final = stds(height_m=2.0, horizontal_m=3.0, tilt_deg=1.5, pan_deg=1.0, roll_deg=1.0, heading_deg=4.0)
_NED: Final = "drone-skydio:CameraOrientationNED"
_LOCAL_UP: Final = "drone-skydio:CameraPositionFLU/Z"


def read(tags: PhotoTags) -> PhotoPose:
    """The pose by Skydio's tags."""
    reader = TagReader(tags)
    place = reader.number("drone-skydio:Latitude", -90.0, 90.0), reader.number("drone-skydio:Longitude", -180.0, 180.0)
    lat_rad, lon_rad = reader.place(place)
    said = "Skydio states no height above take-off"
    if (local_m := reader.number(_LOCAL_UP, -1e4, 1e4)) is not None:
        said += f" (CameraPositionFLU has Z = {local_m:.2f} m, above what is not documented)"
    reader.say(said)
    return reader.pose(
        dialect="Skydio",
        wxyz=reader.yaw_pitch_roll(f"{_NED}/Yaw", f"{_NED}/Pitch", f"{_NED}/Roll"),
        lat_rad=lat_rad,
        lon_rad=lon_rad,
        altitude_m=reader.altitude_m("drone-skydio:AbsoluteAltitude"),
        std=_STD,
        std_source="assumed of a stabilised gimbal",
    )


DIALECT: Final = Dialect(name="Skydio", recognises=lambda tags: tags.has("drone-skydio"), read=read)
