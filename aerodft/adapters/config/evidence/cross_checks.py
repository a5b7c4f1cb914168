"""What makes observations impossible together, though each of them looks sound; and the frame that all are in."""

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.config.evidence.evidence_tables import (
    SPACE,
    CameraPriorTable,
    EvidenceTable,
    ObservationTable,
    Place,
)
from aerodft.adapters.config.evidence.local_frame import (
    LocalFrame,
    check_on_map,
    is_used_at,
    takes_degrees,
)
from aerodft.adapters.config.tables import LOCAL
from aerodft.errors import ConfigError
from aerodft.geometry import rays_from_pixels
from aerodft.model import BoolArray, Camera, EvidenceSet, GroundPoint, Horizon, Landmark, Px, SlantRange

_LARGER = (1.5, 2.0, 3.0, 4.0)
_LARGEST_PX = 1e5
_FARTHEST_M = 1e5
_DOUBT_RAD = math.radians(10.0)
_LARGE_M = 1e5  # local coordinates beyond it are somebody's projection, and lose digits if computed with as they are
_DATUM_M, _STDS = 10.0, 6.0  # by which datums differ at least, where it matters
_DEGREE_DIGITS = 5  # a metre
_NEAR_ZERO_M = 1e4  # coordinates within it of a projection's zero are rather somebody's own
SAY_LOCAL: Final = 'write crs = "local"'
_DEGREE_WIDE = 0.5  # by which a scene's latitudes and longitudes differ at most


@dataclass(frozen=True, slots=True)
class StatedObservation:
    """An observation as its file has it.

    Attributes:
        label: What it is called in messages, like ``landmark[3]`` or ``line 5``.
        pixels: All of its pixels.
        place: In the file's coordinates, None where it has none; None in it for an unknown component.
        is_geo: The place is a latitude, a longitude and an altitude.
        may_be_outside: Its pixels need not be in the image.
        image: Name of the image that it was seen in, where there are several.
    """

    label: str
    pixels: tuple[Px, ...]
    place: Place | None = None
    is_geo: bool = False
    may_be_outside: bool = False
    image: str | None = None

    @staticmethod
    def from_table(label: str, table: ObservationTable) -> "StatedObservation":
        """The observation of a table."""
        place, outside = table.place, table.may_be_outside
        return StatedObservation(
            label, table.all_pixels, place, is_geo=table.is_geo, may_be_outside=outside, image=table.image
        )


def check_pixels(stated: Sequence[StatedObservation], size_px: tuple[int, int] | None) -> None:
    """Refuse pixels that are outside of the image, or that no image has where its size is not known.

    Args:
        stated: The observations.
        size_px: Width and height of the image.

    Raises:
        ConfigError: Which, and whether pixels and places, or u and v, look swapped.
    """
    low, high = (-_LARGEST_PX, (_LARGEST_PX,) * 2) if size_px is None else (-0.5, (size_px[0] - 0.5, size_px[1] - 0.5))

    def is_inside(u: float | None, v: float | None) -> bool:
        return all(each is None or low <= each <= most for each, most in zip((u, v), high, strict=True))

    outside = [
        (each, pixel) for each in stated if not each.may_be_outside for pixel in each.pixels if not is_inside(*pixel)
    ]
    if not outside:
        return
    first, pixel = outside[0]
    expected = f"{low:g} to {high[0]:g} across and {low:g} to {high[1]:g} down"
    expected = f"a pixel of the image, {expected}" if size_px else f"a pixel, {expected}"
    placed = [each for each in stated if each.place is not None]
    wrong = [each for each, _ in outside if each.place is not None]
    is_placed_inside = all(each.place and is_inside(*each.place[:2]) for each in placed)
    if 2 * len(wrong) > len(placed) and is_placed_inside and _are_places_wider(placed):
        got = f"{_list(pixel)}, and a place {_list(first.place or ())} that would be one"
        hint = "swap pixels and places: they look interchanged"
        raise ConfigError(f"{first.label}: pixel", got=got, expected=expected, hint=hint)
    is_turned = size_px is not None and all(is_inside(v, u) for _, (u, v) in outside)
    hint = "give u (across) before v (down): they look swapped" if is_turned else ""
    if size_px is not None and not is_turned:
        hint = _larger_image(outside, size_px)
    raise ConfigError(f"{first.label}: pixel", got=_list(pixel), expected=expected, hint=hint)


