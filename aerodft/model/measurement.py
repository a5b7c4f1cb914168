"""One measured thing, complete with everything needed to compute it again."""

from dataclasses import dataclass
from enum import StrEnum

from aerodft.model.pose import PoseSample
from aerodft.model.probe import ProbeKind
from aerodft.model.status import Status

Vector = tuple[float, ...]


class ProjectionModel(StrEnum):
    """Which equations turn a pixel into a ground point."""

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
    """The answer to one probe at one stamp (DESIGN, "on the wire"); unknown fields are None, never absent."""

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
