"""Camera, pose, ground and their stds, as the commands about one image are told them."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from aerodft.adapters.config import load_covariance
from aerodft.adapters.config.camera import CalibrationFile, FixedPose, load_calibration, load_camera, pose_sample
from aerodft.conventions import LARGEST
from aerodft.dft import Setup
from aerodft.errors import InputError, UsageError
from aerodft.geometry import Ground, Plane, camera_pose
from aerodft.model import (
    Camera,
    GeoOrigin,
    GimbalSource,
    HeightSource,
    PoseBatch,
    PoseSample,
    PoseStd,
    ProjectionModel,
    Status,
)
from calibration.flight import BiasCalibrator

CameraOption = Annotated[Path | None, typer.Option(help="Camera file (TOML).")]
HeightOption = Annotated[float | None, typer.Option(help="Camera height above the ground right below it, m.")]
TiltOption = Annotated[float | None, typer.Option(help="Angle of the optical axis from straight down, deg.")]
RollOption = Annotated[float, typer.Option(help="Positive with the camera's right side down, deg.")]
HeadingOption = Annotated[float, typer.Option(help="Clockwise from true north, deg.")]
LatOption = Annotated[float | None, typer.Option(help="Camera latitude, WGS84, deg.")]
LonOption = Annotated[float | None, typer.Option(help="Camera longitude, WGS84, deg.")]
StdOption = Annotated[
    str | None,
    typer.Option(help="Standard deviations: height,position,elevation,focal(px),px; tilt,pan,roll,heading,attitude."),
]
CovarianceOption = Annotated[
    Path | None, typer.Option(help="6 x 6 covariance: position ENU (m), rotation in camera axes (rad); JSON rows.")
]

_LOWEST_M = 1e-3
_STEEPEST_DEG = 80.0

_KEYS = {
    "height": ("height_agl_m",),
    "position": ("horizontal_m",),
    "tilt": ("tilt_rad",),
    "pan": ("pan_rad",),
    "roll": ("roll_rad",),
    "heading": ("heading_rad",),
    "attitude": ("tilt_rad", "pan_rad", "roll_rad"),
}
_OTHERS = ("focal", "elevation", "px")  # of the camera, the plane, and the pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class Stds:
    """What ``--std`` says; what it does not name is taken as exact.

    Attributes:
        pose: Height, position and angles.
        focal_px: Of the focal length.
        elevation_m: Of the measured plane.
        px: Of each pixel coordinate.
        assumptions: What was assumed because nothing was said; goes into every measurement's reasons.
    """

    pose: PoseStd = field(default_factory=PoseStd)
    focal_px: float = 0.0
    elevation_m: float = 0.0
    px: float = 1.0
    assumptions: tuple[str, ...] = ()

    def with_other(self, name: str, value: float) -> "Stds":
        """Set ``focal`` (px), ``elevation`` (m) or ``px``."""
        if name == "focal":
            return replace(self, focal_px=value)
        return replace(self, elevation_m=value) if name == "elevation" else replace(self, px=value)

    def on_camera(self, camera: Camera) -> Camera:
        """The camera, with the focal length's std where one was given.

        Raises:
            UsageError: The camera has a whole covariance.
        """
        if self.focal_px and camera.covariance:
            raise UsageError("--std focal beside a camera file with a covariance", expected="one of the two")
        return replace(camera, std=replace(camera.std, focal_px=self.focal_px)) if self.focal_px else camera


def assumed_stds(height_m: float) -> Stds:
    """What is assumed where ``--std`` is not given: exactness would be a lie."""
    angle = math.radians(0.3)
    pose = PoseStd(height_agl_m=0.01 * height_m, tilt_rad=angle, pan_rad=angle, roll_rad=angle)
    return Stds(pose=pose, assumptions=("no --std: assumed height 1 %, attitude 0.3 deg, px 1",))


def parse_stds(text: str) -> Stds:
    """Read ``name=value`` pairs: m for lengths, degrees for angles, px for pixels.

    Raises:
        UsageError: An unknown name, or a value that is no number of at least 0 (or absurdly large).
    """
    stds, names = Stds(), set[str]()
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        name, _, number = part.partition("=")
        value = _number(part, number)
        if name in names:
            raise UsageError(f"--std {part}", got=f"{name} again", expected="each once")
        names.add(name)
        if name in _KEYS:
            scaled = {key: math.radians(value) if key.endswith("_rad") else value for key in _KEYS[name]}
            stds = replace(stds, pose=replace(stds.pose, **scaled))
        elif name in _OTHERS:
            stds = stds.with_other(name, value)
        else:
            raise UsageError(f"--std {part}", got=f"name {name!r}", expected=f"one of {', '.join([*_KEYS, *_OTHERS])}")
    return stds


def _number(part: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value <= LARGEST:
        raise UsageError(f"--std {part}", got=repr(text), expected="a number of at least 0, e.g. height=0.1")
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseOptions:
    """Options that say where the camera is and where it looks; None where they were not given.

    Attributes:
        height_m: Above the ground right below the camera.
        altitude_m: Above mean sea level, instead of a height.
        tilt_deg: From straight down.
        roll_deg: Right side down.
        heading_deg: Clockwise from true north.
        lat_deg: WGS84.
        lon_deg: WGS84.
        covariance: File of the 6 x 6 covariance, instead of stds.
    """

    height_m: float | None
    altitude_m: float | None = None
    tilt_deg: float | None
    roll_deg: float
    heading_deg: float
    lat_deg: float | None
    lon_deg: float | None
    covariance: Path | None

    @property
    def origin(self) -> GeoOrigin | None:
        """The place below the camera, where it was given."""
        if (self.lat_deg is None) != (self.lon_deg is None):
            raise UsageError("--lat and --lon go together")
        if self.lat_deg is None or self.lon_deg is None:
            return None
        _in_range("--lat", self.lat_deg, -90.0, 90.0, "-90 to 90 deg")
        _in_range("--lon", self.lon_deg, -180.0, 360.0, "-180 to 360 deg")
        return GeoOrigin(lat_rad=math.radians(self.lat_deg), lon_rad=math.radians(self.lon_deg))

    def refuse_all(self, beside: str) -> None:
        """Refuse what ``beside``, an option as typed or an argument in words, says itself.

        Raises:
            UsageError: Any of it was given.
        """
        given = {
            "height": self.height_m,
            "altitude": self.altitude_m,
            "tilt": self.tilt_deg,
            "roll": self.roll_deg or None,
            "heading": self.heading_deg or None,
            "lat": self.lat_deg,
            "lon": self.lon_deg,
            "covariance": self.covariance,
        }
        refuse_beside(given, beside)

    def stds(self, text: str | None) -> Stds:
        """What ``--std`` says; what is assumed where neither that nor a covariance was given.

        Raises:
            UsageError: Both say how well the pose is known.
        """
        stds = parse_stds(text) if text else None
        if self.covariance is None:
            return stds or assumed_stds(self.height_m or self.altitude_m or 0.0)
        if stds is not None and stds.pose != PoseStd():
            expected = "px, focal, elevation: the rest is there"
            raise UsageError("--std of the pose beside --covariance", expected=expected)
        return stds or Stds()

    def sample(self, stds: Stds, origin: GeoOrigin | None) -> PoseSample:
        """The pose as the engine takes it, in ENU of the camera's foot.

        Args:
            stds: How well it is known.
            origin: The camera's foot; with its altitude, where that is known.

        Raises:
            UsageError: Something is missing.
            InputError: Something is impossible.
        """
        height_m = _in_range(
            "--height", self._height(origin), _LOWEST_M, 100_000.0, "0.001 to 100000 m above the ground"
        )
        tilt_deg = _in_range(
            "--tilt", self.tilt_deg, 0.0, 180.0, "0 to 180 deg from straight down: 0 nadir, 90 horizon"
        )
        _in_range("--roll", self.roll_deg, -180.0, 180.0, "-180 to 180 deg")
        _in_range("--heading", self.heading_deg, -360.0, 360.0, "-360 to 360 deg")
        pose = camera_pose(
            height_agl_m=height_m,
            tilt_rad=math.radians(tilt_deg),
            roll_rad=math.radians(self.roll_deg),
            heading_rad=math.radians(self.heading_deg),
            std=stds.pose,
        )
        if self.covariance is not None:
            pose = replace(pose, cov=load_covariance(self.covariance))
        alt_msl_m = None if origin is None or origin.alt_msl_m is None else origin.alt_msl_m + height_m
        return PoseSample(
            stamp_ns=0,
            status=Status.OK,
            reasons=stds.assumptions,
            pose=pose,
            std=stds.pose,
            origin=origin,
            lat_rad=None if origin is None else origin.lat_rad,
            lon_rad=None if origin is None else origin.lon_rad,
            alt_msl_m=alt_msl_m,
            height_source=HeightSource.MANUAL,
            height_datum="manual",
            attitude_source=GimbalSource.MANUAL,
        )

    def _height(self, origin: GeoOrigin | None) -> float | None:
        if self.altitude_m is None:
            return self.height_m
        if self.height_m is not None:
            raise UsageError("--altitude beside --height", expected="one of them")
        if origin is None or origin.alt_msl_m is None:
            raise UsageError(
                "--altitude without --terrain", expected="--height, or both: the ground's altitude is read"
            )
        height_m = self.altitude_m - origin.alt_msl_m
        if not height_m >= _LOWEST_M:
            got = f"{self.altitude_m:g} m, the ground there is at {origin.alt_msl_m:.2f} m"
            raise InputError("--altitude", got=got, expected="the camera above the ground")
        return height_m


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundOptions:
    """Options that say what the ground is like; None where they were not given.

    Attributes:
        slope_deg: Against the horizontal; the plane passes below the camera at height 0.
        uphill_deg: Where it rises, clockwise from north.
        terrain: An elevation model.
    """

    slope_deg: float | None = None
    uphill_deg: float | None = None
    terrain: Path | None = None

    def refuse_all(self, beside: str) -> None:
        """Refuse what the option ``beside`` says itself.

        Raises:
            UsageError: Any of it was given.
        """
        refuse_beside({"slope": self.slope_deg, "uphill": self.uphill_deg, "terrain": self.terrain}, beside)

    def ground(self, origin: GeoOrigin | None) -> tuple[Ground | None, GeoOrigin | None]:
        """The ground, None for level ground, and the place below the camera with what is now known of its altitude.

        Raises:
            UsageError: Options that do not go together.
            InputError: Something is impossible, or the elevation model cannot be read.
        """
        if self.terrain is not None:
            if self.slope_deg is not None or self.uphill_deg is not None:
                raise UsageError("--slope beside --terrain", expected="one of them")
            return _terrain(self.terrain, origin)
        if (self.slope_deg is None) != (self.uphill_deg is None):
            raise UsageError("--slope and --uphill go together", expected="e.g. --slope 11.3 --uphill 270")
        if self.slope_deg is None or self.uphill_deg is None:
            return None, origin
        slope_deg = _in_range("--slope", self.slope_deg, 0.0, _STEEPEST_DEG, f"deg, 0 to {_STEEPEST_DEG:g}")
        uphill_deg = _in_range("--uphill", self.uphill_deg, -360.0, 360.0, "-360 to 360 deg clockwise from north")
        return Plane.sloping(np.zeros(3), math.radians(slope_deg), math.radians(uphill_deg)), origin


def _terrain(path: Path, origin: GeoOrigin | None) -> tuple[Ground, GeoOrigin]:
    from aerodft.adapters.terrain import load_elevation
    from aerodft.geometry import Terrain

    if origin is None:
        raise UsageError("--terrain without --lat and --lon", expected="all three: where in the model the camera is")
    grid = load_elevation(path, replace(origin, alt_msl_m=0.0))
    foot_m = float(Terrain(grid).height_at(np.zeros(2)))
    if math.isnan(foot_m):
        raise InputError("no height below the camera", where=path, got="nodata", expected="ground at --lat, --lon")
    return Terrain(replace(grid, heights_m=grid.heights_m - foot_m)), replace(origin, alt_msl_m=foot_m)


def refuse_beside(options: Mapping[str, object], beside: str) -> None:
    """Refuse options beside what says the same: an option as typed, or an argument in words.

    Raises:
        UsageError: One of them was given.
    """
    for name, value in options.items():
        if value is not None:
            raise UsageError(f"--{name} beside {beside}", expected=f"one of them: {beside} has it")


def _in_range(option: str, value: float | None, low: float, high: float, expected: str) -> float:
    if value is None:
        raise UsageError(f"no {option}", expected=expected)
    if not low <= value <= high:
        raise InputError(option, got=f"{value:g}", expected=expected)
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredLevel:
    """Where the measured plane is, and how far it is looked at.

    Attributes:
        elevation_m: Above the plane that heights are of.
        elevation_std_m: Its standard deviation.
        max_range_m: None for the setup's own limit.
    """

    elevation_m: float
    elevation_std_m: float
    max_range_m: float | None

    @classmethod
    def of(cls, elevation_m: float, max_range_m: float | None, stds: Stds) -> "MeasuredLevel":
        """What ``--elevation`` and ``--max-range`` say.

        Raises:
            InputError: One of them is impossible.
        """
        if not abs(elevation_m) <= LARGEST:
            raise InputError("--elevation", got=f"{elevation_m:g}", expected="m above the ground, finite")
        if max_range_m is not None and not 0 < max_range_m <= LARGEST:
            raise InputError("--max-range", got=f"{max_range_m:g}", expected="m, above 0")
        return cls(elevation_m=elevation_m, elevation_std_m=stds.elevation_m, max_range_m=max_range_m)

    def on(self, setup: Setup) -> Setup:
        """A setup that measures at this level."""
        limit = setup.max_range_m if self.max_range_m is None else self.max_range_m
        return replace(setup, elevation_m=self.elevation_m, elevation_std_m=self.elevation_std_m, max_range_m=limit)


def given_scene(
    pose: PoseOptions,
    ground: GroundOptions,
    camera: Path | None,
    calibration: Path | None,
    model: ProjectionModel | None,
    std: str | None,
    *,
    says_exact: bool = False,
) -> tuple[Setup, PoseSample, Stds]:
    """Camera, ground and pose out of options, and how well they are known.

    Args:
        pose: The pose.
        ground: The ground.
        camera: The camera's file.
        calibration: Pose and lens, in place of the camera and the pose; or what telemetry is off by.
        model: Projection model; None for the calibration's, else the pinhole.
        std: As ``--std`` was given.
        says_exact: Say which part of the pose ``std`` leaves out and thereby takes as exact.

    Raises:
        UsageError: There is no camera, or options do not go together.
        InputError: Something is impossible.
    """
    known = None if calibration is None else load_calibration(calibration)
    if calibration is not None and known is not None and known.pose is not None:
        pose.refuse_all("--calibration")
        return _calibrated(calibration, known, known.pose, camera, model, std, ground)
    stds = pose.stds(std)
    if says_exact and std is not None and pose.covariance is None:
        stds = replace(stds, assumptions=tuple(_taken_as_exact(stds.pose)))
    surface, origin = ground.ground(pose.origin)
    if camera is None:
        raise UsageError("no --camera", expected="a camera file, e.g. configs/cameras/canon-1000d.toml")
    lens = stds.on_camera(load_camera(camera))
    setup = Setup(camera=lens, model=model or ProjectionModel.PINHOLE, ground=surface)
    sample = pose.sample(stds, origin)
    return (*((setup, sample) if known is None else _corrected(setup, sample, known)), stds)


def _taken_as_exact(std: PoseStd) -> Iterator[str]:
    """What ``--std`` leaves out, though widths depend on it."""
    attitude = (std.tilt_rad, std.pan_rad, std.roll_rad)
    left_out = [name for name, known in (("height", std.height_agl_m), ("attitude", any(attitude))) if not known]
    if left_out:
        yield f"--std leaves out {' and '.join(left_out)}: taken as exact"


def _calibrated(
    path: Path,
    known: CalibrationFile,
    fixed: FixedPose,
    camera: Path | None,
    model: ProjectionModel | None,
    std: str | None,
    ground: GroundOptions,
) -> tuple[Setup, PoseSample, Stds]:
    """What a calibration that has a pose says, with the stds that it does not know: of pixels and of the elevation."""
    stds = parse_stds(std) if std else Stds()
    if stds.pose != PoseStd():
        raise UsageError("--std of the pose beside --calibration", expected="px, elevation: the pose's are in the file")
    lens = known.camera
    if model not in (None, known.model):
        raise UsageError(f"--model {model} beside --calibration", expected=f"{known.model}, which it was made with")
    if lens is None and camera is None:
        raise UsageError("--calibration without --camera", expected="both: the calibration took the lens as it was")
    lens = stds.on_camera(load_camera(camera)) if lens is None and camera is not None else lens
    flat = pose_sample(fixed, None)
    surface, origin = ground.ground(flat.origin)
    sample = flat if surface is None else pose_sample(fixed, origin, surface, str(path))
    assert lens is not None  # noqa: S101 - one of the two was there, for the type checker
    return Setup(camera=lens, model=known.model, ground=surface), sample, stds


def _corrected(setup: Setup, sample: PoseSample, known: CalibrationFile) -> tuple[Setup, PoseSample]:
    """Camera and pose by telemetry, without what a calibration says that telemetry is off by."""
    if known.camera is not None and setup.model is not known.model:
        expected = f"{known.model}, which it was made with"
        raise UsageError(f"--model {setup.model} beside --calibration", expected=expected)
    corrected = BiasCalibrator(known.biases).refine(PoseBatch.of([sample]))[0]
    return replace(setup, camera=known.camera or setup.camera), corrected
