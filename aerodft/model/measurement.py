"""Probes, what they measure and where their pixels come from; and measurements with their uncertainty."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

from aerodft.model.pose import PoseSample
from aerodft.model.status import Status


class ProbeKind(str):
    """Name of a kind of measurement.

    No enumeration: who adds a kind to ``dft.PROBE_KINDS`` gives it a name there.
    """

    __slots__ = ()
    POSITION: ClassVar["ProbeKind"]
    RANGE: ClassVar["ProbeKind"]
    DISTANCE: ClassVar["ProbeKind"]
    WIDTH: ClassVar["ProbeKind"]
    LENGTH: ClassVar["ProbeKind"]
    AREA: ClassVar["ProbeKind"]
    HEIGHT: ClassVar["ProbeKind"]
    BEARING: ClassVar["ProbeKind"]
    RIVER: ClassVar["ProbeKind"]
    TRACK: ClassVar["ProbeKind"]


ProbeKind.POSITION = ProbeKind("position")
ProbeKind.RANGE = ProbeKind("range")
ProbeKind.DISTANCE = ProbeKind("distance")
ProbeKind.WIDTH = ProbeKind("width")
ProbeKind.LENGTH = ProbeKind("length")
ProbeKind.AREA = ProbeKind("area")
ProbeKind.HEIGHT = ProbeKind("height")  # base, then top
ProbeKind.BEARING = ProbeKind("bearing")  # of a ray, or from the first point to the second
ProbeKind.RIVER = ProbeKind("river")  # the median of its widths: pairs of bank pixels, left then right
ProbeKind.TRACK = ProbeKind("track")  # of what moves: its speed, and where it is; nobody asks for it with pixels


class PixelSource(StrEnum):
    """Origin of a probe's pixels."""

    FIXED = "fixed"
    OBSERVED = "observed"
    TRACKED = "tracked"  # those of one image, found again in the others


@dataclass(frozen=True, slots=True, kw_only=True)
class Probe:
    """A quantity to measure in every image.

    Attributes:
        name: Unique; the last part of its key expression.
        kind: What is measured.
        source: Origin of the pixels.
        pixels: ``((u, v), ...)`` of a fixed probe, or of a tracked one in one image; else empty.
        std_px: Standard deviation of each pixel coordinate, unless the observation has its own.
        elevation_m: Height of the measured surface above the ground; level ground is the height's datum plane. Or a
            height for each point, repeated where there are more points: left bank, right bank.
        elevation_std_m: Its standard deviation, shared by all points of the probe; of several elevations each has an
            error of its own, whose standard deviation is this, or one of several.
        on_top_of: Name of a ``height`` probe in the same image: this probe lies in the level plane through that
            object's top, ``elevation_m`` is 0.
        at_ns: UTC of the image of a tracked probe's pixels; None for the first image.
    """

    name: str
    kind: ProbeKind
    source: PixelSource = PixelSource.FIXED
    pixels: tuple[tuple[float, float], ...] = ()
    std_px: float = 1.0
    elevation_m: float | tuple[float, ...] = 0.0
    elevation_std_m: float | tuple[float, ...] = 0.0
    on_top_of: str | None = None
    at_ns: int | None = None

    @property
    def elevation_count(self) -> int:
        """Number of elevations with errors of their own; 0 for one elevation, whose error all points share."""
        stated = (self.elevation_m, self.elevation_std_m)
        count = max(len(each) if isinstance(each, tuple) else 1 for each in stated)
        return count if count > 1 else 0

    @property
    def mean_elevation_m(self) -> float:
        """The elevation, or the mean of several."""
        return math.fsum(each := self.elevations_m(self.elevation_count or 1)) / len(each)

    def elevations_m(self, count: int) -> tuple[float, ...]:
        """Elevations of ``count`` points."""
        return _repeated(self.elevation_m, count)

    def elevation_stds_m(self, count: int) -> tuple[float, ...]:
        """Standard deviations of the elevations of ``count`` points."""
        return _repeated(self.elevation_std_m, count)


def _repeated(values: float | tuple[float, ...], count: int) -> tuple[float, ...]:
    """A value for each of ``count`` points: the only one, or several in turn."""
    several = values if isinstance(values, tuple) else (values,)
    return tuple(several[index % len(several)] for index in range(count))


Vector = tuple[float, ...]


class ProjectionModel(StrEnum):
    """The equations that turn a pixel into a ground point."""

    PINHOLE = "pinhole"
    DFT = "dft"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ellipse95:
    """95 % confidence ellipse of a horizontal position."""

    semi_major_m: float
    semi_minor_m: float
    azimuth_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GeoPoint:
    """A WGS84 point."""

    lat_rad: float
    lon_rad: float
    alt_msl_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measurement:
    """Measurement of one probe at one stamp; unknown fields are None.

    Attributes:
        name: Of the probe.
        kind: Of the probe.
        status: ``ok``, or why there is no value.
        reasons: Sentences: why there is no value, or what was assumed.
        stamp_ns: UTC.
        pixels: ``(u, v)`` of the probe's points.
        std_px: Of each pixel coordinate.
        camera: Name of the camera.
        model: Projection model.
        pose: Of the camera.
        value: In ``unit``; None for a position.
        std: Standard deviation of ``value``.
        ci95: 95 % interval of ``value``.
        ellipse95: 95 % ellipse of a position.
        ground_m: Ground points ``(x, y, z)``, m: to the right, ahead and up from the point below the camera.
        enu_m: Ground points east, north and up of the station's origin, m.
        cov_enu_m2: Rows of a position's ``(3, 3)`` covariance, m^2.
        geo: Ground points on the map.
        range_m: Slant ranges of the ground points, m.
        unit: Of ``value``.
        image: Running number of the image.
        calibration: Id of the calibration.
        config: Id of the configuration.
    """

    name: str
    kind: ProbeKind
    status: Status
    reasons: tuple[str, ...]
    stamp_ns: int
    pixels: tuple[tuple[float, float], ...]
    std_px: float
    camera: str
    model: ProjectionModel
    pose: PoseSample
    value: float | None = None
    std: float | None = None
    ci95: tuple[float, float] | None = None
    ellipse95: Ellipse95 | None = None
    ground_m: tuple[Vector, ...] | None = None
    enu_m: tuple[Vector, ...] | None = None
    cov_enu_m2: tuple[Vector, ...] | None = None
    geo: tuple[GeoPoint, ...] | None = None
    range_m: tuple[float, ...] | None = None
    unit: str = "m"
    image: int | None = None
    calibration: str | None = None
    config: str | None = None

    def __str__(self) -> str:
        """In one line: the value with its 95 % interval, the place of a position, or why there is none."""
        if self.status is not Status.OK:
            return f"{self.name}: {self.status}: {'; '.join(self.reasons)}"
        if self.value is None or self.ci95 is None:
            places = ", ".join(f"({x:.3f}, {y:.3f}) m" for x, y, _ in self.ground_m or ())
            return f"{self.name}: {places}"
        return f"{self.name}: {self.value:.3f} {self.unit}, 95 % {self.ci95[0]:.3f} to {self.ci95[1]:.3f} {self.unit}"
