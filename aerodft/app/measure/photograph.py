"""A photograph that carries its pose: its camera, and the pose with what is stated by hand in place of its own."""

import math
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Final

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.images import camera_of_still, facts_of_still
from aerodft.adapters.photographs import (
    LaserTarget,
    PhotoPose,
    PhotoTags,
    StatedLens,
    lens_of_tags,
    photo_tags,
    pose_of_tags,
)
from aerodft.app.measure.scene import CameraPose, PoseStd
from aerodft.errors import InputError, UsageError
from aerodft.geometry import camera_angles, camera_from_gimbal
from aerodft.model import Camera, FloatArray, GimbalSource, HeightSource

UNSTATED_HOME_STD_M: Final = 5.0
"""Std of the take-off point's height above the water where nobody states it: banks that people start from lie 0 to 10 m
above it. Half of it is too sure on a dam or a bridge; twice of it says little of a river at 40 m."""

_STDS: Final = 3.0  # beyond it two focal lengths contradict each other
_MIN_FOCAL_35MM_MM: Final = 12.0  # what is wider is a fisheye, which no focal length describes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StatedPose:
    """Values that somebody states by hand, in place of a photograph's own; None for its own.

    Attributes:
        height_m: Above the ground or water right below the camera.
        altitude_m: Above the datum of an elevation model, instead of the height.
        home_above_plane_m: Of the take-off point above the ground or water; None where nobody knows it.
        tilt_deg: Of the optical axis from straight down.
        roll_deg: Positive with the camera's right side down.
        heading_deg: Clockwise from true north.
        lat_deg: WGS84 latitude, with the longitude.
        lon_deg: WGS84 longitude.
        std: Standard deviations.
        covariance: ``(6, 6)`` in place of all standard deviations.

    Example:
        >>> StatedPose(tilt_deg=31.5).tilt_deg
        31.5
    """

    height_m: float | None = None
    altitude_m: float | None = None
    home_above_plane_m: float | None = None
    tilt_deg: float | None = None
    roll_deg: float | None = None
    heading_deg: float | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    std: PoseStd = field(default_factory=PoseStd)
    covariance: FloatArray | None = None


_NOTHING_STATED: Final = StatedPose()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Photograph:
    """A photograph, with the camera and the pose that it says it was taken with.

    Attributes:
        path: The file.
        dialect: Who wrote its pose; None for a photograph without one.
        camera: The camera.
        pose: The pose; its reasons say what was read, what was not, and what was stated by hand.
    """

    path: Path
    dialect: str | None
    camera: Camera
    pose: CameraPose

    @property
    def summary(self) -> str:
        """Sentence on who wrote the pose, and on the pose that is measured with."""
        pose = replace(self.pose, roll_deg=round(self.pose.roll_deg, 1) + 0.0)  # no -0.0
        height = "" if pose.height_m is None else f"height {pose.height_m:.2f} m ({pose.height_source}), "
        angles = f"tilt {pose.tilt_deg:.1f} deg, roll {pose.roll_deg:.1f} deg, heading {pose.heading_deg:.1f} deg"
        return f"{self.dialect or 'no pose of its own'}: {height}{angles}"


def carries_pose(path: Path) -> bool:
    """Whether a photograph says where its camera was or where it looked; False for what is no image."""
    try:
        return pose_of_tags(photo_tags(path)) is not None
    except InputError:
        return False


def read_photograph(
    path: str | Path,
    *,
    camera: Camera | None = None,
    stated: StatedPose = _NOTHING_STATED,
    home_above_plane_m: float | None = None,
    is_over_terrain: bool = False,
) -> Photograph:
    """Read the camera and the pose that a photograph says it was taken with.

    Args:
        path: A photograph of a drone, as its camera stored it.
        camera: The camera; None for the one that the photograph tells of.
        stated: Values in place of the photograph's own.
        home_above_plane_m: Height of the take-off point above the measured water or ground, as in ``stated``.
        is_over_terrain: Whether the ground is an elevation model, over which only an altitude says the height.

    Raises:
        InputError: It is no image, or tells of no camera.
        UsageError: It says no height or no tilt, and neither is stated.

    Example:
        >>> import aerodft as ad
        >>> photo = ad.read_photograph("samples/DJI_0001.JPG", home_above_plane_m=1.5)
        >>> photo.summary
        'DJI: height 41.50 m (home), tilt 30.0 deg, roll 0.0 deg, heading 40.0 deg'
    """
    path = Path(path)
    tags = photo_tags(path)
    pose = pose_of_tags(tags)
    if home_above_plane_m is not None:
        stated = replace(stated, home_above_plane_m=home_above_plane_m)
    lens, lens_reason = (camera, "") if camera is not None else camera_of_photograph(path, tags)
    reasons = [lens_reason] if lens_reason else []
    return Photograph(
        path=path,
        dialect=None if pose is None else pose.dialect,
        camera=lens,
        pose=_camera_pose(path, pose, stated, reasons, is_over_terrain=is_over_terrain),
    )


