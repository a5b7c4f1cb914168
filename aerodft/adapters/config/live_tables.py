"""The tables of a live calibration: surveyed landmarks, and how the telemetry's errors behave."""

import math
from dataclasses import asdict, replace
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from aerodft.adapters.config.tables import (
    Latitude,
    Longitude,
    Means,
    NonNegative,
    Positive,
    Real,
    Slug,
    Table,
    impossible,
    keys_of,
    repeated,
    value_of,
)
from aerodft.errors import ConfigError
from aerodft.geometry.geodesy import east_north
from aerodft.model.marker import SurveyedLandmark
from aerodft.model.pose import GeoOrigin
from aerodft.service.settings import DRIFT, ErrorStd, LiveCalibration

AngleStd = Annotated[float, Field(ge=0, le=180)]
Place = Annotated[tuple[Real, Real, Real], Field(strict=False)]
PlaceStd = Annotated[tuple[NonNegative, NonNegative, NonNegative], repeated(3), Field(strict=False)]


class LandmarkTable(Table):
    """A surveyed point: on the map, or in metres east, north and up of the station's origin."""

    name: Slug
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    alt_msl_m: Real | None = None
    position_m: Annotated[Place | None, Means("position_enu_m")] = None
    std_m: PlaceStd = (0.0, 0.0, 0.0)
    std_px: Positive = 1.0

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        on_map = {key: getattr(self, key) for key in ("lat_deg", "lon_deg", "alt_msl_m")}
        stated = [key for key, value in on_map.items() if value is not None]
        if self.position_m is not None and stated:
            raise impossible(stated[0], got="it beside position_m", expected="one of the two")
        if self.position_m is None and len(stated) < len(on_map):
            missing = next(key for key, value in on_map.items() if value is None)
            raise impossible(missing, got="nothing", expected="lat_deg, lon_deg and alt_msl_m, or position_m")
        return self


class ErrorStdTable(Table):
    """Standard deviations of the telemetry's errors; a default applies to what is left out."""

    height_m: NonNegative | None = None
    horizontal_m: NonNegative | None = None
    tilt_deg: AngleStd | None = None
    pan_deg: AngleStd | None = None
    roll_deg: AngleStd | None = None
    heading_deg: AngleStd | None = None


class LiveTable(Table):
    """How biases are estimated from landmarks."""

    noise_share: Annotated[float, Field(ge=0, lt=1)] = 0.1
    noise: ErrorStdTable = ErrorStdTable()
    initial: ErrorStdTable = ErrorStdTable()
    drift: ErrorStdTable = ErrorStdTable()
    gate_probability: Annotated[float, Field(ge=0.5, lt=1)] = 0.999
    outlier_share: Annotated[float, Field(ge=0, le=0.5)] = 0.1


def live_from(
    table: LiveTable,
    landmarks: tuple[LandmarkTable, ...],
    markers: tuple[SurveyedLandmark, ...],
    origin: GeoOrigin | None,
    where: str,
) -> LiveCalibration | None:
    """The live calibration; None without landmarks.

    Args:
        table: How errors behave.
        landmarks: Those of the file itself.
        markers: Those that markers are.
        origin: The station's.
        where: The file's name in messages.

    Raises:
        ConfigError: A name twice, or nobody knows where the landmarks are against the station.
    """
    if not landmarks and not markers:
        return None
    names, taken = [each.name for each in landmarks], {each.name for each in markers}
    for index, name in enumerate(names):
        if name in names[:index] or name in taken:
            raise ConfigError(
                f"landmark[{index}].name", where=where, got=f'"{name}" again', expected="a name of its own"
            )
    origin = needed_origin(origin, "[[landmark]]", where)
    return value_of(
        table,
        LiveCalibration,
        landmarks=(*(_landmark(each, origin, where) for each in landmarks), *markers),
        drift=errors_from(table.drift, DRIFT),
    )


def needed_origin(origin: GeoOrigin | None, beside: str, where: str) -> GeoOrigin:
    """The station's origin, without which nobody knows where landmarks are.

    Raises:
        ConfigError: There is none.
    """
    if origin is None:
        expected = "{ lat_deg, lon_deg, alt_msl_m } of a point of the measured plane, from which landmarks are counted"
        raise ConfigError("station.origin", where=where, got=f"nothing beside {beside}", expected=expected)
    return origin


def live_document(live: LiveCalibration, markers: frozenset[str] = frozenset()) -> dict[str, Any]:
    """The tables ``landmark`` and ``calibration`` as TOML keys; reading them gives the same settings.

    Args:
        live: The settings.
        markers: Names of the landmarks that are markers', which have a table of their own.
    """
    landmarks = [keys_of(LandmarkTable, each) for each in live.landmarks if each.name not in markers]
    return {"landmark": landmarks, "calibration": keys_of(LiveTable, live)}


def _landmark(table: LandmarkTable, origin: GeoOrigin, where: str) -> SurveyedLandmark:
    place = _on_map(table, origin, where) if table.position_m is None else table.position_m
    return value_of(table, SurveyedLandmark, position_enu_m=place)


def _on_map(table: LandmarkTable, origin: GeoOrigin, where: str) -> tuple[float, float, float]:
    if origin.alt_msl_m is None:
        expected = f'metres, because landmark "{table.name}" has alt_msl_m'
        raise ConfigError("station.origin.alt_msl_m", where=where, got="nothing", expected=expected)
    lat_rad, lon_rad = math.radians(table.lat_deg or 0.0), math.radians(table.lon_deg or 0.0)
    east_m, north_m = east_north(origin, lat_rad, lon_rad).tolist()
    return east_m, north_m, (table.alt_msl_m or 0.0) - origin.alt_msl_m


def errors_from(table: ErrorStdTable, default: ErrorStd) -> ErrorStd:
    """The errors that a validated table describes; ``default`` applies to what it leaves out."""
    given = asdict(value_of(table, ErrorStd))
    return replace(default, **{name: value for name, value in given.items() if value is not None})