def _are_places_wider(placed: Sequence[StatedObservation]) -> bool:
    """Whether places are farther apart than pixels, as pixels are than metres."""
    if len(placed) == 1:
        return True
    places = [[each.place[axis] for each in placed if each.place] for axis in (0, 1)]
    known = [[value for value in axis if value is not None] for axis in places]
    wide = max(max(axis) - min(axis) for axis in known if axis)
    return wide > float(np.max(np.ptp([each.pixels[0] for each in placed], axis=0)))


def _larger_image(outside: Sequence[tuple[StatedObservation, Px]], size_px: tuple[int, int]) -> str:
    """A hint at the larger image that all these pixels may be of; empty where no usual size has them."""
    for share in _LARGER:
        width_px, height_px = (round(share * each) for each in size_px)
        if all(0 <= u < width_px and 0 <= v < height_px for _, (u, v) in outside):
            return f"is it an image of {width_px} x {height_px}? take the camera file of that mode"
    return ""


def _list(values: Sequence[float | None]) -> str:
    return f"[{', '.join('?' if value is None else f'{value:.10g}' for value in values)}]"


def check_duplicates(stated: Sequence[StatedObservation]) -> None:
    """Refuse one pixel at two places, one place at two pixels, and a landmark that is there twice, in one image.

    Raises:
        ConfigError: Which two.
    """
    by_pixel: dict[tuple[str | None, tuple[Px, ...]], StatedObservation] = {}
    by_place: dict[tuple[str | None, Place], StatedObservation] = {}
    for each in stated:
        if each.place is None:
            continue
        other = by_pixel.setdefault((each.image, each.pixels), each)
        if other is not each:
            is_same = other.place == each.place
            what = "the same place" if is_same else f"another place, {_list(other.place or ())}"
            got = f"{_list(each.pixels[0])}, which {other.label} has with {what}"
            hint = "remove one of the two" if is_same else ""
            raise ConfigError(f"{each.label}: pixel", got=got, expected="a pixel of its own", hint=hint)
        other = each if None in each.place else by_place.setdefault((each.image, each.place), each)
        if other is not each:
            got = f"{_list(each.place)}, which {other.label} has with another pixel, {_list(other.pixels[0])}"
            raise ConfigError(f"{each.label}: place", got=got, expected="a place of its own")


def check_names(names: Sequence[str], stated: Sequence[StatedObservation]) -> None:
    """Refuse a name that two observations have.

    Raises:
        ConfigError: Which two.
    """
    seen: dict[str, str] = {}
    for name, each in zip(names, stated, strict=True):
        if name in seen:
            got = f'"{name}", which {seen[name]} has'
            raise ConfigError(f"{each.label}: name", got=got, expected="a name of its own")
        seen[name] = each.label


def check_together(stated: Sequence[StatedObservation], frame: LocalFrame) -> None:
    """Refuse a landmark that is nowhere near the others.

    Raises:
        ConfigError: Which, and whether its latitude and longitude look swapped.
    """
    placed = [(each, each.place) for each in stated if each.place is not None and None not in each.place]
    if not placed:
        return
    points_m = frame.local_m(np.array([place for _, place in placed], dtype=np.float64))
    away_m = np.linalg.norm(points_m - np.median(points_m, axis=0), axis=-1)
    index = int(np.argmax(np.where(np.isfinite(away_m), away_m, np.inf)))
    if away_m[index] <= _FARTHEST_M:
        return
    each, place = placed[index]
    got = f"{_list(place)}, {away_m[index] / 1000:.0f} km from the others"
    hint = "check whether latitude and longitude are swapped, or digits missing"
    raise ConfigError(
        f"{each.label}: place",
        got=got,
        expected=f"{_FARTHEST_M / 1000:.0f} km at most",
        hint=hint if takes_degrees(frame.crs) else "check its digits",
    )


