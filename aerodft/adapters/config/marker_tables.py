"""The table ``[markers]`` of a station: surveyed markers that are looked for in its images."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerodft.adapters.config.live_tables import needed_origin
from aerodft.adapters.config.reading import validated
from aerodft.adapters.config.station import MarkerSettings
from aerodft.adapters.config.tables import LOCAL, Duration, Table, Text
from aerodft.errors import ConfigError
from aerodft.geometry.geodesy import east_north
from aerodft.model.arrays import FloatArray
from aerodft.model.marker import MarkerSurvey, SurveyedLandmark, SurveyedMarker
from aerodft.model.pose import GeoOrigin

if TYPE_CHECKING:
    from aerodft.adapters.config.markers import MarkersFile

_FARTHEST_M = 1e5  # of a marker from the station's origin


class _FileTable(Table):
    file: Text
    every_s: Duration = 0.1


class _RateTable(Table):
    every_s: Duration = 0.1


def marker_settings(
    document: dict[str, Any] | None, origin: GeoOrigin | None, where: str, folder: Path
) -> MarkerSettings | None:
    """The markers of a station; None without the table.

    Args:
        document: The table: ``file``, or what such a file would hold; and ``every_s``.
        origin: The station's.
        where: The station file's name in messages.
        folder: What a relative ``file`` starts from.

    Raises:
        ConfigError: As ``markers.load_markers``; or nobody knows where the markers are against the station.
    """
    if document is None:
        return None
    from aerodft.adapters.config.markers import load_markers, markers_from  # noqa: PLC0415 - 15 MB that few need

    origin = needed_origin(origin, "[markers]", where)
    if "file" in document:
        table = validated(_FileTable, document, where, "markers.")
        file, every_s = load_markers(folder / table.file), table.every_s
    else:
        rest = {key: value for key, value in document.items() if key != "every_s"}
        rate = {key: value for key, value in document.items() if key == "every_s"}
        every_s = validated(_RateTable, rate, where, "markers.").every_s
        file = markers_from(rest, Path(f"{where} [markers]"))
    return MarkerSettings(survey=_placed(file, origin, where), ignore=file.ignore, every_s=every_s)


def _placed(file: "MarkersFile", origin: GeoOrigin, where: str) -> MarkerSurvey:
    """The survey in metres from the station's origin."""
    markers = []
    for each in file.survey.markers:
        points_m = _from_origin_m(file, np.array(each.points_m), origin, where)
        if np.max(np.abs(points_m)) > _FARTHEST_M:
            away_km = float(np.max(np.linalg.norm(points_m, axis=-1))) / 1000
            hint = 'local places count from station.origin; others need their crs, "geo" or an EPSG code'
            got = f"{away_km:.0f} km from the station's origin"
            raise ConfigError(f"marker {each.id}", where=file.path, got=got, expected="at most 100 km", hint=hint)
        placed = tuple((float(east), float(north), float(up)) for east, north, up in points_m)
        markers.append(SurveyedMarker(id=each.id, points_m=placed, std_m=each.std_m, side_m=each.side_m))
    return MarkerSurvey(dictionary=file.survey.dictionary, markers=tuple(markers))


def _from_origin_m(file: "MarkersFile", points_m: FloatArray, origin: GeoOrigin, where: str) -> FloatArray:
    """East, north, up ``(n, 3)`` of the station's origin, of points ``(n, 3)`` of the file's frame."""
    on_map = file.frame.wgs84(points_m)
    if on_map is None:
        return points_m + [file.frame.origin[0], file.frame.origin[1], 0.0]
    if origin.alt_msl_m is None:
        expected = f"metres, because the markers of {file.path} have heights"
        raise ConfigError("station.origin.alt_msl_m", where=where, got="nothing", expected=expected)
    up_m = on_map[:, 2:] - origin.alt_msl_m
    return np.hstack([east_north(origin, on_map[:, 0], on_map[:, 1]), up_m])


def marker_landmarks(settings: MarkerSettings | None) -> tuple[SurveyedLandmark, ...]:
    """What the markers are to a live calibration: a landmark for each surveyed point."""
    if settings is None:
        return ()
    return tuple(
        SurveyedLandmark(name=name, position_enu_m=point_m, std_m=marker.std_m)
        for marker in settings.survey.markers
        for name, point_m in zip(marker.point_names, marker.points_m, strict=True)
    )


def markers_document(settings: MarkerSettings) -> dict[str, Any]:
    """The table as TOML keys, complete in itself; reading it gives the same settings."""
    document: dict[str, Any] = {
        "dictionary": settings.survey.dictionary,
        "crs": LOCAL,
        "every_s": settings.every_s,
        "marker": [_document(each) for each in settings.survey.markers],
    }
    return {**document, "ignore": sorted(settings.ignore)} if settings.ignore else document


def _document(marker: SurveyedMarker) -> dict[str, Any]:
    points_m = [list(point) for point in marker.points_m]
    place = {"position_m": points_m[0]} if len(points_m) == 1 else {"corners_m": points_m}
    side = {} if marker.side_m is None else {"side_m": marker.side_m}
    return {"id": marker.id, **place, **side, "std_m": list(marker.std_m)}
