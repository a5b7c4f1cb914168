"""Ground that is not level: from a station's table to what the engine meets rays with, and back."""

import hashlib
import math
import shutil
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.station.level_file import READING_STD_M, LevelTerms, read_levels
from aerodft.adapters.config.tables import NOT_IN_CONFIG_ID, Table
from aerodft.adapters.files import check_is_no_pipe, looks_like
from aerodft.adapters.vertical_datums import UNKNOWN_SEA_LEVEL, Altitude
from aerodft.conventions import LARGEST, SECOND_NS
from aerodft.errors import ConfigError, counted, os_errors_as
from aerodft.geometry import STANDARD_REFRACTION, Ground, Plane, Terrain, east_north
from aerodft.model import MIN_READINGS, GeoOrigin, LevelSeries

STATION_DATUM: Final = "station"
"""Datum of levels that count from the station's elevation 0, or from ``level_zero_m`` above a zero without a name."""

COPY_NAME = "terrain.tif"
"""What an elevation model is called beside a recording's segments."""

MOST_COPIED_BYTES = 64 << 20
"""Larger ones stay where they are."""


MAX_GAP_S: Final = 3 * 3600.0
"""Longest gap between readings by default: a quarter of the semidiurnal tide's period of 12.4 h. Chosen; at half of it
agencies' hourly readings still do, at twice it a tide may turn unseen between two readings."""

_OFFSET: Final = keys.matching(r"Z|[+-]\d{2}:?\d{2}", 'an offset from UTC like "+01:00"')
_OF_LEVEL: Final = (
    "level_std_m",
    "level_unit",
    "level_columns",
    "level_utc_offset",
    "level_max_gap_s",
    "level_datum",
    "level_zero_m",
    "altitude_datum",
)
_OF_SHAPE: Final = ("uphill_azimuth_deg", "point", "sha256", "radius_m", "cell_m", "fill_msl_m", "refraction")


class PointTable(Table):
    """A point of sloping ground."""

    lat_deg: keys.Latitude
    lon_deg: keys.Longitude


Row = Annotated[tuple[int, float, float], Field(strict=False)]


