"""The pose and the ground as ``aerodft measure`` is told them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from aerodft.adapters.config.covariance import load_covariance
from aerodft.cli.stds import Stds
from aerodft.errors import InputError, UsageError
from aerodft.geometry.ground import Ground, Plane
from aerodft.geometry.poses import camera_pose
from aerodft.model.pose import GeoOrigin, GimbalSource, HeightSource, PoseSample
from aerodft.model.status import Status

_LOWEST_M = 1e-3
_STEEPEST_DEG = 80.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenPose:
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
    altitude_m: float | None
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
class GivenGround:
    """Options that say what the ground is like; None where they were not given.

    Attributes:
        slope_deg: Against the horizontal; the plane passes below the camera at height 0.
        uphill_deg: Where it rises, clockwise from north.
        terrain: An elevation model.
    """

    slope_deg: float | None
    uphill_deg: float | None
    terrain: Path | None

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
    from aerodft.adapters.terrain import load_elevation  # noqa: PLC0415 - an extra, which few measurements need
    from aerodft.geometry.terrain import Terrain  # noqa: PLC0415 - compiled code, which loads slowly

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