def check_degrees(stated: Sequence[StatedObservation]) -> None:
    """Refuse latitudes and longitudes that are radians: read as degrees, all of them lie in the Gulf of Guinea.

    Raises:
        ConfigError: All latitudes and longitudes look like radians.
    """
    lat_lon = [(lat, lon) for each in stated if each.place for lat, lon in [each.place[:2]] if lat and lon]
    is_rad = all(abs(lat) <= math.pi / 2 and abs(lon) <= math.pi for lat, lon in lat_lon)
    is_near_zero = all(abs(lat) < 0.01 and abs(lon) < 0.01 for lat, lon in lat_lon)  # noqa: PLR2004 - made-up places
    if lat_lon and is_rad and not is_near_zero:
        lat, lon = lat_lon[0]
        got = f"{lat:.6g} and {lon:.6g}, in the open sea off Africa"
        hint = "convert them from radians"
        raise ConfigError("latitudes and longitudes", got=got, expected="degrees", hint=hint)


def check_tilt(known: EvidenceSet, camera: Camera, path: Path) -> None:
    """Refuse a tilt that was given in radians, where the observations can tell.

    Raises:
        ConfigError: No observation agrees with it to ten degrees, and all do when it is taken as radians.
    """
    prior = known.priors.get("tilt")
    seen = list(_seen_at(known))
    if prior is None or not seen or math.degrees(prior.value) > math.pi:
        return
    rays = rays_from_pixels(camera, np.array([pixel for pixel, _ in seen]))
    off_axis = np.arccos(np.clip(rays[:, 2] / np.linalg.norm(rays, axis=-1), -1.0, 1.0))
    from_nadir = np.array([angle for _, angle in seen])
    is_known = np.isfinite(off_axis)

    def fits(tilt_rad: float) -> BoolArray:
        away = np.abs(tilt_rad - from_nadir[is_known])
        return np.asarray(away <= off_axis[is_known] + _DOUBT_RAD + 3 * prior.std)

    meant_deg = math.degrees(math.degrees(prior.value))
    if is_known.any() and not fits(prior.value).any() and fits(math.radians(meant_deg)).all():
        got = f"{math.degrees(prior.value):.6g}, with which the camera sees none of what was observed"
        hint = f"if it is in radians, write {meant_deg:.2f}"
        raise ConfigError("camera.tilt_deg", where=path, got=got, expected="degrees", hint=hint)


def _seen_at(known: EvidenceSet) -> Iterator[tuple[Px, float]]:
    """Pixels, and the angle from straight down that they must be seen at."""
    priors = known.priors
    height = priors["height"].value if "height" in priors else math.nan
    foot = [priors[name].value if name in priors else math.nan for name in ("east", "north")]
    for each in known.evidence:
        match each:
            case Horizon(pixels=pixels):
                yield from ((pixel, math.pi / 2) for pixel in pixels)
            case SlantRange(pixel=pixel, range_m=range_m) if height <= range_m:
                yield pixel, math.acos(height / range_m)
            case GroundPoint(pixel=pixel, xy_m=xy_m) if math.isfinite(height):
                yield pixel, math.atan2(math.hypot(*xy_m), height)
            case Landmark(pixel=pixel, position_m=(float(east), float(north), float(up))):
                away_m = math.hypot(east - foot[0], north - foot[1])
                if math.isfinite(away_m + height):
                    yield pixel, math.atan2(away_m, height - up)
            case _:
                continue


def check_datums(stated: Sequence[StatedObservation], camera: CameraPriorTable, crs: str) -> None:
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
        raise ConfigError(f"{label}: place", got=got, expected=expected, hint=hint)


