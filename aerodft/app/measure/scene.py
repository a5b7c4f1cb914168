"""Camera, ground and pose of one image, as users know them: in degrees and metres, or out of a calibration file."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np

from aerodft import model
from aerodft.adapters.config import TILT_RANGE, pitch_hint
from aerodft.adapters.config.camera import CalibrationFile, FixedPose, load_calibration, pose_sample
from aerodft.adapters.config.evidence import load_evidence
from aerodft.conventions import LARGEST
from aerodft.dft import Setup
from aerodft.errors import InputError, UsageError, located
from aerodft.geometry import Ground, Plane, camera_pose
from aerodft.model import (
    Camera,
    FloatArray,
    GeoOrigin,
    GimbalSource,
    HeightSource,
    KnownPoint,
    PoseBatch,
    PoseSample,
    ProjectionModel,
    Status,
)
from aerodft.service import HEIGHT_SOURCES

_LOWEST_M: Final = 1e-3
_STEEPEST_DEG: Final = 80.0


def in_range(name: str, value: float, low: float, high: float, expected: str, hint: str = "") -> float:
    """The value, of a parameter with this name.

    Raises:
        InputError: It is not between ``low`` and ``high``, or no number.
    """
    is_number = isinstance(value, Real)
    if not (is_number and low <= value <= high):
        raise InputError(f"`{name}`", got=f"{value:g}" if is_number else repr(value), expected=expected, hint=hint)
    return value


def refuse_other(name: str, value: object, kinds: type | tuple[type, ...], expected: str) -> None:
    """Refuse what is of no such kind, of a parameter with this name; None passes.

    Raises:
        UsageError: It is.
    """
    if value is not None and not isinstance(value, kinds):
        raise UsageError(f"`{name}`", got=repr(value)[:80], expected=expected)


def projection_model(name: ProjectionModel | str) -> ProjectionModel:
    """The model of this name.

    Raises:
        UsageError: There is none.
    """
    if name not in list(ProjectionModel):
        raise UsageError("`model`", got=repr(name), expected=" or ".join(ProjectionModel))
    return ProjectionModel(name)


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseStd:
    """Standard deviations of a pose, independent of each other; 0 says exact.

    Of what is None, the height is assumed to be known to 1 %, the tilt to 1 deg, pan and roll to 0.3 deg: a gimbal
    whose kind is not known may be off by that. Position and heading are taken as exact. Measurements say so.

    Attributes:
        height_m: Of the height.
        position_m: Of the position, east and north each.
        tilt_deg: Of the rotation about the camera's x axis (to the right).
        pan_deg: Of the rotation about its y axis (down).
        roll_deg: Of the rotation about its z axis (ahead).
        heading_deg: Of the rotation about the vertical.

    Raises:
        InputError: One is below 0.

    Examples:
        >>> PoseStd(height_m=0.1).description(50.0)
        'std stated: height 0.1 m; assumed: tilt 1 deg, pan 0.3 deg, roll 0.3 deg; taken as exact: position, heading'
    """

    height_m: float | None = None
    position_m: float | None = None
    tilt_deg: float | None = None
    pan_deg: float | None = None
    roll_deg: float | None = None
    heading_deg: float | None = None

    def __post_init__(self) -> None:
        for each in fields(self):
            if (value := getattr(self, each.name)) is not None:
                in_range(each.name, value, 0.0, LARGEST, "a standard deviation of at least 0")

    def with_assumed(self, height_m: float) -> "PoseStd":
        """The standard deviations with those that are assumed of a pose at this height."""
        return PoseStd(**{each.name: self._of(each.name, height_m) for each in fields(self)})

    def description(
        self, height_m: float, focal_px: float | None = None, by: Mapping[str, str] = MappingProxyType({})
    ) -> str:
        """Which are stated, assumed and taken as exact at this height, for people; with the focal length's.

        Args:
            height_m: The height.
            focal_px: Standard deviation of the focal length; None to leave it out.
            by: By name of an attribute, who else than the user states it.
        """
        parts: dict[str, list[str]] = {"std stated": [], "assumed": [], "taken as exact": []}
        for each in fields(self):
            (name, unit), value = each.name.split("_"), self._of(each.name, height_m)
            is_stated = getattr(self, each.name) is not None
            part = "std stated" if is_stated else "assumed" if value else "taken as exact"
            if is_stated and each.name in by:
                part = f"std by {by[each.name]}"
            parts.setdefault(part, []).append(f"{name} {value:.3g} {unit}" if is_stated or value else name)
        if focal_px is not None:
            part, name = ("std stated", f"focal {focal_px:.3g} px") if focal_px else ("taken as exact", "focal")
            parts[part].append(name)
        return "; ".join(f"{part}: {', '.join(names)}" for part, names in parts.items() if names)

    def si(self, height_m: float) -> model.PoseStd:
        """All standard deviations at a height, in m and rad."""
        angles = ("tilt", "pan", "roll", "heading")
        return model.PoseStd(
            height_agl_m=self._of("height_m", height_m),
            horizontal_m=self._of("position_m", height_m),
            **{f"{name}_rad": math.radians(self._of(f"{name}_deg", height_m)) for name in angles},
        )

    def _of(self, name: str, height_m: float) -> float:
        stated: float | None = getattr(self, name)
        assumed = {"height_m": 0.01 * height_m, "tilt_deg": 1.0, "pan_deg": 0.3, "roll_deg": 0.3}
        return assumed.get(name, 0.0) if stated is None else stated


_UNSTATED: Final = PoseStd()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPose:
    """Place and attitude of a camera.

    Attributes:
        height_m: Above the ground right below the camera.
        altitude_m: Above mean sea level, instead of the height, where the ground is an ``ElevationModel``.
        tilt_deg: Of the optical axis from straight down: 0 nadir, 90 horizon.
        roll_deg: Positive with the camera's right side down.
        heading_deg: Clockwise from true north.
        lat_deg: WGS84 latitude; None where it is not known, with the longitude.
        lon_deg: WGS84 longitude.
        std: How well all this is known; what it leaves out is assumed, which the measurement's reasons say.
        covariance: ``(6, 6)`` instead of ``std``: position ENU (m), then a small rotation in camera axes (rad).
        std_by: By name of an attribute of ``std``, who states it; what is not named is the user's.
        reasons: What goes into every measurement's reasons.
        height_source: Who says the height.
        attitude_source: Who says the angles.

    Raises:
        InputError: A value is impossible.
        UsageError: Values do not go together.

    Examples:
        >>> CameraPose(height_m=10.48, tilt_deg=67, std=PoseStd(height_m=0.1, tilt_deg=0.2)).heading_deg
        0.0
    """

    height_m: float | None = None
    altitude_m: float | None = None
    tilt_deg: float
    roll_deg: float = 0.0
    heading_deg: float = 0.0
    lat_deg: float | None = None
    lon_deg: float | None = None
    std: PoseStd = _UNSTATED
    std_by: Mapping[str, str] = field(default_factory=dict)
    covariance: FloatArray | None = None
    reasons: tuple[str, ...] = ()
    height_source: HeightSource = HeightSource.MANUAL
    attitude_source: GimbalSource = GimbalSource.MANUAL

    def __post_init__(self) -> None:
        if self.height_m is not None:
            in_range("height_m", self.height_m, _LOWEST_M, 100_000.0, "0.001 to 100000 m above the ground")
        in_range("tilt_deg", self.tilt_deg, 0.0, 180.0, TILT_RANGE, pitch_hint(self.tilt_deg))
        in_range("roll_deg", self.roll_deg, -180.0, 180.0, "-180 to 180 deg")
        in_range("heading_deg", self.heading_deg, -360.0, 360.0, "-360 to 360 deg")
        if self.lat_deg is not None and self.lon_deg is not None:
            in_range("lat_deg", self.lat_deg, -90.0, 90.0, "-90 to 90 deg")
            in_range("lon_deg", self.lon_deg, -180.0, 360.0, "-180 to 360 deg")
        elif self.lat_deg is not None or self.lon_deg is not None:
            raise UsageError("`lat_deg` and `lon_deg` go together")
        refuse_other("std", self.std, PoseStd, "a PoseStd, e.g. PoseStd(height_m=0.1)")

    def __eq__(self, other: object) -> bool:
        """Whether it says the same."""
        if not isinstance(other, CameraPose):
            return NotImplemented
        return all(np.array_equal(getattr(self, each.name), getattr(other, each.name)) for each in fields(self))

    def __hash__(self) -> int:
        """Of place and angles."""
        return hash((self.height_m, self.altitude_m, self.tilt_deg, self.roll_deg, self.heading_deg, self.lat_deg))

    @property
    def origin(self) -> GeoOrigin | None:
        """The place below the camera, where it is known."""
        if self.lat_deg is None or self.lon_deg is None:
            return None
        return GeoOrigin(lat_rad=math.radians(self.lat_deg), lon_rad=math.radians(self.lon_deg))

    def pose(self, origin: GeoOrigin | None = None) -> model.Pose:
        """The pose in ENU of the camera's foot, SI units and radians; ``origin`` says the altitude of the ground."""
        height_m = self._height_m(origin)
        pose = camera_pose(
            height_agl_m=height_m,
            tilt_rad=math.radians(self.tilt_deg),
            roll_rad=math.radians(self.roll_deg),
            heading_rad=math.radians(self.heading_deg),
            std=self._std(height_m),
        )
        return pose if self.covariance is None else replace(pose, cov=self.covariance)

    def sample(self, origin: GeoOrigin | None, camera: Camera) -> PoseSample:
        """The pose as the engine takes it, in ENU of the camera's foot.

        Args:
            origin: The camera's foot; with its altitude, where that is known.
            camera: The camera, of whose focal length the pose's reasons say how well it is known.

        Raises:
            UsageError: There is no height, or there are two.
            InputError: The altitude is below the ground.
        """
        pose, height_m = self.pose(origin), self._height_m(origin)
        focal_px = None if camera.covariance else camera.std.focal_px
        said = (self.std.description(height_m, focal_px, self.std_by),) if self.covariance is None else ()
        ground_msl_m = None if origin is None else origin.alt_msl_m
        return PoseSample(
            stamp_ns=0,
            status=Status.OK,
            reasons=(*said, *self.reasons),
            pose=pose,
            std=self._std(height_m),
            origin=origin,
            lat_rad=None if origin is None else origin.lat_rad,
            lon_rad=None if origin is None else origin.lon_rad,
            alt_msl_m=None if ground_msl_m is None else ground_msl_m + float(pose.position_enu_m[2]),
            height_source=self.height_source,
            height_datum=HEIGHT_SOURCES[self.height_source].datum,
            attitude_source=self.attitude_source,
        )

    def _std(self, height_m: float) -> model.PoseStd:
        """Standard deviations of the pose; nothing beside a covariance."""
        return self.std.si(height_m) if self.covariance is None else model.PoseStd()

    def _height_m(self, origin: GeoOrigin | None) -> float:
        if self.height_m is not None and self.altitude_m is not None:
            raise UsageError("`height_m` beside `altitude_m`", expected="one of them")
        if self.height_m is not None:
            return self.height_m
        if self.altitude_m is None:
            raise UsageError("no `height_m`", expected="0.001 to 100000 m above the ground")
        if origin is None or origin.alt_msl_m is None:
            raise UsageError("`altitude_m` without an elevation model", expected="`height_m`, or the ground's altitude")
        height_m = self.altitude_m - origin.alt_msl_m
        if not height_m >= _LOWEST_M:
            got = f"{self.altitude_m:g} m where the ground is at {origin.alt_msl_m:.2f} m"
            raise InputError("`altitude_m`", got=got, expected="the camera above the ground")
        return height_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Slope:
    """Ground that rises evenly, through the point right below the camera.

    Attributes:
        slope_deg: Against the horizontal, 0 to 80.
        uphill_deg: Where it rises, clockwise from true north.

    Raises:
        InputError: A value is impossible.

    Examples:
        >>> Slope(slope_deg=11.3, uphill_deg=270).slope_deg
        11.3
    """

    slope_deg: float
    uphill_deg: float

    def __post_init__(self) -> None:
        in_range("slope_deg", self.slope_deg, 0.0, _STEEPEST_DEG, f"deg, 0 to {_STEEPEST_DEG:g}")
        in_range("uphill_deg", self.uphill_deg, -360.0, 360.0, "-360 to 360 deg clockwise from north")


