"""Other readings of an evidence file: what its landmarks are if somebody made a usual mistake."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.adapters.config import GEO, LOCAL
from aerodft.adapters.config.evidence import EvidenceFile, LocalFrame, takes_degrees
from aerodft.geometry import in_image
from aerodft.model import Camera, Evidence, EvidenceSet, FloatArray, Landmark
from calibration.pose import expand_groups

_MAX_LANDMARKS: Final = 60  # that a reading is tried with
FOOT_M: Final = 0.3048
_SMALLER: Final = (1.5, 2.0, 3.0, 4.0)
MIRROR: Final = "mirror"
"""Kind of readings that are mirror images: apart from turns of the camera they are one."""
MIRRORED_IMAGE: Final = "the image looks mirrored"
ORDER: Final = "order"
"""Kind of readings in which pixels belong to other landmarks."""
_MAX_LAT, _MAX_LON, _SITE_DEG = 90.0, 180.0, 1.0
_LARGE_M: Final = 1e5
_WEB_MERCATOR: Final = "EPSG:3857"
_PLACE: Final = ("east", "north", "heading")
POSE: Final = ("east", "north", "height", "tilt", "roll", "heading")
_OWN_HEIGHT: Final = frozenset({"height", "elevation"})
_OWN_PLACE: Final = _OWN_HEIGHT | {"east", "north", "heading"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Another reading of an evidence file.

    Attributes:
        kind: Readings of a kind may fit alike, as they differ by a turn of the camera alone.
        what: What is wrong with it then.
        hint: What to do.
        known: The evidence, read so.
        names: The unknowns to solve for.
        dropped: Number of priors that have no meaning then.
    """

    kind: str
    what: str
    hint: str
    known: EvidenceSet
    names: tuple[str, ...]
    dropped: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class CompleteLandmarks:
    """The landmarks of a file that are known in all three dimensions: some dozens at most, evenly from all of it.

    Attributes:
        landmarks: ``n`` of them.
        others: All evidence but landmarks.
        pixels: ``(n, 2)``.
        places: ``(n, 3)`` in the file's coordinates.
    """

    landmarks: tuple[Landmark, ...]
    others: tuple[Evidence, ...]
    pixels: FloatArray
    places: FloatArray

    @classmethod
    def from_file(cls, found: EvidenceFile) -> "CompleteLandmarks":
        """The complete landmarks of a file."""
        evidence = found.known.evidence
        whole = [each for each in evidence if isinstance(each, Landmark) and None not in each.position_m]
        chosen = whole[:: max(1, -(-len(whole) // _MAX_LANDMARKS))]
        places_m = np.array([each.position_m for each in chosen], dtype=np.float64).reshape(-1, 3)
        return cls(
            tuple(chosen),
            tuple(each for each in evidence if not isinstance(each, Landmark)),
            np.array([each.pixel for each in chosen], dtype=np.float64).reshape(-1, 2),
            found.frame.file_coordinates(places_m),
        )

    def at(self, pixels: FloatArray, places_m: FloatArray) -> tuple[Landmark, ...]:
        """The landmarks at other pixels ``(n, 2)`` and places ``(n, 3)``, metres."""
        return tuple(
            replace(each, pixel=(u, v), position_m=(east, north, up))
            for each, (u, v), (east, north, up) in zip(self.landmarks, pixels.tolist(), places_m.tolist(), strict=True)
        )


def alternative_readings(found: EvidenceFile, camera: Camera, names: tuple[str, ...]) -> Iterator[Reading]:
    """Every other reading of a file's landmarks that it allows, the likeliest first.

    Args:
        found: The file.
        camera: Whose image it is of.
        names: The unknowns that were asked for.
    """
    points = CompleteLandmarks.from_file(found)
    if not points.landmarks:
        return
    priors = found.known.priors
    for kind, what, hint, places_m, own in _other_places(found.frame, points.places):
        if np.all(np.isfinite(places_m)):
            others = {name: prior for name, prior in priors.items() if name not in own}
            known = EvidenceSet(evidence=(*points.at(points.pixels, places_m), *points.others), priors=others)
            dropped = [name for name in priors if name in own]
            unknowns = tuple(dict.fromkeys((*expand_groups(names), *(name for name in _PLACE if name in dropped))))
            yield Reading(kind=kind, what=what, hint=hint, known=known, names=unknowns, dropped=len(dropped))
    here_m = found.frame.local_m(points.places)
    for kind, what, hint, pixels in _other_pixels(points.pixels, camera):
        if in_image(camera, pixels).all():
            known = EvidenceSet(evidence=points.at(pixels, here_m), priors=priors)
            yield Reading(kind=kind, what=what, hint=hint, known=known, names=names)


def columns_swapped(points: CompleteLandmarks, camera: Camera) -> Reading | None:
    """Pixels as places and places as pixels; None where no place could be a pixel."""
    if not points.landmarks or not in_image(camera, points.places[:, :2]).all():
        return None
    evidence = points.at(points.places[:, :2], np.column_stack([points.pixels, points.places[:, 2]]))
    what, hint = "pixels and places look interchanged", "swap their columns"
    return Reading(kind="columns", what=what, hint=hint, known=EvidenceSet(evidence=evidence), names=POSE)


def _other_places(frame: LocalFrame, places: FloatArray) -> Iterator[tuple[str, str, str, FloatArray, frozenset[str]]]:
    """Other readings of places: kind, what is wrong, what to do, places in metres ``(n, 3)``, and priors without sense.

    Where heights alone are read otherwise, the camera's own east, north and heading keep their sense.
    """
    _, second, height = places.T
    swapped, in_degrees = places[:, [1, 0, 2]], takes_degrees(frame.crs)
    x, y = ("latitude", "longitude") if in_degrees else ("x" if frame.crs == LOCAL else "easting", "northing")
    y = "y" if frame.crs == LOCAL else y
    if not in_degrees or np.all(np.abs(second) <= _MAX_LAT):
        mirrored = replace(frame, origin=(frame.origin[1], frame.origin[0], frame.origin[2]))
        yield (
            MIRROR,
            f"{x} and {y} of the landmarks look interchanged",
            f"swap {x} and {y}, if the image is not mirrored",
            mirrored.local_m(swapped),
            _OWN_PLACE,
        )
    if frame.crs == LOCAL and np.all(np.ptp(places[:, :2], axis=0) < _SITE_DEG):
        for label, read in (("latitudes and longitudes", places), ("longitudes and latitudes", swapped)):
            lat_lon = read[:, :2]
            if np.all(np.abs(lat_lon) <= (_MAX_LAT, _MAX_LON)) and np.any(np.abs(lat_lon) > 1):
                origin = (float(lat_lon[0, 0]), float(lat_lon[0, 1]), float(np.median(height)))
                hint = 'write lat_deg, lon_deg and alt_m, with crs = "geo"'
                in_metres = LocalFrame(GEO, origin).local_m(read)
                yield "degrees", f"the landmarks' places look like {label}", hint, in_metres, _OWN_PLACE
    if frame.crs == LOCAL and np.all(np.abs(places[0, :2]) > _LARGE_M):
        mercator = replace(frame, crs=_WEB_MERCATOR)
        hint = f'write crs = "{_WEB_MERCATOR}"'
        yield "crs", "the landmarks' places look like those of a web map", hint, mercator.local_m(places), _OWN_PLACE
    elif frame.crs != LOCAL and not in_degrees:
        local_m = replace(frame, crs=LOCAL).local_m(places)
        yield "crs", f"the landmarks' places do not look like {frame.crs}", "check crs", local_m, _OWN_PLACE
    for label, hint, scale in (
        ("depths, counted downwards", "change their signs", -1.0),
        ("feet", "convert them to metres", FOOT_M),
    ):
        heights_m = frame.local_m(places * [1.0, 1.0, scale])
        yield label, f"the landmarks' heights look like {label}", hint, heights_m, _OWN_HEIGHT


def _other_pixels(pixels: FloatArray, camera: Camera) -> Iterator[tuple[str, str, str, FloatArray]]:
    """Other readings of pixels: kind, what is wrong, what to do, pixels ``(n, 2)``, maybe outside of the image."""
    yield MIRROR, "u and v look interchanged", "give u (across) before v (down)", pixels[:, ::-1]
    u, v = pixels.T
    flipped = np.column_stack([u, camera.height_px - 1 - v])
    yield MIRROR, "v looks as if counted from the bottom of the image", "count v from the top", flipped
    mirrored = np.column_stack([camera.width_px - 1 - u, v])
    hint = "read the pixels in the image as the camera took it, unless two coordinates of the places are interchanged"
    yield MIRROR, MIRRORED_IMAGE, hint, mirrored
    for step, where in ((1, "next"), (-1, "previous")):
        if len(pixels) > 1:
            what = f"each pixel looks as if it belonged to the {where} landmark"
            yield ORDER, what, "check that the rows of pixels and places match", np.roll(pixels, step, axis=0)
    for share in _SMALLER:
        width_px, height_px = round(camera.width_px / share), round(camera.height_px / share)
        what = f"the pixels look like those of an image of {width_px} x {height_px}"
        hint = f"read them in an image of {camera.width_px} x {camera.height_px}, or take that mode's camera file"
        yield f"{width_px} x {height_px}", what, hint, share * (pixels + 0.5) - 0.5