def frame_around(
    stated: Sequence[StatedObservation], table: EvidenceTable, crs: str, say_local: str = SAY_LOCAL
) -> LocalFrame:
    """The frame to compute in.

    Local coordinates stay as they are, unless they are beyond 100 km, which is somebody's projection. The zero of
    others is the mean of the landmarks, to a whole metre or 0.00001 degrees, or the camera where there are none; and
    its height is the ground's, as stated, or else the middle one of the landmarks' heights.

    Args:
        stated: The observations.
        table: The file.
        crs: Its coordinate reference system.
        say_local: Advice on how its places are said to be metres from a zero of somebody's own.

    Raises:
        ConfigError: A place is not where the projection is used, or there is none at all.
    """
    camera = table.camera.place
    placed = [(each.label, each.place) for each in stated if each.place is not None]
    hint = f"they look like metres from a zero of your own: {say_local}" if _are_own_metres(stated, crs) else ""
    for label, (first, second, *_) in [*placed, *([] if camera is None else [("camera", camera)])]:
        if first is not None and second is not None:
            check_on_map(crs, (first, second), f"{label}: place", hint)
    places = [place for _, place in placed]
    middle = [_middle(_known(places, axis) or _known([camera or ()], axis), crs, axis) for axis in (0, 1)]
    zero_m = None if table.elevation_m is None else table.elevation_m.value
    if table.elevation_m is not None:
        _check_elevation(table.elevation_m.value, table.elevation_m.std or 0.0, _known(places, 2))
    if crs == LOCAL and max(abs(each or 0.0) for each in middle) <= _LARGE_M:
        return LocalFrame(crs, (0.0, 0.0, zero_m or 0.0))
    x, y = middle if crs != LOCAL else (each or 0.0 for each in middle)
    if x is None or y is None:
        got, hint = f'"{crs}" and no place in it', f"without any place on the map, {say_local}"
        raise ConfigError("crs", got=got, expected="a landmark, or the camera's position", hint=hint)
    return LocalFrame(crs, (x, y, _zero(places, camera) if zero_m is None else zero_m))


def _are_own_metres(stated: Sequence[StatedObservation], crs: str) -> bool:
    """Whether all places look like metres from a zero of somebody's own."""
    places = [each.place[:2] for each in stated if each.place is not None and None not in each.place[:2]]
    if crs == LOCAL or takes_degrees(crs) or not places:
        return False
    at = np.array(places, dtype=np.float64)
    are_degrees = len(at) > 1 and float(np.max(np.ptp(at, axis=0))) < _DEGREE_WIDE
    are_large = float(np.max(np.abs(at))) > _LARGE_M
    return not (are_degrees or are_large or any(is_used_at(crs, (x, y)) for x, y in at.tolist()))


def check_is_map(stated: Sequence[StatedObservation], crs: str, say_local: str) -> Iterator[str]:
    """A sentence where a projection's coordinates are so near its zero that they may be somebody's own metres."""
    places = [each.place[:2] for each in stated if each.place is not None and None not in each.place[:2]]
    if crs == LOCAL or takes_degrees(crs) or not places:
        return
    if float(np.max(np.abs(np.array(places, dtype=np.float64)))) <= _NEAR_ZERO_M:
        yield f"all places are near the zero of {crs}: if they are metres of your own, {say_local}"


def _check_elevation(ground_m: float, std_m: float, heights_m: Sequence[float]) -> None:
    """Refuse a ground that lies far above everything that is seen on it."""
    if not heights_m or ground_m - max(heights_m) <= _DATUM_M + _STDS * std_m:
        return
    raise ConfigError(
        "elevation_m",
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


def _zero(places: Sequence[Place], camera: Place | None) -> float:
    """The ground's height, as far as landmarks tell: most of them lie on it."""
    heights_m = _known(places, 2)
    if heights_m:
        return statistics.median(heights_m)
    if camera is not None and len(camera) == SPACE:
        hint = "the camera's height cannot be told from its position alone"
        expected = "the height of the ground or water, as no landmark has one"
        raise ConfigError("elevation_m", got="nothing", expected=expected, hint=hint)
    return 0.0
