"""DJI's tags (``drone-dji``), and those of others who write them the same way.

Angles are of the gimbal against north and the horizon, Z-Y-X (Mavic 3M image processing guide; a laser rangefinder's
target agrees to 0.2 deg, where the aircraft's own yaw is 20 deg off). A roll of 180 deg is a gimbal that looks past
straight down: the image is upside down, as the composed rotation has it.
"""

import math
from dataclasses import replace
from typing import Final

from aerodft.adapters.photographs.dialect import (
    MAX_HEIGHT_M,
    Dialect,
    LaserTarget,
    PhotoPose,
    TagReader,
    stds,
)
from aerodft.adapters.photographs.tags import PhotoTags
from aerodft.geometry import yaw_pitch_roll
from aerodft.model import FloatArray, PoseStd

_RTK_FIXED: Final = 50
_RTK_FLOAT: Final = range(32, 50)
_STD: Final = stds(
    height_m=1.5,  # a barometer after some minutes of flight; at half a width at 40 m is 2 % too sure
    horizontal_m=3.0,  # a receiver without corrections
    tilt_deg=1.2,  # rms of 0.2, 0.1, 0.9, 1.2 deg (P4 RTK against a reconstruction) and 2.1 deg (a shallow view)
    pan_deg=0.5,
    roll_deg=0.7,
    heading_deg=4.0,  # a compass
)
_RTK_HEADING_RAD: Final = math.radians(2.0)  # rms 1.1 deg of four P4 RTK photographs, the largest 1.8 deg
_RTK_HEIGHT_M: Final = 0.1  # of the take-off point itself, to which heights count
_STD_SOURCE: Final = "DJI photographs against reconstructions and landmarks"
_LASER_STD_M: Final = (0.2, 0.0015)  # and a share of the distance: H20 series, by the maker
_MAX_LASER_M: Final = 3000.0
_LASER_STDS: Final = 4.0  # beyond it target and pose contradict each other


def is_written_so(tags: PhotoTags) -> bool:
    """Whether a photograph has DJI's tags of a pose, whoever made it."""
    return any(f"drone-dji:{name}" in tags.xmp for name in ("GimbalPitchDegree", "RelativeAltitude"))


def read(tags: PhotoTags, name: str = "DJI") -> PhotoPose:
    """The pose by DJI's tags."""
    reader = TagReader(tags)
    lat_rad, lon_rad = _place(reader)
    std, datum, by_rtk = _accuracy(reader)
    altitude_m = reader.altitude_m("drone-dji:AbsoluteAltitude")
    if altitude_m is not None and datum is None:
        reader.say(f"the absolute altitude {altitude_m:g} m has no stated datum: it is not used")
    height_m = reader.number("drone-dji:RelativeAltitude", -MAX_HEIGHT_M, MAX_HEIGHT_M)
    wxyz = _attitude(reader)
    return reader.pose(
        dialect=name + (" with RTK" if by_rtk else ""),
        wxyz=wxyz,
        lat_rad=lat_rad,
        lon_rad=lon_rad,
        height_home_m=height_m,
        altitude_m=altitude_m,
        datum=datum,
        laser=_laser(reader, height_m, wxyz, std),
        std=std,
        std_source=_STD_SOURCE,
    )


def _attitude(reader: TagReader) -> FloatArray | None:
    names = [f"drone-dji:Gimbal{axis}Degree" for axis in ("Yaw", "Pitch", "Roll")]
    wxyz = reader.yaw_pitch_roll(*names)
    if wxyz is not None and not any(reader.angle_rad(name) for name in names):
        reader.say("the gimbal's angles are all exactly 0, which some cameras write instead of them: they are not used")
        return None
    return wxyz


def _place(reader: TagReader) -> tuple[float | None, float | None]:
    lat_deg = lon_deg = None
    for lat, lon in (
        ("GpsLatitude", "GpsLongitude"),
        ("GpsLatitude", "GpsLongtitude"),  # as older firmware spells it
        ("Latitude", "Longitude"),
    ):
        if f"drone-dji:{lat}" in reader.tags.xmp and f"drone-dji:{lon}" in reader.tags.xmp:
            lat_deg = reader.number(f"drone-dji:{lat}", -90.0, 90.0)
            lon_deg = reader.number(f"drone-dji:{lon}", -180.0, 180.0)
            break
    return reader.place((lat_deg, lon_deg))


def _accuracy(reader: TagReader) -> tuple[PoseStd, str | None, bool]:
    """Standard deviations, the altitude's datum, and whether corrections gave the position."""
    flag = reader.number("drone-dji:RtkFlag", 0.0, 255.0)
    if flag is None or flag == 0:
        return _STD, None, False
    found = [reader.number(f"drone-dji:RtkStd{name}", 0.0, 1000.0) for name in ("Lat", "Lon", "Hgt")]
    if flag == _RTK_FIXED:
        lat_m, lon_m, height_m = (0.05 if value is None else max(value, 0.005) for value in found)
    elif flag in _RTK_FLOAT:
        reader.say(f"RtkFlag {flag:.0f} is a floating solution: decimetres at best")
        lat_m, lon_m, height_m = (max(value or 0.0, 0.5) for value in found)
    else:
        reader.say(f"RtkFlag {flag:.0f} is a position without corrections: metres")
        return _STD, "ellipsoid", False
    std = replace(
        _STD,
        horizontal_m=max(lat_m, lon_m),
        height_agl_m=math.hypot(height_m, _RTK_HEIGHT_M),
        heading_rad=_RTK_HEADING_RAD,
    )
    return std, "ellipsoid", True


def _laser(reader: TagReader, height_m: float | None, wxyz: FloatArray | None, std: PoseStd) -> LaserTarget | None:
    """The rangefinder's target; None where it has none, or where it contradicts the pose."""
    slant_m = reader.number("drone-dji:LRFTargetDistance", 0.0, _MAX_LASER_M)
    status = reader.tags.xmp.get("drone-dji:LRFStatus", "Normal")
    if not slant_m:
        return None
    if status.casefold() != "normal":
        reader.say(f"the laser rangefinder says {status[:32]!r}: its target is not used")
        return None
    base_m, share = _LASER_STD_M
    target_m = reader.number("drone-dji:LRFTargetAlt", -MAX_HEIGHT_M, MAX_HEIGHT_M)
    target = LaserTarget(slant_m=slant_m, std_m=math.hypot(base_m, share * slant_m), height_home_m=target_m)
    if wxyz is None or height_m is None or target_m is None:
        return target
    down_m = -slant_m * math.sin(float(yaw_pitch_roll(wxyz)[1]))
    across_m = math.sqrt(max(slant_m**2 - down_m**2, 0.0))
    allowed_m = _LASER_STDS * math.hypot(target.std_m, across_m * std.tilt_rad)
    apart_m = down_m - (height_m - target_m)
    if abs(apart_m) > allowed_m:
        said = f"the laser's target lies {down_m:.1f} m below the camera by its slant range and the gimbal's pitch"
        reader.say(f"{said}, {height_m - target_m:.1f} m by its height above take-off: it is not used")
        return None
    return target


DIALECT: Final = Dialect(name="DJI", recognises=is_written_so, read=read)