def lens_in_photograph(path: Path, tags: PhotoTags | None = None) -> StatedLens | None:
    """The camera that a photograph's XMP describes; None where it describes none.

    Raises:
        InputError: It is no image.
    """
    return lens_of_tags(photo_tags(path) if tags is None else tags, facts_of_still(path).mode)


def camera_of_photograph(path: Path, tags: PhotoTags | None = None) -> tuple[Camera, str]:
    """The camera that a photograph tells of, and a sentence on where from.

    The factory's calibration in it counts before a nominal focal length in it, before the library's camera of that
    name, before EXIF's focal length.

    Raises:
        InputError: It tells of none.
    """
    mode = facts_of_still(path).mode
    stated = lens_in_photograph(path, tags)
    if stated is not None:
        return _checked_lens(path, stated)
    if mode.focal_35mm_mm is not None and mode.focal_35mm_mm < _MIN_FOCAL_35MM_MM:
        got = f"{mode.focal_35mm_mm:g} mm for 35 mm film: a fisheye, whose lens EXIF does not describe"
        raise InputError("no camera can be told from it", where=path, got=got, expected="a calibrated `camera`")
    camera = load_camera(path)
    share = 100 * camera.std.focal_px / camera.fx_px
    return camera, f"camera by the photograph's EXIF data ({camera.name}), to {share:.1f} %"


def _checked_lens(path: Path, stated: StatedLens) -> tuple[Camera, str]:
    """A camera by XMP, and a sentence on it; its std covers EXIF's focal length where the two contradict each other."""
    camera = stated.camera
    try:
        other = camera_of_still(path)
    except InputError:  # EXIF says no focal length
        other = camera
    apart_px = abs(other.fx_px - camera.fx_px)
    if apart_px > _STDS * math.hypot(camera.std.focal_px, other.std.focal_px):
        camera = replace(camera, std=replace(camera.std, focal_px=apart_px))
        said = f"camera by {stated.source}, {camera.fx_px:.0f} px, where EXIF says {other.fx_px:.0f} px"
        return camera, f"{said}: they contradict each other, the std covers both"
    share = 100 * camera.std.focal_px / camera.fx_px
    return camera, f"camera by {stated.source}, to {share:.1f} %"


def _camera_pose(
    path: Path, pose: PhotoPose | None, stated: StatedPose, reasons: list[str], *, is_over_terrain: bool
) -> CameraPose:
    """The pose of a photograph, with what is stated in place of its own values."""
    if pose is not None:
        reasons += [f"pose by the photograph's own data ({pose.dialect})", *pose.remarks]
    attitude = _Attitude.of(path, pose, stated, reasons)
    height = _Height.of(path, pose, stated, attitude, reasons, is_over_terrain=is_over_terrain)
    std = _std(pose, stated, attitude, height)
    lat_deg, lon_deg = stated.lat_deg, stated.lon_deg
    if lat_deg is None and lon_deg is None and pose is not None and pose.lat_rad is not None:
        lat_deg, lon_deg = math.degrees(pose.lat_rad), math.degrees(pose.lon_rad or 0.0)
    is_own = attitude.is_own or height.source is not HeightSource.MANUAL
    by = pose.std_source if pose is not None and is_own else ""
    return CameraPose(
        height_m=height.height_m,
        altitude_m=stated.altitude_m,
        tilt_deg=attitude.tilt_deg,
        roll_deg=attitude.roll_deg,
        heading_deg=attitude.heading_deg,
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        std=std,
        std_by=_std_by(stated, by),
        covariance=stated.covariance,
        reasons=tuple(dict.fromkeys(reasons)),
        height_source=height.source,
        attitude_source=GimbalSource.PHOTOGRAPH if attitude.is_own else GimbalSource.MANUAL,
    )


@dataclass(frozen=True, slots=True)
class _Attitude:
    """Angles in degrees; ``is_own`` where the photograph says the tilt."""

    tilt_deg: float
    roll_deg: float
    heading_deg: float
    is_own: bool

    @classmethod
    def of(cls, path: Path, pose: PhotoPose | None, stated: StatedPose, reasons: list[str]) -> "_Attitude":
        named = {"tilt": stated.tilt_deg, "roll": stated.roll_deg, "heading": stated.heading_deg}
        if pose is None or pose.wxyz is None:
            if stated.tilt_deg is None:
                raise UsageError(
                    "no `tilt_deg`", where=path, got=_lacks(pose), expected="0 to 180 deg from straight down: 0 nadir"
                )
            return cls(stated.tilt_deg, stated.roll_deg or 0.0, stated.heading_deg or 0.0, is_own=False)
        own = dict(
            zip(named, (math.degrees(float(a)) for a in camera_angles(camera_from_gimbal(pose.wxyz))), strict=True)
        )
        for name, value in named.items():
            if value is not None:
                reasons.append(f"{name} {value:g} deg as stated, in place of the photograph's {own[name]:.2f} deg")
        used = [own[name] if value is None else value for name, value in named.items()]
        return cls(used[0], used[1], used[2], is_own=stated.tilt_deg is None)


