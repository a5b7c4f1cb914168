"""Where in the world evidence is: the frame around it, and its places in that frame."""

import statistics
from collections.abc import Sequence

from aerodft.adapters.config.crs import LOCAL
from aerodft.adapters.config.evidence_checks import Place, Stated
from aerodft.adapters.config.evidence_frame import LocalFrame, check_on_map, takes_degrees
from aerodft.adapters.config.evidence_priors import CameraPriorTable, EvidenceTable
from aerodft.adapters.config.evidence_tables import SPACE, LandmarkTable
from aerodft.errors import ConfigError
from aerodft.model.evidence import Landmark

_LARGE_M = 1e5  # local coordinates beyond it are somebody's projection, and lose digits if computed with as they are
_DATUM_M, _STDS = 10.0, 6.0  # by which datums differ at least, where it matters
_DEGREE_DIGITS = 5  # a metre


def check_datums(stated: Sequence[Stated], camera: CameraPriorTable, crs: str, where: str) -> None:
    """Refuse a file in which some places are in degrees and others in metres, or all are not what ``crs`` says.

    Raises:
        ConfigError: Which place.
    """
    in_degrees = takes_degrees(crs)
    placed = [(each.label, each.is_geo) for each in stated if each.place is not None]
    if camera.place is not None:
        placed.append(("camera", camera.is_geo))
    for label, is_geo in placed:
        if is_geo == in_degrees:
            continue
        got = f'{"latitude and longitude" if is_geo else "position_m"} with crs = "{crs}"'
        expected = "lat_deg, lon_deg and alt_m" if in_degrees else "position_m"
        is_mixed = len({each for _, each in placed}) > 1
        hint = "all places of a file are of one kind" if is_mixed else 'degrees need crs = "geo"'
        raise ConfigError(f"{label}: place", where=where, got=got, expected=expected, hint=hint)


def frame_around(stated: Sequence[Stated], table: EvidenceTable, crs: str, where: str) -> LocalFrame:
    """The frame to compute in.

    Local coordinates stay as they are, unless they are beyond 100 km, which is somebody's projection. The zero of
    others is the mean of the landmarks, to a whole metre or 0.00001 degrees, or the camera where there are none; and
    its height is the ground's, as stated, or else the middle one of the landmarks' heights.

    Args:
        stated: The observations.
        table: The file.
        crs: Its coordinate reference system.
        where: Its name in messages.

    Raises:
        ConfigError: A place is not where the projection is used, or there is none at all.
    """
    camera = table.camera.place
    placed = [(each.label, each.place) for each in stated if each.place is not None]
    for label, (first, second, *_) in [*placed, *([] if camera is None else [("camera", camera)])]:
        if first is not None and second is not None:
            check_on_map(crs, (first, second), f"{label}: place", where)
    places = [place for _, place in placed]
    middle = [_middle(_known(places, axis) or _known([camera or ()], axis), crs, axis) for axis in (0, 1)]
    zero_m = None if table.elevation_m is None else table.elevation_m.value
    if table.elevation_m is not None:
        _check_elevation(table.elevation_m.value, table.elevation_m.std or 0.0, _known(places, 2), where)
    if crs == LOCAL and max(abs(each or 0.0) for each in middle) <= _LARGE_M:
        return LocalFrame(crs, (0.0, 0.0, zero_m or 0.0))
    x, y = middle if crs != LOCAL else (each or 0.0 for each in middle)
    if x is None or y is None:
        got, hint = f'"{crs}" and no place in it', 'without any place on the map, write crs = "local"'
        raise ConfigError("crs", where=where, got=got, expected="a landmark, or the camera's position", hint=hint)
    return LocalFrame(crs, (x, y, _zero(places, camera, where) if zero_m is None else zero_m))


def _check_elevation(ground_m: float, std_m: float, heights_m: Sequence[float], where: str) -> None:
    """Refuse a ground that lies far above everything that is seen on it."""
    if not heights_m or ground_m - max(heights_m) <= _DATUM_M + _STDS * std_m:
        return
    raise ConfigError(
        "elevation_m",
        where=where,
        got=f"{ground_m:g}, {ground_m - max(heights_m):.1f} m above the highest landmark",
        expected="the height of the ground or water in the heights of the landmarks",
        hint="are heights of two datums mixed, above the ellipsoid and above the sea?",
    )


def _known(places: Sequence[Place], axis: int) -> list[float]:
    return [value for place in places for value in place[axis : axis + 1] if value is not None]


def _middle(values: list[float], crs: str, axis: int) -> float | None:
    if not values:
        return None
    if not takes_degrees(crs):
        return float(round(statistics.fmean(values)))
    first = values[0]
    around = [(value - first + 180) % 360 - 180 for value in values] if axis == 1 else [v - first for v in values]
    return round(first + statistics.fmean(around), _DEGREE_DIGITS)


def _zero(places: Sequence[Place], camera: Place | None, where: str) -> float:
    """The ground's height, as far as landmarks tell: most of them lie on it."""
    heights_m = _known(places, 2)
    if heights_m:
        return statistics.median(heights_m)
    if camera is not None and len(camera) == SPACE:
        hint = "the camera's height cannot be told from its position alone"
        expected = "the height of the ground or water, as no landmark has one"
        raise ConfigError("elevation_m", where=where, got="nothing", expected=expected, hint=hint)
    return 0.0


def landmark_from(table: LandmarkTable, name: str, frame: LocalFrame) -> Landmark:
    """A landmark in the frame; for the way there, the frame's zero stands in for what is not known."""
    place = table.place
    whole = [zero if value is None else value for value, zero in zip(place, frame.origin, strict=True)]
    east_m, north_m, up_m = frame.local_m(whole).tolist()
    axes = (1, 0, 2) if table.is_geo else (0, 1, 2)
    unknown = [place[axis] is None for axis in axes]
    return Landmark(
        name=name,
        pixel=table.pixel,
        position_m=(
            None if unknown[0] else east_m,
            None if unknown[1] else north_m,
            None if unknown[2] else up_m,
        ),
        std_px=table.std_px,
        std_m=table.std_m,
    )