@dataclass(frozen=True, slots=True)
class ElevationModel:
    """Ground of an elevation model; the pose then has to say latitude and longitude.

    Attributes:
        path: GeoTIFF.

    Examples:
        >>> ElevationModel("dem.tif").path
        'dem.tif'
    """

    path: str | Path


def with_stds_noted(sample: PoseSample, std_px: float | None, elevation_std_m: float = 0.0) -> PoseSample:
    """A pose whose measurements say the stds of pixels, which are assumed where None, and of the measured surface."""
    said = ["std of pixels assumed: 1 px" if std_px is None else f"std of pixels stated: {std_px:.3g} px"]
    if elevation_std_m:
        said.append(f"std of the elevation stated: {elevation_std_m:.3g} m")
    return replace(sample, reasons=(*sample.reasons, *said))


GroundTerms: TypeAlias = Slope | ElevationModel | Ground | None
"""What the ground is like; None for level ground at the height's datum."""


def _ground(terms: GroundTerms, origin: GeoOrigin | None) -> tuple[Ground | None, GeoOrigin | None]:
    """The ground, None for level ground, and the place below the camera with what is now known of its altitude."""
    if isinstance(terms, Slope):
        return Plane.sloping(np.zeros(3), math.radians(terms.slope_deg), math.radians(terms.uphill_deg)), origin
    if not isinstance(terms, ElevationModel):
        return terms, origin
    from aerodft.adapters.terrain import load_elevation  # slow to load, and an extra
    from aerodft.geometry import Terrain

    if origin is None:
        raise UsageError("an elevation model without `lat_deg` and `lon_deg`", expected="where in it the camera is")
    path = Path(terms.path)
    grid = load_elevation(path, replace(origin, alt_msl_m=0.0))
    foot_m = float(Terrain(grid).height_at(np.zeros(2)))
    if math.isnan(foot_m):
        raise InputError("no height below the camera", where=path, got="nodata", expected="ground at its place")
    return Terrain(replace(grid, heights_m=grid.heights_m - foot_m)), replace(origin, alt_msl_m=foot_m)