@dataclass(frozen=True, slots=True)
class _Height:
    """Height above the measured plane with its std in m; None for both where an altitude is stated instead."""

    height_m: float | None
    std_m: float | None
    source: HeightSource

    @classmethod
    def of(
        cls,
        path: Path,
        pose: PhotoPose | None,
        stated: StatedPose,
        attitude: _Attitude,
        reasons: list[str],
        *,
        is_over_terrain: bool,
    ) -> "_Height":
        if stated.height_m is not None or stated.altitude_m is not None:
            if pose is not None and pose.height_home_m is not None and stated.height_m is not None:
                said = f"height {stated.height_m:g} m as stated, in place of {pose.height_home_m:.2f} m above take-off"
                reasons.append(said)
            return cls(stated.height_m, None, HeightSource.MANUAL)
        if is_over_terrain:
            got = "a height above take-off" if pose is None or pose.altitude_m is None else _altitude(pose)
            raise UsageError("no `altitude_m`", where=path, got=got, expected="it in the elevation model's datum")
        if pose is not None and pose.laser is not None and stated.home_above_plane_m is None:
            return _laser_height(pose, pose.laser, attitude, reasons)
        if pose is None or pose.height_home_m is None:
            raise UsageError(
                "no `height_m`", where=path, got=_lacks(pose), expected="m above the water or ground below the camera"
            )
        above_m, std_m = stated.home_above_plane_m, pose.std.height_agl_m
        if above_m is None:
            std_m = math.hypot(std_m, UNSTATED_HOME_STD_M)
            reasons.append(
                f"height {pose.height_home_m:.2f} m is above the take-off point: the water may lie"
                f" {UNSTATED_HOME_STD_M:g} m (1 std) lower or higher, `home_above_plane_m` states it"
            )
        height_m = pose.height_home_m + (above_m or 0.0)
        if height_m <= 0:
            got = f"{pose.height_home_m:.2f} m above take-off"
            raise InputError("the camera is not above the water", where=path, got=got, expected="`height_m`")
        return cls(height_m, std_m, HeightSource.HOME)


def _laser_height(pose: PhotoPose, laser: LaserTarget, attitude: _Attitude, reasons: list[str]) -> _Height:
    """Height above the rangefinder's target."""
    found = laser.height(math.radians(90 - attitude.tilt_deg), pose.std.tilt_rad)
    if found is None:
        return _Height(None, None, HeightSource.RANGEFINDER)
    height_m, std_m = found
    reasons.append(
        f"height {height_m:.2f} m is above the target of the laser rangefinder in the image's centre,"
        f" {laser.slant_m:.2f} m away: `home_above_plane_m` or `height_m` where the water is lower or higher"
    )
    return _Height(height_m, std_m, HeightSource.RANGEFINDER)


def _std(pose: PhotoPose | None, stated: StatedPose, attitude: _Attitude, height: _Height) -> PoseStd:
    """Stated standard deviations, else those of the values that the photograph says."""
    if pose is None or stated.covariance is not None:
        return stated.std
    own = PoseStd(height_m=height.std_m)
    if stated.lat_deg is None and pose.lat_rad is not None:
        own = replace(own, position_m=pose.std.horizontal_m)
    if attitude.is_own:
        tilt_deg, pan_deg = math.degrees(pose.std.tilt_rad), math.degrees(pose.std.pan_rad)
        own = replace(own, tilt_deg=tilt_deg, pan_deg=pan_deg)
    if pose.wxyz is not None and stated.roll_deg is None:
        own = replace(own, roll_deg=math.degrees(pose.std.roll_rad))
    if pose.wxyz is not None and stated.heading_deg is None:
        own = replace(own, heading_deg=math.degrees(pose.std.heading_rad))
    by_hand = {each.name: getattr(stated.std, each.name) for each in fields(PoseStd)}
    return replace(own, **{name: value for name, value in by_hand.items() if value is not None})


def _std_by(stated: StatedPose, source: str) -> dict[str, str]:
    """Where the std of each value is from, unless it is stated by hand."""
    return {each.name: source for each in fields(PoseStd) if source and getattr(stated.std, each.name) is None}


def _lacks(pose: PhotoPose | None) -> str:
    if pose is None:
        return "a photograph without a pose: its data were stripped, or no drone took it"
    return "; ".join(pose.remarks) or f"none in the photograph ({pose.dialect})"


def _altitude(pose: PhotoPose) -> str:
    datum = {"ellipsoid": "above the WGS84 ellipsoid", "msl": "above mean sea level"}.get(pose.datum or "")
    return f"{pose.altitude_m:.2f} m {datum or 'above a datum that is not stated'} in the photograph"
