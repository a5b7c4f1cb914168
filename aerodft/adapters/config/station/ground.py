"""Ground that is not level: from a station's table to what the engine meets rays with, and back."""

import hashlib
import math
import shutil
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, ClassVar, Self, TypeAlias

from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.tables import NOT_IN_CONFIG_ID, SiAttribute, Table, si_value, to_deg
from aerodft.adapters.file_kind import check_is_no_pipe, looks_like
from aerodft.errors import ConfigError, InputError
from aerodft.geometry import Ground, Plane, east_north
from aerodft.model import GeoOrigin

COPY_NAME = "terrain.tif"
"""What an elevation model is called beside a recording's segments."""

MOST_COPIED_BYTES = 64 << 20
"""Larger ones stay where they are."""


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


class PointTable(Table):
    """A point of sloping ground."""

    lat_deg: keys.Latitude
    lon_deg: keys.Longitude


def _point_rad(point: PointTable | None) -> tuple[float, float] | None:
    return None if point is None else (math.radians(point.lat_deg), math.radians(point.lon_deg))


def _point_table(point_rad: tuple[float, float] | None) -> PointTable | None:
    return None if point_rad is None else PointTable(lat_deg=to_deg(point_rad[0]), lon_deg=to_deg(point_rad[1]))


class GroundTable(Table):
    """Ground that is not level: a slope, or an elevation model."""

    INSTEAD_OF: ClassVar = {
        "slope_deg": ("sha256", "radius_m", "cell_m", "band", "fill_msl_m", "refraction"),
        "terrain": ("uphill_azimuth_deg", "point"),
    }

    slope_deg: Annotated[float, Field(ge=0, lt=90)] | None = None
    uphill_azimuth_deg: keys.HeadingDeg | None = None
    point: Annotated[PointTable | None, SiAttribute("point_rad", into=_point_rad, out=_point_table)] = None
    terrain: Annotated[keys.Text | None, SiAttribute("path"), NOT_IN_CONFIG_ID] = None
    sha256: Annotated[str, keys.matching(r"[0-9a-f]{64}", "64 hexadecimal digits")] | None = None
    radius_m: keys.Positive | None = None
    cell_m: keys.Positive | None = None
    band: Annotated[int, Field(ge=1, le=65535)] = 1
    fill_msl_m: keys.Real | None = None
    refraction: Annotated[float, Field(ge=0, lt=1)] | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.slope_deg is None) == (self.terrain is None):
            got = "neither of them" if self.terrain is None else "both of them"
            raise impossible("", got=got, expected="either slope_deg with uphill_azimuth_deg, or terrain")
        if self.terrain is None and self.uphill_azimuth_deg is None:
            raise impossible("uphill_azimuth_deg", got="nothing", expected="where the ground rises to, from north")
        return self


def ground_from(table: GroundTable | None, folder: Path) -> GroundShape | None:
    """What a validated table says; an elevation model's bytes are hashed, its heights are not read yet.

    Args:
        table: The table; None for level ground.
        folder: What relative paths in it start from.

    Raises:
        ConfigError: There is no such elevation model, or it is not the one whose hash the table gives.
    """
    if table is None:
        return None
    if table.terrain is None:
        return si_value(SlopedGround, table)
    return _terrain_from(table, folder / table.terrain)


def _terrain_from(table: GroundTable, path: Path) -> TerrainGround:
    """The defaults are written into it: what is recorded today means the same whatever they are by then."""
    from aerodft.adapters.terrain import RADIUS_M  # noqa: PLC0415 - compiled code, which few stations need
    from aerodft.geometry import STANDARD_REFRACTION  # noqa: PLC0415 - as above

    radius_m = RADIUS_M if table.radius_m is None else table.radius_m
    if table.cell_m is not None and table.cell_m > radius_m:
        expected = f"at most radius_m, {radius_m:g}"
        raise ConfigError("ground.cell_m", got=f"{table.cell_m:g}", expected=expected)
    refraction = STANDARD_REFRACTION if table.refraction is None else table.refraction
    sha256 = _fingerprint(path, table.sha256)
    return si_value(TerrainGround, table, path=path, sha256=sha256, radius_m=radius_m, refraction=refraction)


