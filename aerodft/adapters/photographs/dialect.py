"""What a dialect of photographs is, and the pose that it reads out of one."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

from aerodft.adapters.photographs.tags import PhotoTags
from aerodft.geometry import from_yaw_pitch_roll, multiply, yaw_pitch_roll
from aerodft.model import FloatArray, PoseStd

MAX_HEIGHT_M: Final = 20_000.0
"""Above take-off, or above and below sea level: higher than any drone that takes photographs."""

NO_FIX_DEG: Final = 0.01
"""Latitude and longitude both closer to 0 are those of a receiver without a fix: 1.1 km, in the Gulf of Guinea."""

SAME_PLACE_DEG: Final = 0.001
"""Two positions of one photograph that are farther apart contradict each other: 110 m, where makers round to 1 m."""

DOWN_FROM_AHEAD: Final = from_yaw_pitch_roll(0.0, math.radians(-90), 0.0)
"""``body_SO3_gimbal`` of a camera that looks straight down with the image's top ahead: pitch 0 of Pix4D's tags."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserTarget:
    """Point that a laser rangefinder met, at the centre of the image.

    Attributes:
        slant_m: Distance from the camera.
        std_m: Standard deviation of the distance.
        height_home_m: Of the point above take-off; None where the photograph does not say it.
    """

    slant_m: float
    std_m: float
    height_home_m: float | None = None

    def height(self, depression_rad: float, std_rad: float) -> tuple[float, float] | None:
        """Height above the target and its std in m, by the angle of the view below the horizon; None above it."""
        down_m, across_m = self.slant_m * math.sin(depression_rad), self.slant_m * math.cos(depression_rad)
        if down_m <= 0:
            return None
        return down_m, math.hypot(self.std_m * math.sin(depression_rad), across_m * std_rad)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PhotoPose:
    """Where a photograph says that its camera was, and where it looked.

    Attributes:
        dialect: Words for who wrote it.
        wxyz: ``(4,)`` quaternion ``ned_SO3_gimbal`` (front is the optical axis, right, down); None where not said.
        lat_rad: WGS84; None where not said or impossible.
        lon_rad: WGS84; None where not said or impossible.
        height_home_m: Above the take-off point; None where not said or impossible.
        altitude_m: Above ``datum``; None where not said or impossible.
        datum: Of the altitude: ``ellipsoid``, ``msl``, or None where the maker does not say which.
        laser: The rangefinder's target; None without one.
        std: Standard deviations of position, angles and of the height above take-off, each as the dialect knows it.
        std_source: Where these are from, in words.
        remarks: A sentence for each thing that is impossible, or that the photograph does not say.
    """

    dialect: str
    wxyz: FloatArray | None = None
    lat_rad: float | None = None
    lon_rad: float | None = None
    height_home_m: float | None = None
    altitude_m: float | None = None
    datum: str | None = None
    laser: LaserTarget | None = None
    std: PoseStd
    std_source: str
    remarks: tuple[str, ...] = ()

    @property
    def laser_height(self) -> tuple[float, float] | None:
        """Height above the laser's target and its std in m, by the camera's own tilt; None without a target below."""
        if self.laser is None or self.wxyz is None:
            return None
        return self.laser.height(-float(yaw_pitch_roll(self.wxyz)[1]), self.std.tilt_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """How the photographs of a maker say their pose.

    Attributes:
        name: Words for the maker and its tags.
        recognises: Whether a photograph is of this dialect.
        read: Its pose.
    """

    name: str
    recognises: Callable[[PhotoTags], bool]
    read: Callable[[PhotoTags], PhotoPose]


@dataclass(slots=True)
class TagReader:
    """Numbers of a photograph within what they can be; what cannot be is None, and a remark.

    Attributes:
        tags: The photograph's tags.
        remarks: Sentences so far.
    """

    tags: PhotoTags
    remarks: list[str] = field(default_factory=list)

    def number(self, name: str, low: float, high: float) -> float | None:
        """A number of XMP, as a decimal or a fraction; None where it is not stated, or impossible."""
        text = self.tags.xmp.get(name)
        if text is None:
            return None
        value = _decimal(text)
        if not low <= value <= high:
            self.remarks.append(f"{name} is {text[:32]!r}, which cannot be: it is not used")
            return None
        return value

    def angle_rad(self, name: str) -> float | None:
        """An angle of XMP in degrees, between -360 and 360; in rad."""
        degrees = self.number(name, -360.0, 360.0)
        return None if degrees is None else math.radians(degrees)

    def yaw_pitch_roll(self, yaw: str, pitch: str, roll: str) -> FloatArray | None:
        """Quaternion ``(4,)`` of three angles by their names; None where one is missing, which is said.

        A photograph without a roll is of a gimbal that holds it at 0.
        """
        angles = [self.angle_rad(name) for name in (yaw, pitch, roll)]
        if angles[2] is None and roll not in self.tags.xmp:
            angles[2] = 0.0
        given = [angle for angle in angles if angle is not None]
        if len(given) < len(angles):
            return None
        return from_yaw_pitch_roll(*given)

    def place(self, *pairs: tuple[float | None, float | None]) -> tuple[float | None, float | None]:
        """Latitude and longitude in rad from the first pair of degrees that is stated; None where it cannot be."""
        exif = self.tags.exif
        gps = [exif.get("GPSLatitude"), exif.get("GPSLongitude")]
        lat, lon = (value if isinstance(value, float) else None for value in gps)
        if any(_are_far_apart(*pair, lat, lon) for pair in pairs):
            self.remarks.append("the positions of its EXIF and of its XMP data contradict each other: neither is used")
            return None, None
        for lat_deg, lon_deg in (*pairs, (lat, lon)):
            if lat_deg is None or lon_deg is None:
                continue
            if not (abs(lat_deg) <= 90 and abs(lon_deg) <= 180):  # noqa: PLR2004 - degrees
                self.remarks.append(f"the position {lat_deg:g}, {lon_deg:g} cannot be: it is not used")
            elif abs(lat_deg) < NO_FIX_DEG and abs(lon_deg) < NO_FIX_DEG:
                said = f"the position {lat_deg:.3g}, {lon_deg:.3g} is that of a receiver without a fix"
                self.remarks.append(f"{said}: it is not used")
            else:
                return math.radians(lat_deg), math.radians(lon_deg)
        return None, None

    def altitude_m(self, *names: str) -> float | None:
        """The altitude of the first of these names of XMP, else of EXIF."""
        for name in names:
            if name in self.tags.xmp:
                return self.number(name, -MAX_HEIGHT_M, MAX_HEIGHT_M)
        value = self.tags.exif.get("GPSAltitude")
        if not isinstance(value, float):
            return None
        if not abs(value) <= MAX_HEIGHT_M:
            self.remarks.append(f"GPSAltitude is {value:g} m, which cannot be: it is not used")
            return None
        return value

    def say(self, sentence: str) -> None:
        """Add a remark."""
        self.remarks.append(sentence)

    def pose(self, **values: object) -> PhotoPose:
        """A pose with the remarks so far."""
        pose = PhotoPose(**values)  # type: ignore[arg-type]  # as the dialect names them
        return replace(pose, remarks=tuple(dict.fromkeys(self.remarks)))


def pix4d_attitude(reader: TagReader) -> FloatArray | None:
    """``ned_SO3_gimbal`` by ``Camera:Yaw``, ``Pitch``, ``Roll`` as Pix4D defines them: pitch 0 looks straight down.

    The angles turn a body (front, right, down) whose camera looks along its down axis with the image's top ahead.
    Source: Pix4D, "Yaw, Pitch, Roll and Omega, Phi, Kappa angles".
    """
    body = reader.yaw_pitch_roll("Camera:Yaw", "Camera:Pitch", "Camera:Roll")
    return None if body is None else multiply(body, DOWN_FROM_AHEAD)


def stds(
    *, height_m: float, horizontal_m: float, tilt_deg: float, pan_deg: float, roll_deg: float, heading_deg: float
) -> PoseStd:
    """Standard deviations in m and degrees."""
    return PoseStd(
        height_agl_m=height_m,
        horizontal_m=horizontal_m,
        tilt_rad=math.radians(tilt_deg),
        pan_rad=math.radians(pan_deg),
        roll_rad=math.radians(roll_deg),
        heading_rad=math.radians(heading_deg),
    )


def _are_far_apart(
    lat_deg: float | None, lon_deg: float | None, other_lat_deg: float | None, other_lon_deg: float | None
) -> bool:
    """Whether two positions that are both stated differ by more than makers round them."""
    given = [each for each in (lat_deg, lon_deg, other_lat_deg, other_lon_deg) if each is not None]
    if len(given) < 4 or not all(map(math.isfinite, given)):  # noqa: PLR2004 - two positions
        return False
    north, east = given[0] - given[2], math.remainder(given[1] - given[3], 360.0)
    return math.hypot(north, east * math.cos(math.radians(given[0]))) > SAME_PLACE_DEG


def _decimal(text: str) -> float:
    """A number as XMP writes them: decimal, or a fraction; NaN for what is none."""
    above, slash, below = text.strip().partition("/")
    try:
        return float(above) / float(below) if slash else float(above)
    except (ValueError, ZeroDivisionError, OverflowError):
        return math.nan