@dataclass(frozen=True, slots=True)
class MeasuredSurface:
    """Elevation of the measured surface, and the range to which it is measured.

    Attributes:
        elevation_m: Above the ground.
        elevation_std_m: Its standard deviation.
        max_range_m: Maximum range in metres; None for the setup's own limit.

    Raises:
        InputError: A value is impossible.
    """

    elevation_m: float = 0.0
    elevation_std_m: float = 0.0
    max_range_m: float | None = None

    def __post_init__(self) -> None:
        in_range("elevation_m", self.elevation_m, -LARGEST, LARGEST, "m above the ground, finite")
        if self.max_range_m is not None and not 0 < self.max_range_m <= LARGEST:
            raise InputError("`max_range_m`", got=f"{self.max_range_m:g}", expected="m, above 0")

    def on(self, setup: Setup) -> Setup:
        """A setup that measures there."""
        limit = setup.max_range_m if self.max_range_m is None else self.max_range_m
        return replace(setup, elevation_m=self.elevation_m, elevation_std_m=self.elevation_std_m, max_range_m=limit)


_ON_GROUND: Final = MeasuredSurface()


def image_setup(
    camera: Camera | None,
    pose: CameraPose | PoseSample | None,
    *,
    ground: GroundTerms = None,
    model: ProjectionModel | None = None,
    calibration: str | Path | None = None,
    surface: MeasuredSurface = _ON_GROUND,
) -> tuple[Setup, PoseSample]:
    """Camera, pose and ground for measuring in one image.

    Args:
        camera: The camera; None for that of the calibration.
        pose: The pose; None for that of the calibration.
        ground: What the ground is like; None for level ground.
        model: Projection model; None for the calibration's, else the pinhole.
        calibration: A file with pose and lens, in place of both; or one that says what telemetry is off by, which is
            taken from the pose.
        surface: Where the measured surface is.

    Raises:
        UsageError: There is no camera or no pose, or things do not go together.
        InputError: Something is impossible, or a file cannot be read.
    """
    refuse_other("camera", camera, Camera, "a camera, as `load_camera` reads it from a file")
    refuse_other("pose", pose, (CameraPose, PoseSample), "a CameraPose, e.g. CameraPose(height_m=40, tilt_deg=30)")
    known = None if calibration is None else load_calibration(Path(calibration))
    if known is not None and known.pose is not None:
        if pose is not None:
            raise UsageError("a pose beside a calibration that has one", expected="one of them")
        if model not in (None, known.model):
            raise UsageError(f"{model} beside a calibration", expected=f"{known.model}, which it was made with")
        setup, sample = _calibrated(Path(str(calibration)), known, known.pose, camera, ground)
        return surface.on(setup), sample
    if camera is None or pose is None:
        missing = "camera" if camera is None else "pose"
        raise UsageError(f"no {missing}", expected=f"a {missing}, or a calibration that has one")
    if isinstance(pose, PoseSample):
        terrain, sample = _ground(ground, pose.origin)[0], pose
    else:
        terrain, origin = _ground(ground, pose.origin)
        sample = pose.sample(origin, camera)
    points = {} if known is None or terrain is not None else known.points
    setup = Setup(camera=camera, model=model or ProjectionModel.PINHOLE, ground=terrain, points=points)
    if known is not None:
        setup, sample = _corrected(setup, sample, known)
    return surface.on(setup), sample