def _fingerprint(path: Path, expected: str | None) -> str:
    """SHA-256 of a file, which is ``expected`` where something is."""
    wanted = "a GeoTIFF elevation model" if expected is None else f"the elevation model with sha256 {expected}"
    try:
        check_is_no_pipe(path)
        with path.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        got = f"{looks_like(path)} at {path}" if path.exists() else f"nothing at {path}"
        hint = "check the path" if expected is None else "put it there, or say where it is"
        raise ConfigError("ground.terrain", got=got, expected=wanted, hint=hint) from None
    if expected is not None and found != expected:
        got = f"{looks_like(path)} with sha256 {found} at {path}"
        hint = "put the original there, or leave ground.sha256 out to compute with this one"
        raise ConfigError("ground.terrain", got=got, expected=wanted, hint=hint)
    return found


def needs_place(shape: GroundShape | None) -> bool:
    """Whether the ground is laid out on the map, so that it must be known where ENU is."""
    return isinstance(shape, TerrainGround) or (shape is not None and shape.point_rad is not None)


def enu_ground(shape: GroundShape | None, origin: GeoOrigin | None, foot_m: tuple[float, float]) -> Ground | None:
    """The ground in a station's ENU.

    Args:
        shape: What it is like; None for level ground.
        origin: The ENU's origin, which must be known where the shape ``needs_place``.
        foot_m: East and north that a slope passes through at height 0, unless it says another point.

    Raises:
        InputError: The elevation model cannot be used; see ``load_elevation``.
        ValueError: The origin is needed.
    """
    if shape is None:
        return None
    if origin is None and needs_place(shape):
        raise ValueError("got ground on the map and no origin, expected one")
    if isinstance(shape, TerrainGround) and origin is not None:
        return _terrain(shape, origin)
    assert isinstance(shape, SlopedGround)  # noqa: S101 - for the type checker
    east, north = foot_m
    if shape.point_rad is not None and origin is not None:
        east, north = map(float, east_north(origin, *shape.point_rad))
    return Plane.sloping([east, north, 0.0], shape.slope_rad, shape.uphill_azimuth_rad)


@lru_cache(maxsize=2)  # a station is made anew whenever the command line changes something of it
def _terrain(shape: TerrainGround, origin: GeoOrigin) -> Ground:
    from aerodft.adapters.terrain import load_elevation  # noqa: PLC0415 - as in _terrain_from
    from aerodft.geometry import Terrain  # noqa: PLC0415 - as in _terrain_from

    grid = load_elevation(
        shape.path,
        origin,
        radius_m=shape.radius_m,
        cell_m=shape.cell_m,
        band=shape.band,
        fill_msl_m=shape.fill_msl_m,
    )
    return Terrain(grid, shape.refraction)


def ground_table(shape: GroundShape, terrain_file: str | None = None) -> GroundTable:
    """The table of a ground; reading it gives an equal one.

    Args:
        shape: The ground.
        terrain_file: Name of an elevation model's file in the text; None for its absolute path.
    """
    return GroundTable.from_si(shape, **({} if terrain_file is None else {"terrain": terrain_file}))


def travels(shape: TerrainGround) -> bool:
    """Whether an elevation model is copied beside a recording: one TIFF, not too large."""
    return looks_like(shape.path) == "a TIFF image" and shape.path.stat().st_size <= MOST_COPIED_BYTES


def copy_terrain(shape: TerrainGround, folder: Path) -> None:
    """Copy an elevation model, and what GDAL keeps beside it, into a recording's folder.

    Raises:
        InputError: It cannot be read or written.
    """
    path = shape.path
    copies = {path: COPY_NAME, path.with_name(f"{path.name}.aux.xml"): f"{COPY_NAME}.aux.xml"}
    copies |= {path.with_suffix(suffix): f"terrain{suffix}" for suffix in (".tfw", ".wld")}
    try:
        for source, name in copies.items():
            if source == path or source.is_file():
                shutil.copyfile(source, folder / name)
    except OSError as error:
        raise InputError("the elevation model cannot be copied", where=folder, got=error.strerror) from error
