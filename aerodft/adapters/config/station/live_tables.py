"""The tables of a live calibration: surveyed landmarks and markers, and how the telemetry's errors behave."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.camera import StdTable, stds_from
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.station.station_config import MarkerSettings
from aerodft.adapters.config.tables import LOCAL, NOT_IN_CONFIG_ID, FromFile, SiAttribute, Table, si_value
from aerodft.errors import ConfigError
from aerodft.geometry import east_north
from aerodft.model import FloatArray, GeoOrigin, MarkerSurvey, SurveyedLandmark, SurveyedMarker
from aerodft.service import DRIFT, LiveCalibration

if TYPE_CHECKING:
    from aerodft.adapters.config.evidence import MarkersFile

_FARTHEST_M = 1e5  # of a marker from the station's origin
Place = Annotated[tuple[keys.Real, keys.Real, keys.Real], Field(strict=False)]
PlaceStd = Annotated[
    tuple[keys.NonNegative, keys.NonNegative, keys.NonNegative], keys.broadcast_to(3), Field(strict=False)
]


class LiveLandmarkTable(Table):
    """A surveyed point: on the map, or in metres east, north and up of the station's origin."""

    INSTEAD_OF: ClassVar = {"position_m": ("lat_deg", "lon_deg", "alt_msl_m")}

    name: keys.Slug
    lat_deg: keys.Latitude | None = None
    lon_deg: keys.Longitude | None = None
    alt_msl_m: keys.Real | None = None
    position_m: Annotated[Place | None, SiAttribute("position_enu_m")] = None
    std_m: PlaceStd = (0.0, 0.0, 0.0)
    std_px: keys.Positive = 1.0

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        on_map = {key: getattr(self, key) for key in ("lat_deg", "lon_deg", "alt_msl_m")}
        stated = [key for key, value in on_map.items() if value is not None]
        if self.position_m is None and len(stated) < len(on_map):
            missing = next(key for key, value in on_map.items() if value is None)
            raise impossible(missing, got="nothing", expected="lat_deg, lon_deg and alt_msl_m, or position_m")
        return self


class LiveCalibrationTable(Table):
    """Settings of the live estimation of biases from landmarks."""

    noise_share: Annotated[float, Field(ge=0, lt=1)] = 0.1
    noise: StdTable = StdTable()
    initial: StdTable = StdTable()
    drift: StdTable = StdTable()
    gate_probability: Annotated[float, Field(ge=0.5, lt=1)] = 0.999
    outlier_fraction: Annotated[float, Field(ge=0, le=0.5)] = 0.1


def live_from(
    table: LiveCalibrationTable,
    landmarks: tuple[LiveLandmarkTable, ...],
    markers: tuple[SurveyedLandmark, ...],
    origin: GeoOrigin | None,
) -> LiveCalibration | None:
    """The live calibration; None without landmarks.

    Args:
        table: How errors behave.
        landmarks: Those of the file itself.
        markers: Those that markers are.
        origin: The station's.

    Raises:
        ConfigError: A name twice, or nobody knows where the landmarks are against the station.
    """
    if not landmarks and not markers:
        return None
    names, marker_names = [each.name for each in landmarks], {each.name for each in markers}
    for index, name in enumerate(names):
        if name in names[:index] or name in marker_names:
            raise ConfigError(f"landmark[{index}].name", got=f'"{name}" again', expected="a name of its own")
    origin = needed_origin(origin, "[[landmark]]")
    return si_value(
        LiveCalibration,
        table,
        landmarks=(*(_landmark(each, origin) for each in landmarks), *markers),
        drift=stds_from(table.drift, DRIFT),
    )


def needed_origin(origin: GeoOrigin | None, beside: str) -> GeoOrigin:
    """The station's origin, without which nobody knows where landmarks are.

    Raises:
        ConfigError: There is none.
    """
    if origin is None:
        expected = "{ lat_deg, lon_deg, alt_msl_m } of a point of the measured plane, from which landmarks are counted"
        raise ConfigError("station.origin", got=f"nothing beside {beside}", expected=expected)
    return origin


def _landmark(table: LiveLandmarkTable, origin: GeoOrigin) -> SurveyedLandmark:
    place = _on_map(table, origin) if table.position_m is None else table.position_m
    return si_value(SurveyedLandmark, table, position_enu_m=place)


