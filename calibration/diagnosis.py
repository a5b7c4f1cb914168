"""Why evidence does not fit: every likely mistake, and every other reading of a file, is tried by solving with it.

Landmarks that disagree with the rest may have something in common: another height datum, a shift, each other's pixels.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from aerodft.adapters.config import GEO, LOCAL
from aerodft.adapters.config.evidence import EvidenceFile, LocalFrame, StatedObservation, takes_degrees
from aerodft.errors import AerodftError, InputError, NotDetermined
from aerodft.geometry import in_image, rays_from_pixels, reproject
from aerodft.model import (
    Camera,
    Evidence,
    EvidenceSet,
    FloatArray,
    GroundPoint,
    Landmark,
    Prior,
    ProjectionModel,
    SlantRange,
)
from calibration.pose import OUT_OF_SIGHT, Result, State, angles_deg, calibrate, display_unit, expand_groups

_MIN_SHIFT_M: Final = 10.0  # by which datums differ at least, where it matters
_SAME_M, _SAME = 2.0, 0.05  # how well the shifts of several landmarks agree
_NEAR_STDS, _NEAR_PX = 6.0, 3.0
_MIN_KEPT: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class _Stray:
    """A landmark that disagrees, known in all three dimensions."""

    landmark: Landmark
    stated: StatedObservation
    near_px: float

    @property
    def place_m(self) -> FloatArray:
        """``(3,)``."""
        return np.array(self.landmark.position_m, dtype=np.float64)


def common_error(found: EvidenceFile, result: Result) -> InputError | None:
    """A common error of all rejected landmarks, seen from the camera of the others; None if there is none."""
    state, kept = result.solution.state, result.solution.kept
    landmarks = [isinstance(each, Landmark) for each in found.known.evidence]
    if not result.weakest.is_determined or np.count_nonzero(kept & landmarks) < _MIN_KEPT:
        return None
    misfit = max(result.solution.misfit, 1.0)
    strays = [
        _Stray(evidence, stated, max(_NEAR_PX, _NEAR_STDS * misfit * evidence.std_px))
        for evidence, stated, is_kept in zip(found.known.evidence, found.stated, kept, strict=True)
        if not is_kept and isinstance(evidence, Landmark) and None not in evidence.position_m
    ]
    if not strays:
        return None
    return _raised(found, state, strays) or _shifted(found, state, strays) or _swapped(found, state, strays)


def unseen_error(found: EvidenceFile, result: Result) -> InputError | None:
    """The first observation that the camera cannot see from where all others place it; None if it sees all."""
    state = result.solution.state
    for evidence, stated, is_kept in zip(found.known.evidence, found.stated, result.solution.kept, strict=True):
        if is_kept or not result.weakest.is_determined:
            continue
        if isinstance(evidence, Landmark) and None not in evidence.position_m and _is_behind(state, evidence):
            what, expected = "its place is behind the camera", "a place in view"
        elif above := _above_horizon(state, evidence):
            what, expected = f"its {above} is above the horizon", "pixel and place on the same side of it"
        else:
            continue
        return InputError(
            f"{stated.label}: {what}, as the other observations have it",
            where=found.path,
            got=f"{evidence.name}, {_shown(stated)}",
            expected=expected,
            hint="correct its pixel or its place, or remove it",
        )
    return None


def _raised(found: EvidenceFile, state: State, strays: Sequence[_Stray]) -> InputError | None:
    """Heights of all strays that are off by one number."""
    ups_m = np.array([_height_seen(state, each) for each in strays])
    off_m = np.array([each.place_m[2] for each in strays]) - ups_m
    if not _agree(off_m[:, None]):
        return None
    typical_m = float(np.median(off_m))
    moved = np.array([[*each.place_m[:2], each.place_m[2] - typical_m] for each in strays])
    if not _all_near(state, strays, moved):
        return None
    return InputError(
        f"{_names(strays)}: height",
        where=found.path,
        got=f"{abs(typical_m):.1f} m {'above' if typical_m > 0 else 'below'} where the other landmarks' camera sees it",
        expected="heights of one datum",
        hint="are they of two datums, above the ellipsoid and above the sea?",
    )


def _shifted(found: EvidenceFile, state: State, strays: Sequence[_Stray]) -> InputError | None:
    """Places of all strays that are shifted by one vector, which a single stray cannot tell."""
    if len(strays) == 1:
        return None
    seen = [state.ground_points(np.array([each.landmark.pixel]), each.place_m[2]) for each in strays]
    off_m = np.array([each.place_m[:2] - ground.points_enu_m[0, :2] for each, ground in zip(strays, seen, strict=True)])
    if not _agree(off_m):
        return None
    east_m, north_m = np.median(off_m, axis=0)
    got = f"{abs(east_m):.1f} m {'east' if east_m > 0 else 'west'} and {abs(north_m):.1f} m"
    return InputError(
        f"{_names(strays)}: place",
        where=found.path,
        got=f"{got} {'north' if north_m > 0 else 'south'} of where the other landmarks' camera sees it",
        expected="places of one datum and projection",
        hint="convert them to one coordinate reference system",
    )


def _swapped(found: EvidenceFile, state: State, strays: Sequence[_Stray]) -> InputError | None:
    """Two strays that have each other's pixel."""
    for first, second in combinations(strays, 2):
        pixels = reproject(state.camera, state.position_m, state.rotation, np.stack([first.place_m, second.place_m]))
        one, other = pixels.pixels_px
        if (
            math.dist(one, second.landmark.pixel) <= second.near_px
            and math.dist(other, first.landmark.pixel) <= first.near_px
        ):
            return InputError(
                f"{first.stated.label} and {second.stated.label} look interchanged",
                where=found.path,
                got=f"{first.landmark.name} where {second.landmark.name} is seen, and the other way round",
                expected="each at its own pixel",
                hint="swap the two pixels",
            )
    return None


