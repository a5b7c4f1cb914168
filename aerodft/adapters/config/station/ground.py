"""Ground that is not level: from a station's table to what the engine meets rays with, and back."""

import hashlib
import math
import shutil
from functools import lru_cache
from pathlib import Path
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.tables import NOT_IN_CONFIG_ID, Table
from aerodft.adapters.files import check_is_no_pipe, looks_like
from aerodft.errors import ConfigError, os_errors_as
from aerodft.geometry import STANDARD_REFRACTION, Ground, Plane, Terrain, east_north
from aerodft.model import GeoOrigin

COPY_NAME = "terrain.tif"
"""What an elevation model is called beside a recording's segments."""

MOST_COPIED_BYTES = 64 << 20
"""Larger ones stay where they are."""


class PointTable(Table):
    """A point of sloping ground."""

    lat_deg: keys.Latitude
    lon_deg: keys.Longitude


class GroundTable(Table):
    """Ground that is not level: a slope, or an elevation model.

    Attributes:
        slope_deg: Of a tilted plane, against the horizontal.
        uphill_azimuth_deg: Where it rises to, clockwise from north.
        point: Its point at height 0; None for the origin, or what is right below a fixed camera.
        terrain: The raster of an elevation model; see ``adapters.terrain.load_elevation``.
        sha256: Of its bytes, in hexadecimal digits: what the numbers depend on, wherever it lies.
        radius_m: How far around the origin it is read.
        cell_m: Distance of the nodes; None for that of its pixels.
        band: Of the heights, from 1.
        fill_msl_m: Height of what has no data; None to leave holes.
        refraction: Refraction coefficient of sight lines.
    """

    INSTEAD_OF: ClassVar = {
        "slope_deg": ("sha256", "radius_m", "cell_m", "band", "fill_msl_m", "refraction"),
        "terrain": ("uphill_azimuth_deg", "point"),
    }

    slope_deg: Annotated[float, Field(ge=0, lt=90)] | None = None
    uphill_azimuth_deg: keys.HeadingDeg | None = None
    point: PointTable | None = None
    terrain: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None
    sha256: Annotated[str, keys.matching(r"[0-9a-f]{64}", "64 hexadecimal digits")] | None = None
    radius_m: keys.Positive | None = None
    cell_m: keys.Positive | None = None
    band: Annotated[int, Field(ge=1, le=65535)] = 1
    fill_msl_m: keys.Real | None = None
    refraction: Annotated[float, Field(ge=0, lt=1)] | None = None

    @property
    def path(self) -> Path | None:
        """The elevation model's file; None for a slope."""
        return None if self.terrain is None else Path(self.terrain)

    @property
    def needs_place(self) -> bool:
        """Whether the ground is laid out on the map, so that it must be known where ENU is."""
        return self.terrain is not None or self.point is not None

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.slope_deg is None) == (self.terrain is None):
            got = "neither of them" if self.terrain is None else "both of them"
            raise impossible("", got=got, expected="either slope_deg with uphill_azimuth_deg, or terrain")
        if self.terrain is None and self.uphill_azimuth_deg is None:
            raise impossible("uphill_azimuth_deg", got="nothing", expected="where the ground rises to, from north")
        return self


def resolved_ground(table: GroundTable | None, folder: Path) -> GroundTable | None:
    """The ground with an elevation model's path, hash and defaults; its heights are not read yet.

    The defaults are written into it: what is recorded today means the same whatever they are by then.

    Args:
        table: The table; None for level ground.
        folder: What relative paths in it start from.

    Raises:
        ConfigError: There is no such elevation model, or it is not the one whose hash the table gives.
    """
    if table is None or table.path is None:
        return table
    from aerodft.adapters.terrain import RADIUS_M  # noqa: PLC0415 - compiled code, which few stations need

    path, radius_m = (folder / table.path).absolute(), RADIUS_M if table.radius_m is None else table.radius_m
    if table.cell_m is not None and table.cell_m > radius_m:
        raise ConfigError("ground.cell_m", got=f"{table.cell_m:g}", expected=f"at most radius_m, {radius_m:g}")
    stated = {
        "terrain": str(path),
        "sha256": _fingerprint(path, table.sha256),
        "radius_m": radius_m,
        "band": table.band,
        "refraction": STANDARD_REFRACTION if table.refraction is None else table.refraction,
    }
    return table.model_copy(update=stated)


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


def enu_ground(table: GroundTable | None, origin: GeoOrigin | None, foot_m: tuple[float, float]) -> Ground | None:
    """The ground in a station's ENU.

    Args:
        table: What it is like, resolved; None for level ground.
        origin: The ENU's origin, which must be known where the ground ``needs_place``.
        foot_m: East and north that a slope passes through at height 0, unless it says another point.

    Raises:
        InputError: The elevation model cannot be used; see ``load_elevation``.
        ValueError: The origin is needed.
    """
    if table is None:
        return None
    if origin is None and table.needs_place:
        raise ValueError("got ground on the map and no origin, expected one")
    if table.path is not None and origin is not None:
        return _terrain(table, table.path, origin)
    east, north = foot_m
    if table.point is not None and origin is not None:
        lat_rad, lon_rad = math.radians(table.point.lat_deg), math.radians(table.point.lon_deg)
        east, north = map(float, east_north(origin, lat_rad, lon_rad))
    slope_rad, azimuth_rad = math.radians(table.slope_deg or 0.0), math.radians(table.uphill_azimuth_deg or 0.0)
    return Plane.sloping([east, north, 0.0], slope_rad, azimuth_rad)


@lru_cache(maxsize=2)  # a station is made anew whenever the command line changes something of it
def _terrain(table: GroundTable, path: Path, origin: GeoOrigin) -> Ground:
    from aerodft.adapters.terrain import RADIUS_M, load_elevation  # noqa: PLC0415 - as in resolved_ground

    radius_m = RADIUS_M if table.radius_m is None else table.radius_m
    grid = load_elevation(
        path, origin, radius_m=radius_m, cell_m=table.cell_m, band=table.band, fill_msl_m=table.fill_msl_m
    )
    return Terrain(grid, STANDARD_REFRACTION if table.refraction is None else table.refraction)


def travels(path: Path) -> bool:
    """Whether an elevation model is copied beside a recording: one TIFF, not too large."""
    return looks_like(path) == "a TIFF image" and path.stat().st_size <= MOST_COPIED_BYTES


def copy_terrain(path: Path, folder: Path) -> None:
    """Copy an elevation model, and what GDAL keeps beside it, into a recording's folder.

    Raises:
        InputError: It cannot be read or written.
    """
    copies = {path: COPY_NAME, path.with_name(f"{path.name}.aux.xml"): f"{COPY_NAME}.aux.xml"}
    copies |= {path.with_suffix(suffix): f"terrain{suffix}" for suffix in (".tfw", ".wld")}
    with os_errors_as("the elevation model cannot be copied", where=folder):
        for source, name in copies.items():
            if source == path or source.is_file():
                shutil.copyfile(source, folder / name)