class LevelTable(Table):
    """Readings of a gauge: the file, or in its place what it held.

    Attributes:
        file: The table of readings; its name alone once these are here.
        readings: UTC (ns), level in its datum and std (m) of each.
    """

    file: Annotated[keys.Text, NOT_IN_CONFIG_ID]
    readings: keys.Many[Row] = ()

    @model_validator(mode="before")
    @classmethod
    def _lift(cls, value: object) -> object:
        return {"file": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        stamps_ns = [each[0] for each in self.readings]
        if "readings" in self.model_fields_set and (
            len(stamps_ns) < MIN_READINGS or any(b <= a for a, b in pairwise(stamps_ns))
        ):
            expected = f"{MIN_READINGS} or more, each later than the one before"
            raise impossible("readings", got=counted(len(stamps_ns), "reading"), expected=expected)
        if any(not (abs(level) <= LARGEST and 0 <= std <= LARGEST) for _, level, std in self.readings):
            raise impossible("readings", got="a number that is none", expected="levels and stds in metres")
        return self


class LevelColumnsTable(Table):
    """Names of the columns of a table of readings, where they are not the usual ones."""

    time: keys.Text | None = None
    date: keys.Text | None = None
    zone: keys.Text | None = None
    level: keys.Text | None = None
    std: keys.Text | None = None


class GroundTable(Table):
    """Ground that is not level, or not always at one level: a slope, an elevation model, water.

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
        level: Readings of the water's level, which raises the measured plane.
        level_m: One level that always holds, in place of readings.
        level_std_m: Standard deviation of a reading, where its row has none; or of ``level_m``.
        level_unit: Unit of the readings, where their column's name has none.
        level_columns: Names of the columns.
        level_utc_offset: Offset from UTC of times that state none.
        level_max_gap_s: Longest gap between two readings that is interpolated over.
        level_datum: What levels count from: free text beside ``level_zero_m``, else a name of ``VERTICAL_DATUMS``.
        level_zero_m: Level at which the water is at the station's elevation 0.
        level_zero_std_m: Its standard deviation.
        altitude_datum: What the station's ``alt_msl_m`` counts from, for a level without ``level_zero_m``.
    """

    INSTEAD_OF: ClassVar = {
        "slope_deg": ("sha256", "radius_m", "cell_m", "band", "fill_msl_m", "refraction"),
        "terrain": ("uphill_azimuth_deg", "point", "level", "level_m"),
        "level": ("level_m",),
        "level_m": ("level_unit", "level_columns", "level_utc_offset", "level_max_gap_s"),
        "level_zero_m": ("altitude_datum",),
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
    level: LevelTable | None = None
    level_m: keys.Real | None = None
    level_std_m: keys.NonNegative | None = None
    level_unit: Literal["m", "cm", "mm", "ft", "in"] | None = None
    level_columns: LevelColumnsTable | None = None
    level_utc_offset: Annotated[keys.Text, _OFFSET] | None = None
    level_max_gap_s: keys.Gap | None = None
    level_datum: keys.Text | None = None
    level_zero_m: keys.Real | None = None
    level_zero_std_m: keys.NonNegative | None = None
    altitude_datum: keys.Text | None = None

    @property
    def path(self) -> Path | None:
        """The elevation model's file; None for a slope."""
        return None if self.terrain is None else Path(self.terrain)

    @property
    def needs_place(self) -> bool:
        """Whether the ground is laid out on the map, so that it must be known where ENU is."""
        return self.terrain is not None or self.point is not None

    @property
    def has_level(self) -> bool:
        """Whether the water's level raises the measured plane."""
        return self.level is not None or self.level_m is not None

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        stray = next((key for key in _OF_LEVEL if not self.has_level and getattr(self, key) is not None), None)
        if stray is not None:
            raise impossible(stray, got="no level beside it", expected="level, a file of readings, or level_m")
        if (self.slope_deg is None) == (self.terrain is None) and not (self.has_level and self.slope_deg is None):
            got = "neither of them" if self.terrain is None else "both of them"
            raise impossible("", got=got, expected="either slope_deg with uphill_azimuth_deg, or terrain")
        if self.level_zero_std_m is not None and self.level_zero_m is None:
            raise impossible("level_zero_std_m", got="no level_zero_m beside it", expected="both of them, or none")
        if self.slope_deg is None and self.terrain is None:
            stated = next((key for key in _OF_SHAPE if getattr(self, key) is not None), None)
            if stated is not None:
                raise impossible(stated, got="no slope_deg beside it", expected="slope_deg and uphill_azimuth_deg")
            return self
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
    if table is None:
        return table
    if table.has_level:
        return _with_readings(table, folder)
    if table.path is None:
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


def _with_readings(table: GroundTable, folder: Path) -> GroundTable:
    """The ground with the readings of its level and the defaults of their use."""
    stated: dict[str, object] = {}
    if table.level is not None:
        stated["level_max_gap_s"] = MAX_GAP_S if table.level_max_gap_s is None else table.level_max_gap_s
        if not table.level.readings:
            file = folder / table.level.file
            columns = None if table.level_columns is None else table.level_columns.to_toml()
            terms = LevelTerms(
                std_m=table.level_std_m, unit=table.level_unit, columns=columns, utc_offset=table.level_utc_offset
            )
            readings = tuple(map(tuple, read_levels(file, terms)))
            stated["level"] = LevelTable.model_construct(file=file.name, readings=readings)
    elif table.level_std_m is None:
        stated["level_std_m"] = READING_STD_M
    return table.model_copy(update=stated)


def level_series(table: GroundTable | None, altitude: Altitude) -> LevelSeries | None:
    """The water's level above a station's elevation 0; None where it does not change.

    Args:
        table: The ground, resolved.
        altitude: Of the station's elevation 0.

    Raises:
        ConfigError: The levels' datum cannot be compared with that of the station's altitude.
    """
    if table is None or not table.has_level:
        return None
    datum = table.level_datum or STATION_DATUM
    if table.level_zero_m is None and table.level_datum is not None:
        zero_m, zero_std_m = altitude.above(table.level_datum, table.altitude_datum or UNKNOWN_SEA_LEVEL)
    else:
        zero_m, zero_std_m = table.level_zero_m or 0.0, table.level_zero_std_m or 0.0
    if table.level is None:
        return LevelSeries.constant(
            table.level_m or 0.0,
            table.level_std_m or 0.0,
            datum=datum,
            source="ground.level_m",
            zero_m=zero_m,
            zero_std_m=zero_std_m,
        )
    stamps_ns, levels_m, stds_m = zip(*table.level.readings, strict=True)
    return LevelSeries(
        stamps_ns=np.array(stamps_ns, dtype=np.int64),
        level_m=np.array(levels_m, dtype=np.float64),
        std_m=np.array(stds_m, dtype=np.float64),
        max_gap_ns=round((table.level_max_gap_s or MAX_GAP_S) * SECOND_NS),
        zero_m=zero_m,
        zero_std_m=zero_std_m,
        datum=datum,
        source=table.level.file,
    )


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
    if table is None or (table.slope_deg is None and table.terrain is None):
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