def known_points(landmarks: str | Path | None = None, calibration: str | Path | None = None) -> dict[str, KnownPoint]:
    """Surveyed points by name, which bring a probe's ends their pixels and heights.

    Args:
        landmarks: A file as ``calibrate`` takes it. Heights count from the calibration's measured plane; without one
            from the file's own, see ``load_evidence``.
        calibration: A calibration file, which has the landmarks that it was made from; points of both are the file's.

    Returns:
        Points with ``pixel``, ``elevation_m`` and ``elevation_std_m``.

    Raises:
        ConfigError: A file cannot be read.

    Example:
        >>> import aerodft as ad
        >>> points = ad.known_points("configs/calibration/bridge-landmarks.toml")
        >>> name, point = next(iter(points.items()))
        >>> len(point.pixel), point.elevation_std_m >= 0
        (2, True)
    """
    known = None if calibration is None else load_calibration(Path(calibration))
    points = {} if known is None else dict(known.points)
    if landmarks is not None:
        found = load_evidence(Path(landmarks))
        zero_m = float(found.frame.origin[2])
        plane_m = zero_m if known is None or known.plane_elevation_m is None else known.plane_elevation_m
        for name, each in found.points.items():
            points[name] = replace(each, elevation_m=each.elevation_m + zero_m - plane_m)
    return points


def _calibrated(
    path: Path, known: CalibrationFile, pose: FixedPose, camera: Camera | None, ground: GroundTerms
) -> tuple[Setup, PoseSample]:
    """Camera, pose and ground of a calibration that has a pose."""
    lens = known.camera or camera
    if lens is None:
        raise UsageError("a calibration without a lens", where=path, expected="a camera beside it")
    flat = pose_sample(pose, None)
    surface, origin = _ground(ground, flat.origin)
    with located(path):
        sample = flat if surface is None else pose_sample(pose, origin, surface)
    points = known.points if surface is None else {}
    return Setup(camera=lens, model=known.model, ground=surface, points=points), sample


def _corrected(setup: Setup, sample: PoseSample, known: CalibrationFile) -> tuple[Setup, PoseSample]:
    """Camera and pose by telemetry, without what a calibration says that telemetry is off by."""
    if known.camera is not None and setup.model is not known.model:
        raise UsageError(f"{setup.model} beside a calibration", expected=f"{known.model}, which it was made with")
    from calibration.flight import BiasCalibrator  # loads scipy, for biases alone

    corrected = BiasCalibrator(known.biases).refine(PoseBatch.from_samples([sample]))[0]
    return replace(setup, camera=known.camera or setup.camera), corrected
