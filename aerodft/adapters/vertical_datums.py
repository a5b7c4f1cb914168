"""Heights above one vertical datum from heights above another, by PROJ and the geoid grids that are installed."""

import math
import re
import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from pyproj import CRS
from pyproj.exceptions import ProjError
from pyproj.transformer import TransformerGroup

from aerodft.errors import ConfigError
from aerodft.model import GeoOrigin

ELLIPSOID: Final = "ellipsoid"
"""Heights above WGS84: of GNSS receivers with RTK, and of GPS_RAW_INT.alt_ellipsoid."""

UNKNOWN_SEA_LEVEL: Final = "msl"
"""Heights above a mean sea level of which nobody says which: of GLOBAL_POSITION_INT.alt and of most receivers."""

_VERTICAL_CODES: Final = {"egm96": "epsg:5773", "egm2008": "epsg:3855"}

VERTICAL_DATUMS: Final = (ELLIPSOID, UNKNOWN_SEA_LEVEL, "EGM96", "EGM2008", "EPSG:...")
"""Names of vertical datums; the last is a vertical reference system's code, such as EPSG:7837 for DHHN2016."""

SEA_LEVELS_STD_M: Final = 1.0
"""Std of the step between two zeros of heights above some mean sea level. The sea's own topography is -2 to 1 m about
the geoid (national datums count from a tide gauge), EGM96 and EGM2008 differ by 0.5 m rms."""


@dataclass(frozen=True, slots=True)
class Altitude:
    """An altitude of a place.

    Attributes:
        place: Where, and how high; None where it is not known where.
    """

    place: GeoOrigin | None

    def above(self, datum: str, own_datum: str) -> tuple[float, float]:
        """The altitude above another datum, and the std of the step between the two.

        Args:
            datum: Of ``VERTICAL_DATUMS``.
            own_datum: What the place's altitude counts from, of ``VERTICAL_DATUMS``.

        Raises:
            ConfigError: The altitude is not known, a datum is none, or a geoid grid is not installed.
        """
        if self.place is None or self.place.alt_msl_m is None:
            expected = "level_zero_m, the level at which the water is at the station's elevation 0"
            hint = f'or state station.origin.alt_msl_m above "{datum}"'
            raise ConfigError("ground.level_zero_m", got="nothing", expected=expected, hint=hint)
        own, other = _known(own_datum, "ground.altitude_datum"), _known(datum, "ground.level_datum")
        if own == other:
            return self.place.alt_msl_m, 0.0
        if UNKNOWN_SEA_LEVEL in (own, other) and ELLIPSOID not in (own, other):
            return self.place.alt_msl_m, SEA_LEVELS_STD_M
        lat_lon_deg = math.degrees(self.place.lat_rad), math.degrees(self.place.lon_rad)
        try:
            (from_m, from_std_m), (to_m, to_std_m) = _undulation(own, *lat_lon_deg), _undulation(other, *lat_lon_deg)
        except ConfigError:
            if ELLIPSOID in (own, other):  # the geoid is -107 to 86 m from it
                raise
            return self.place.alt_msl_m, SEA_LEVELS_STD_M
        return self.place.alt_msl_m + from_m - to_m, math.hypot(from_std_m, to_std_m)


def _known(name: str, key: str) -> str:
    """A datum by one name: ``ellipsoid``, ``msl`` or its code.

    Raises:
        ConfigError: It is of no vertical datum.
    """
    found = name.strip().lower()
    if found in (ELLIPSOID, UNKNOWN_SEA_LEVEL):
        return found
    found = _VERTICAL_CODES.get(found, found)
    if match := re.fullmatch(r"epsg:(\d{1,6})", found):
        try:
            if CRS.from_epsg(int(match[1])).is_vertical:
                return found
        except ProjError:
            pass
    expected, hint = f"one of {', '.join(VERTICAL_DATUMS)}", "or state ground.level_zero_m beside it"
    raise ConfigError(key, got=f'"{name}"', expected=expected, hint=hint)


@lru_cache(maxsize=64)
def _undulation(datum: str, lat_deg: float, lon_deg: float) -> tuple[float, float]:
    """Height (m) of a datum's zero above the ellipsoid at a place, and its std.

    Raises:
        ConfigError: No grid is installed that says it.
    """
    if datum == ELLIPSOID:
        return 0.0, 0.0
    if datum == UNKNOWN_SEA_LEVEL:
        undulation_m, std_m = _undulation(_VERTICAL_CODES["egm2008"], lat_deg, lon_deg)
        return undulation_m, math.hypot(std_m, SEA_LEVELS_STD_M)
    code = int(datum.removeprefix("epsg:"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the grids that are not installed, which the error says
        found = TransformerGroup(CRS(f"EPSG:4326+{code}"), CRS.from_epsg(4979), always_xy=True, allow_ballpark=False)
    for transformer in found.transformers:
        undulation_m = transformer.transform(lon_deg, lat_deg, 0.0)[2]
        if math.isfinite(undulation_m):
            return float(undulation_m), max(transformer.accuracy, 0.0) or SEA_LEVELS_STD_M
    grids = [grid.short_name for operation in found.unavailable_operations for grid in operation.grids]
    expected = f"one of {CRS.from_epsg(code).name} at {lat_deg:.4f}, {lon_deg:.4f}"
    hint = f"install PROJ's grid {grids[0]} by `pyproj sync`" if grids else "PROJ knows no grid"
    hint = f"{hint}, or state ground.level_zero_m"
    raise ConfigError("no geoid grid", where="ground.level_datum", got="none installed", expected=expected, hint=hint)