def _height_seen(state: State, stray: _Stray) -> float:
    """Height at which the pixel's ray passes the landmark's vertical, m; NaN where it points away from it."""
    ray = state.rotation @ rays_from_pixels(state.camera, np.array(stray.landmark.pixel))
    away = stray.place_m[:2] - state.position_m[:2]
    along = float(away @ ray[:2] / (ray[:2] @ ray[:2]))
    return float(state.position_m[2] + along * ray[2]) if along > 0 else math.nan


def _all_near(state: State, strays: Sequence[_Stray], places_m: FloatArray) -> bool:
    """Whether strays are seen at their pixels if they are at these places ``(n, 3)``."""
    pixels = reproject(state.camera, state.position_m, state.rotation, places_m).pixels_px
    return all(
        math.dist(pixel, each.landmark.pixel) <= each.near_px for pixel, each in zip(pixels, strays, strict=True)
    )


def _agree(off_m: FloatArray) -> bool:
    """Whether shifts ``(n, d)`` are finite, equal, and large enough to be one."""
    if not np.all(np.isfinite(off_m)):
        return False
    typical_m = np.median(off_m, axis=0)
    size_m = float(np.linalg.norm(typical_m))
    apart_m = float(np.max(np.linalg.norm(off_m - typical_m, axis=1)))
    return size_m >= _MIN_SHIFT_M and apart_m <= _SAME_M + _SAME * size_m


def _is_behind(state: State, landmark: Landmark) -> bool:
    away = np.array(landmark.position_m, dtype=np.float64) - state.position_m
    return float(state.rotation[:, 2] @ away) <= 0


def _above_horizon(state: State, evidence: Evidence) -> str:
    """Which of a pixel and its place lies above the horizon while the other lies below it; empty if they agree."""
    if isinstance(evidence, Landmark):
        up_m = evidence.position_m[2]
    elif isinstance(evidence, GroundPoint | SlantRange):
        up_m = state.elevation_m
    else:
        return ""
    ray = state.rotation @ rays_from_pixels(state.camera, np.array(evidence.pixel))
    if up_m is None or not np.isfinite(ray[2]):
        return ""
    is_place_above, is_pixel_above = up_m >= float(state.position_m[2]), float(ray[2]) >= 0
    if is_place_above == is_pixel_above:
        return ""
    return "place" if is_place_above else "pixel"