def _on_map(table: LiveLandmarkTable, origin: GeoOrigin) -> tuple[float, float, float]:
    if origin.alt_msl_m is None:
        expected = f'metres, because landmark "{table.name}" has alt_msl_m'
        raise ConfigError("station.origin.alt_msl_m", got="nothing", expected=expected)
    lat_rad, lon_rad = math.radians(table.lat_deg or 0.0), math.radians(table.lon_deg or 0.0)
    east_m, north_m = east_north(origin, lat_rad, lon_rad).tolist()
    return east_m, north_m, (table.alt_msl_m or 0.0) - origin.alt_msl_m


class StationMarkersTable(FromFile):
    """Markers that are looked for in a station's images."""

    every_s: Annotated[keys.Duration, NOT_IN_CONFIG_ID] = 0.1


def marker_settings(
    table: StationMarkersTable | None, origin: GeoOrigin | None, where: str, folder: Path
) -> MarkerSettings | None:
    """The markers of a station; None without the table.

    Args:
        table: The table.
        origin: The station's.
        where: The station file's name in messages.
        folder: What a relative ``file`` starts from.

    Raises:
        ConfigError: As ``markers.load_markers``; or nobody knows where the markers are against the station.
    """
    if table is None:
        return None
    from aerodft.adapters.config.evidence import load_markers, markers_from  # noqa: PLC0415 - 15 MB that few need

    origin = needed_origin(origin, "[markers]")
    if table.file is None:
        file = markers_from(table.contents, Path(f"{where} [markers]"))
    else:
        file = load_markers(folder / table.file)
    return MarkerSettings(survey=_survey_from_origin(file, origin), ignore=file.ignore, every_s=table.every_s)


def _survey_from_origin(file: "MarkersFile", origin: GeoOrigin) -> MarkerSurvey:
    """The survey in metres from the station's origin."""
    markers = []
    for each in file.survey.markers:
        points_m = _from_origin_m(file, np.array(each.points_m), origin)
        if np.max(np.abs(points_m)) > _FARTHEST_M:
            away_km = float(np.max(np.linalg.norm(points_m, axis=-1))) / 1000
            hint = 'local places count from station.origin; others need their crs, "geo" or an EPSG code'
            got = f"{away_km:.0f} km from the station's origin"
            raise ConfigError(f"marker {each.id}", where=file.path, got=got, expected="at most 100 km", hint=hint)
        placed = tuple((float(east), float(north), float(up)) for east, north, up in points_m)
        markers.append(SurveyedMarker(id=each.id, points_m=placed, std_m=each.std_m, side_m=each.side_m))
    return MarkerSurvey(dictionary=file.survey.dictionary, markers=tuple(markers))


def _from_origin_m(file: "MarkersFile", points_m: FloatArray, origin: GeoOrigin) -> FloatArray:
    """East, north, up ``(n, 3)`` of the station's origin, of points ``(n, 3)`` of the file's frame."""
    on_map = file.frame.wgs84(points_m)
    if on_map is None:
        return points_m + [file.frame.origin[0], file.frame.origin[1], 0.0]
    if origin.alt_msl_m is None:
        expected = f"metres, because the markers of {file.path} have heights"
        raise ConfigError("station.origin.alt_msl_m", got="nothing", expected=expected)
    up_m = on_map[:, 2:] - origin.alt_msl_m
    return np.hstack([east_north(origin, on_map[:, 0], on_map[:, 1]), up_m])


def marker_landmarks(settings: MarkerSettings | None) -> tuple[SurveyedLandmark, ...]:
    """Landmarks of a live calibration: one for each surveyed point of the markers."""
    if settings is None:
        return ()
    return tuple(
        SurveyedLandmark(name=name, position_enu_m=point_m, std_m=marker.std_m)
        for marker in settings.survey.markers
        for name, point_m in zip(marker.point_names, marker.points_m, strict=True)
    )


def station_markers_table(settings: MarkerSettings) -> StationMarkersTable:
    """The table of a station's markers, complete in itself; reading it gives equal settings."""
    ignore = {"ignore": sorted(settings.ignore)} if settings.ignore else {}
    survey: dict[str, Any] = {
        "dictionary": settings.survey.dictionary,
        "crs": LOCAL,
        "marker": [_marker_keys(each) for each in settings.survey.markers],
    }
    return StationMarkersTable.from_contents(survey | ignore, every_s=settings.every_s)


def _marker_keys(marker: SurveyedMarker) -> dict[str, Any]:
    points_m = [list(point) for point in marker.points_m]
    place = {"position_m": points_m[0]} if len(points_m) == 1 else {"corners_m": points_m}
    side = {} if marker.side_m is None else {"side_m": marker.side_m}
    return {"id": marker.id, **place, **side, "std_m": list(marker.std_m)}
