"""Ground that is not level, as it is stated."""

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias


@dataclass(frozen=True, slots=True, kw_only=True)
class SlopedGround:
    """Ground that is a tilted plane.

    Attributes:
        slope_rad: Against the horizontal.
        uphill_azimuth_rad: Where it rises to, clockwise from north.
        point_rad: WGS84 latitude and longitude of its point at height 0; None for the origin, or what is right below
            a fixed camera.
    """

    slope_rad: float
    uphill_azimuth_rad: float
    point_rad: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TerrainGround:
    """Ground from an elevation model; see ``adapters.terrain.load_elevation``.

    Attributes:
        path: The raster.
        sha256: Of its bytes, in hexadecimal digits: what the numbers depend on, wherever it lies.
        radius_m: How far around the origin it is read.
        cell_m: Distance of the nodes; None for that of its pixels.
        band: Of the heights, from 1.
        fill_msl_m: Height of what has no data; None to leave holes.
        refraction: Refraction coefficient of sight lines.
    """

    path: Path
    sha256: str
    radius_m: float
    cell_m: float | None = None
    band: int = 1
    fill_msl_m: float | None = None
    refraction: float


GroundShape: TypeAlias = SlopedGround | TerrainGround