def _names(strays: Sequence[_Stray]) -> str:
    names = [each.landmark.name for each in strays]
    if len(names) > 4:  # noqa: PLR2004 - a sentence, no list
        return f"{', '.join(names[:3])} and {len(names) - 3} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _shown(stated: StatedObservation) -> str:
    pixel = f"pixel [{', '.join(f'{value:.10g}' for value in stated.pixels[0])}]"
    if stated.place is None:
        return pixel
    return f"{pixel} at [{', '.join('?' if value is None else f'{value:.10g}' for value in stated.place)}]"


_MAX_LANDMARKS: Final = 60  # that a reading is tried with
_FOOT_M: Final = 0.3048
_SMALLER: Final = (1.5, 2.0, 3.0, 4.0)
_MAX_LAT, _MAX_LON, _SITE_DEG = 90.0, 180.0, 1.0
_LARGE_M: Final = 1e5
_WEB_MERCATOR: Final = "EPSG:3857"
_PLACE: Final = ("east", "north", "heading")
_POSE: Final = ("east", "north", "height", "tilt", "roll", "heading")
_OWN_PLACE: Final = {"east", "north", "height", "heading", "elevation"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Another reading of an evidence file.

    Attributes:
        what: What is wrong with it then.
        hint: What to do.
        known: The evidence, read so.
        names: The unknowns to solve for.
    """

    what: str
    hint: str
    known: EvidenceSet
    names: tuple[str, ...]


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
    others = {name: prior for name, prior in priors.items() if name not in _OWN_PLACE}
    unknowns = tuple(dict.fromkeys((*expand_groups(names), *(name for name in _PLACE if name in priors))))
    for what, hint, places_m in _other_places(found.frame, points.places):
        if np.all(np.isfinite(places_m)):
            evidence = (*points.at(points.pixels, places_m), *points.others)
            yield Reading(what=what, hint=hint, known=EvidenceSet(evidence=evidence, priors=others), names=unknowns)
    here_m = found.frame.local_m(points.places)
    for what, hint, pixels in _other_pixels(points.pixels, camera):
        if in_image(camera, pixels).all():
            known = EvidenceSet(evidence=points.at(pixels, here_m), priors=priors)
            yield Reading(what=what, hint=hint, known=known, names=names)


def columns_swapped(points: CompleteLandmarks, camera: Camera) -> Reading | None:
    """Pixels as places and places as pixels; None where no place could be a pixel."""
    if not points.landmarks or not in_image(camera, points.places[:, :2]).all():
        return None
    evidence = points.at(points.places[:, :2], np.column_stack([points.pixels, points.places[:, 2]]))
    what, hint = "pixels and places look interchanged", "swap their columns"
    return Reading(what=what, hint=hint, known=EvidenceSet(evidence=evidence), names=_POSE)


def _other_places(frame: LocalFrame, places: FloatArray) -> Iterator[tuple[str, str, FloatArray]]:
    """Other readings of places: what is wrong, what to do, and places in metres ``(n, 3)``."""
    _, second, height = places.T
    swapped, in_degrees = places[:, [1, 0, 2]], takes_degrees(frame.crs)
    x, y = ("latitude", "longitude") if in_degrees else ("x" if frame.crs == LOCAL else "easting", "northing")
    y = "y" if frame.crs == LOCAL else y
    if not in_degrees or np.all(np.abs(second) <= _MAX_LAT):
        mirrored = replace(frame, origin=(frame.origin[1], frame.origin[0], frame.origin[2]))
        yield (
            f"{x} and {y} of the landmarks look interchanged",
            f"swap {x} and {y}, if the image is not mirrored",
            mirrored.local_m(swapped),
        )
    if frame.crs == LOCAL and np.all(np.ptp(places[:, :2], axis=0) < _SITE_DEG):
        for label, read in (("latitudes and longitudes", places), ("longitudes and latitudes", swapped)):
            lat_lon = read[:, :2]
            if np.all(np.abs(lat_lon) <= (_MAX_LAT, _MAX_LON)) and np.any(np.abs(lat_lon) > 1):
                origin = (float(lat_lon[0, 0]), float(lat_lon[0, 1]), float(np.median(height)))
                hint = 'write lat_deg, lon_deg and alt_m, with crs = "geo"'
                yield f"the landmarks' places look like {label}", hint, LocalFrame(GEO, origin).local_m(read)
    if frame.crs == LOCAL and np.all(np.abs(places[0, :2]) > _LARGE_M):
        mercator = replace(frame, crs=_WEB_MERCATOR)
        hint = f'write crs = "{_WEB_MERCATOR}"'
        yield "the landmarks' places look like those of a web map", hint, mercator.local_m(places)
    elif frame.crs != LOCAL and not in_degrees:
        hint = "check crs"
        yield f"the landmarks' places do not look like {frame.crs}", hint, replace(frame, crs=LOCAL).local_m(places)
    for label, hint, scale in (
        ("depths, counted downwards", "change their signs", -1.0),
        ("feet", "convert them to metres", _FOOT_M),
    ):
        yield f"the landmarks' heights look like {label}", hint, frame.local_m(places * [1.0, 1.0, scale])


def _other_pixels(pixels: FloatArray, camera: Camera) -> Iterator[tuple[str, str, FloatArray]]:
    """Other readings of pixels: what is wrong, what to do, pixels ``(n, 2)``, maybe outside of the image."""
    yield "u and v look interchanged", "give u (across) before v (down)", pixels[:, ::-1]
    u, v = pixels.T
    flipped = np.column_stack([u, camera.height_px - 1 - v])
    yield "v looks as if counted from the bottom of the image", "count v from the top", flipped
    for step, where in ((1, "next"), (-1, "previous")):
        if len(pixels) > 1:
            what = f"each pixel looks as if it belonged to the {where} landmark"
            yield what, "check that the rows of pixels and places match", np.roll(pixels, step, axis=0)
    for share in _SMALLER:
        width_px, height_px = round(camera.width_px / share), round(camera.height_px / share)
        what = f"the pixels look like those of an image of {width_px} x {height_px}"
        hint = f"read them in an image of {camera.width_px} x {camera.height_px}, or take that mode's camera file"
        yield what, hint, share * (pixels + 0.5) - 0.5


_DOUBT: Final = 3.0  # how many times as large as stated residuals may be without a look for the cause
_BETTER: Final = 4.0  # by how much another reading must fit better
_ROUGH: Final = 10.0  # what a reading that fits may leave, in stated stds, which people state too small
_MIN_DOF: Final = 2  # degrees of freedom: with none, anything fits
_MAX_REJECTED: Final = 0.2
_MAX_UNSEEN: Final = 0.4  # share of rejected observations, above which it is the camera that is wrong
_MAX_ROLL_DEG, _MAX_TILT_DEG = 60.0, 120.0
_WIDER, _PRECISER = 3.0, 10.0  # by which swapped columns are wider apart, and fit better for their width
_PRIOR_STDS: Final = 6.0
_GAP_M: Final = 10.0
_GROUP_OF: Final = {"east": "position", "north": "position"}

_SIMILAR: Final = 0.05
_DATUM_M: Final = (10.0, 120.0)  # by how much heights above the ellipsoid and above the sea differ
_NEAR_M: Final = 2000.0
_ANGLES: Final = {"tilt", "roll", "heading"}
_FULL_TURN: Final = {"roll", "heading"}
_MILLIMETRES: Final = 0.1  # of the focal length in pixels, below which a number is in millimetres


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """A calibration that may not fit.

    Attributes:
        evidence: The file of evidence.
        camera: The camera file's camera.
        names: The unknowns that it was asked for.
        model: Projection model.
        result: What it found.
    """

    evidence: EvidenceFile
    camera: Camera
    names: tuple[str, ...]
    model: ProjectionModel
    result: Result

    def variant(self, known: EvidenceSet, names: tuple[str, ...]) -> Result | None:
        """A calibration of other evidence; None where there is none, or none with a camera that hangs well."""
        try:
            result = calibrate(known, self.camera, tuple(dict.fromkeys(names)), self.model)
        except ValueError:
            return None
        tilt_deg, roll_deg, _ = angles_deg(result.solution.state)
        is_sound = result.weakest.is_determined and result.solution.dof >= _MIN_DOF
        is_upright = abs(roll_deg) <= _MAX_ROLL_DEG and tilt_deg <= _MAX_TILT_DEG
        is_one = np.count_nonzero(~result.solution.kept) <= _MAX_REJECTED * len(result.solution.kept)
        return result if is_sound and is_upright and is_one and misfit(result) <= _ROUGH else None

    def is_better(self, variant: Result) -> bool:
        """Whether a variant fits so much better than what was found that it cannot be chance."""
        return _BETTER * max(misfit(variant), 1.0) <= misfit(self.result)


def misfit(result: Result) -> float:
    """Residual that four fifths of the observations stay below, in stated stds."""
    each = [left.sigma if math.isfinite(left.sigma) else OUT_OF_SIGHT for left in result.left]
    return float(np.quantile(each, 1 - _MAX_REJECTED)) if each else 0.0


def likely_mistake(attempt: Attempt) -> AerodftError | None:
    """The likely mistake in evidence that does not fit; None where it fits, or where nothing explains it.

    Returns:
        An :class:`InputError` that names it; :class:`NotDetermined` where unknowns are missing that nobody stated.
    """
    swapped = _swapped_columns(attempt)
    if swapped is not None:
        return swapped
    solution = attempt.result.solution
    priors = solution.residuals.values[solution.residuals.owner < 0]
    is_pulled = bool(np.any(np.abs(priors) > _PRIOR_STDS))
    if solution.misfit <= _DOUBT and np.all(solution.kept) and not is_pulled:
        return None
    searches: tuple[Callable[[Attempt], AerodftError | None], ...] = (
        _missing_unknowns,
        _wrong_prior,
        _landmark_group,
        _other_reading,
        _other_zoom,
    )
    for search in searches:
        if error := search(attempt):
            return error
    rejected = np.count_nonzero(~solution.kept)
    return unseen_error(attempt.evidence, attempt.result) if rejected <= _MAX_UNSEEN * len(solution.kept) else None


def _swapped_columns(attempt: Attempt) -> InputError | None:
    """Swapped pixels and places, also where both ways fit: few pixels close together fit whatever is wide."""
    landmarks = CompleteLandmarks.from_file(attempt.evidence)
    reading = columns_swapped(landmarks, attempt.camera)
    if reading is None:
        return None
    narrow, wide = (float(np.max(np.ptp(each, axis=0))) for each in (landmarks.pixels, landmarks.places[:, :2]))
    if wide < _WIDER * narrow:
        return None
    found, result = attempt.variant(reading.known, reading.names), attempt.result
    if found is None or not found.rms_px or _PRECISER * found.rms_px / wide > (result.rms_px or 0.0) / narrow:
        return None
    return _reading_error(attempt, reading, found)


def _missing_unknowns(attempt: Attempt) -> NotDetermined | None:
    """Unknowns that were neither asked for nor stated, and therefore taken as 0."""
    known = attempt.evidence.known
    stated = {*expand_groups(attempt.names), *known.priors}
    level = ("roll",) if attempt.model is ProjectionModel.DFT else ()
    missing = [name for name in _POSE if name not in stated and name not in level]
    if not missing or not any(isinstance(each, Landmark) for each in known.evidence):
        return None
    variant = attempt.variant(known, (*attempt.names, *missing))
    if variant is None or not attempt.is_better(variant):
        return None
    more = list(dict.fromkeys(_GROUP_OF.get(name, name) for name in missing))
    every = ",".join(dict.fromkeys((*attempt.names, *more)))
    return NotDetermined(
        "no calibration",
        where=attempt.evidence.path,
        got=f"neither {' nor '.join(more)} stated or asked for",
        expected=f"`unknowns` {every}, with which all fits{_fit(variant)}",
    )


def _wrong_prior(attempt: Attempt) -> InputError | None:
    """A stated number of the camera that all observations contradict."""
    known, worst = attempt.evidence.known, None
    for names in _prior_groups(known, attempt.names):
        others = {name: prior for name, prior in known.priors.items() if name not in names}
        variant = attempt.variant(EvidenceSet(evidence=known.evidence, priors=others), (*attempt.names, *names))
        if variant is None or (worst is not None and misfit(variant) >= misfit(worst.variant)):
            continue
        suspect = _SuspectPrior(attempt.evidence, {name: known.priors[name] for name in names}, variant)
        if suspect.stds_off() > _PRIOR_STDS:
            worst = suspect
    return None if worst is None else worst.error()


def _prior_groups(known: EvidenceSet, unknowns: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    stated = [name for name, prior in known.priors.items() if prior.std > 0 or name not in expand_groups(unknowns)]
    if "elevation" in stated:
        stated.remove("elevation")  # alone, landmarks do not tell it
    if place := tuple(name for name in ("east", "north") if name in stated):
        yield place
    yield from ((name,) for name in stated if name not in place)


def _landmark_group(attempt: Attempt) -> InputError | None:
    """Rejected landmarks that agree among themselves, or of which those at other heights agree without the rest."""
    if error := common_error(attempt.evidence, attempt.result):
        return error
    known = attempt.evidence.known
    ups_m = np.array([each.position_m[2] if isinstance(each, Landmark) else None for each in known.evidence], float)
    heights_m = np.sort(ups_m[np.isfinite(ups_m)])
    gaps_m = np.diff(heights_m)
    if not len(gaps_m) or np.max(gaps_m) < _GAP_M:
        return None
    is_low = np.isnan(ups_m) | (ups_m <= heights_m[int(np.argmax(gaps_m))])
    for used in (is_low, np.isnan(ups_m) | ~is_low):
        evidence = tuple(each for each, is_used in zip(known.evidence, used, strict=True) if is_used)
        variant = attempt.variant(replace(known, evidence=evidence), attempt.names)
        if variant is None:
            continue
        kept = used.copy()  # what the variant has not seen counts as rejected
        kept[used] = variant.solution.kept
        whole = replace(variant, solution=replace(variant.solution, kept=kept))
        if error := common_error(attempt.evidence, whole):
            return error
    return None


def _other_reading(attempt: Attempt) -> InputError | None:
    for reading in alternative_readings(attempt.evidence, attempt.camera, attempt.names):
        variant = attempt.variant(reading.known, reading.names)
        if variant is not None and attempt.is_better(variant):
            return _reading_error(attempt, reading, variant)
    return None


def _other_zoom(attempt: Attempt) -> InputError | None:
    """Error where another focal length than the camera file's fits; None where none does."""
    if {"focal", "fx", "fy"} & {*attempt.names, *attempt.evidence.known.priors}:
        return None
    variant = attempt.variant(attempt.evidence.known, (*attempt.names, "focal"))
    if variant is None or not attempt.is_better(variant):
        return None
    index = variant.names.index("focal")
    std_px = math.sqrt(variant.named_covariance[index, index])
    if abs(variant.camera.fx_px - attempt.camera.fx_px) <= _PRIOR_STDS * std_px:
        return None
    return InputError(
        "the image is not of this camera's mode",
        where=attempt.evidence.path,
        got=f"a focal length of {variant.camera.fx_px:.0f} px, with which all fits{_fit(variant)}",
        expected=f'{attempt.camera.fx_px:.0f} px, as camera "{attempt.camera.name}" has',
        hint="take the camera file of the zoom and crop that the image was taken with, or add focal to `unknowns`",
    )


def _reading_error(attempt: Attempt, reading: Reading, variant: Result) -> InputError:
    got = "" if attempt.result.rms_px is None else f"residuals of {misfit(attempt.result):.0f} times the stated stds"
    hint = f"{reading.hint}: then all fits{_fit(variant)}"
    return InputError(reading.what, where=attempt.evidence.path, got=got, hint=hint)


def _fit(variant: Result) -> str:
    return "" if variant.rms_px is None else f" to {variant.rms_px:.1f} px"


@dataclass(frozen=True, slots=True, eq=False)
class _SuspectPrior:
    """A stated prior of one unknown or of the place, and the calibration without it."""

    evidence: EvidenceFile
    priors: dict[str, Prior]
    variant: Result

    def off(self, name: str) -> float:
        """Stated less fitted value, SI."""
        off = self.priors[name].value - self.variant.solution.state.value(name)
        return math.remainder(off, 2 * math.pi) if name in _FULL_TURN else off

    def stds_off(self) -> float:
        """Distance of stated and fitted value, in standard deviations of their difference."""
        variances = dict(zip(self.variant.names, np.diag(self.variant.solution.covariance), strict=True))
        return max(
            abs(self.off(name)) / math.sqrt(prior.std**2 + variances[name]) for name, prior in self.priors.items()
        )

    def error(self) -> InputError:
        """Error that names the stated value, the fitting one, and what to do."""
        state, name = self.variant.solution.state, next(iter(self.priors))
        if name in _GROUP_OF:
            stated_m = state.position_m.copy()
            for axis, key in enumerate(("east", "north")):
                if key in self.priors:
                    stated_m[axis] = self.priors[key].value
            key, stated, seen = "position", self._place(stated_m), self._place(state.position_m)
        else:
            key, scale = display_unit(name)
            prior = self.priors[name]
            spread = f" +- {scale * prior.std:.3g}" if prior.std else ""
            stated, seen = f"{scale * prior.value:.6g}{spread}", f"{scale * state.value(name):.6g}"
        return InputError(
            f"the camera's {key} contradicts the observations",
            where=self.evidence.path,
            got=stated,
            expected=f"about {seen}, as all fits without it",
            hint=self._advice(name),
        )

    def _place(self, place_m: FloatArray) -> str:
        """East and north, in the file's coordinates."""
        east_north = self.evidence.frame.file_coordinates(place_m)[:2]
        return f"[{', '.join(f'{value:.10g}' for value in east_north)}]"

    def _advice(self, name: str) -> str:
        prior, found = self.priors[name], self.variant.solution.state.value(name)
        is_map, off_m = self.evidence.frame.crs != LOCAL, max(abs(self.off(each)) for each in self.priors)
        below_rad = abs(math.pi / 2 - prior.value - found)
        cases = (
            (name in _ANGLES and _is_close(math.degrees(prior.value), found), "it looks like radians: write degrees"),
            (
                name == "tilt" and below_rad <= 3 * prior.std + math.radians(1.0),
                "it looks like an angle below the horizon: tilt counts from straight down",
            ),
            (name == "height" and _is_close(prior.value * _FOOT_M, found), "it looks like feet: write metres"),
            (
                name == "height" and is_map and _DATUM_M[0] <= off_m <= _DATUM_M[1],
                "are heights of two datums mixed, above the ellipsoid and above the sea?",
            ),
            (name == "focal" and prior.value <= _MILLIMETRES * found, "it looks like millimetres: write pixels"),
            (name in _GROUP_OF and is_map and off_m <= _NEAR_M, "are places of two datums or projections mixed?"),
        )
        return next((advice for is_so, advice in cases if is_so), "correct it, or state a larger std")


def _is_close(value: float, other: float) -> bool:
    return abs(value - other) <= _SIMILAR * abs(other)
