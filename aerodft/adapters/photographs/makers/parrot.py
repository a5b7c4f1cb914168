"""Parrot's tags: Anafi's own (``drone-parrot``, pitch -90 looks straight down), Disco's and Bebop's of Pix4D."""

from typing import Final

from aerodft.adapters.photographs.dialect import Dialect, PhotoPose, TagReader, pix4d_attitude, stds
from aerodft.adapters.photographs.tags import PhotoTags

_STD: Final = stds(height_m=2.0, horizontal_m=3.0, tilt_deg=1.5, pan_deg=1.0, roll_deg=1.0, heading_deg=5.0)
_FIXED_STD: Final = stds(height_m=2.0, horizontal_m=3.0, tilt_deg=3.0, pan_deg=3.0, roll_deg=3.0, heading_deg=5.0)
_ANGLES: Final = ("CameraYawDegree", "CameraPitchDegree", "CameraRollDegree")


def _recognises(tags: PhotoTags) -> bool:
    return tags.make == "parrot" or tags.has("drone-parrot")


def read(tags: PhotoTags) -> PhotoPose:
    """The pose by Parrot's tags."""
    reader = TagReader(tags)
    lat_rad, lon_rad = reader.place()
    is_gimbal = any(f"drone-parrot:{name}" in tags.xmp for name in _ANGLES)
    own = [f"drone-parrot:{name}" for name in _ANGLES]
    reader.say("Parrot states no height above take-off")
    return reader.pose(
        dialect="Parrot Anafi" if is_gimbal else "Parrot",
        wxyz=reader.yaw_pitch_roll(*own) if is_gimbal else pix4d_attitude(reader),
        lat_rad=lat_rad,
        lon_rad=lon_rad,
        altitude_m=reader.altitude_m(),
        std=_STD if is_gimbal else _FIXED_STD,
        std_source="assumed of a stabilised gimbal" if is_gimbal else "assumed of a camera that is fixed to a wing",
    )


DIALECT: Final = Dialect(name="Parrot", recognises=_recognises, read=read)
