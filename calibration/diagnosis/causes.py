"""Why evidence does not fit: every likely mistake is tried by solving with it."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.adapters.config import LOCAL
from aerodft.adapters.config.evidence import EvidenceFile
from aerodft.errors import AerodftError, InputError, NotDetermined
from aerodft.model import Camera, Evidence, EvidenceSet, FloatArray, Landmark, Prior, ProjectionModel
from calibration.diagnosis.matching import other_order
from calibration.diagnosis.readings import (
    FOOT_M,
    MIRROR,
    MIRRORED_IMAGE,
    ORDER,
    POSE,
    CompleteLandmarks,
    Reading,
    alternative_readings,
    columns_swapped,
)
from calibration.diagnosis.strays import INTERCHANGED, common_error, unseen_error
from calibration.pose import (
    OUT_OF_SIGHT,
    Result,
    angles_deg,
    calibrate,
    display_unit,
    expand_groups,
    possible_coefficients,
)

_DOUBTFUL_P_VALUE: Final = 1e-3
"""Probability of larger residuals, if stated stds are true, below which a cause is looked for, for some seconds.
At 1e-9 heights in feet pass with residuals of 2.3 times the stated stds, and the height is 11 std off."""
_BETTER: Final = 14.0
"""Twice the log odds (e^7 = 1,100) by which a cause must be likelier than the file as it is, and than other causes."""
_FEW_PX: Final = 5.0  # residual (rms) of careless clicks: an unexplained larger one is no fit without a mistake
_MAX_NAMED: Final = 3  # landmarks in a sentence
_MAX_LEFT_OUT: Final = 20  # landmarks that are left out in turn; one of more does little harm
_NUMBERS_OF_PIXEL: Final = 2
_SAME_HEIGHT_M: Final = 1e-3  # chosen: no survey's heights agree by chance to a millimetre
_UNKNOWN_PENALTY: Final = 10.0
"""Twice the log odds of a parameter that a cause leaves open: its std is about 1/150 of what it might have been."""
_MOST_BENDS: Final = 2  # coefficients of another lens that are looked for; more would fit mistaken pixels
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
_LENS: Final = "lens"
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

    def variant(self, known: EvidenceSet, names: tuple[str, ...], camera: Camera | None = None) -> Result | None:
        """A calibration of other evidence; None where there is none, or none with a camera that hangs well.

        Args:
            known: The evidence.
            names: The unknowns.
            camera: Another camera than the file's.
        """
        try:
            unique = tuple(dict.fromkeys(names))
            result = calibrate(known, camera or self.camera, unique, self.model, is_quick=True)
        except ValueError:
            return None
        tilt_deg, roll_deg, _ = angles_deg(result.solution.state)
        is_sound = result.weakest.is_determined and result.solution.dof >= _MIN_DOF
        is_upright = abs(roll_deg) <= _MAX_ROLL_DEG and tilt_deg <= _MAX_TILT_DEG
        is_one = np.count_nonzero(~result.solution.kept) <= _MAX_REJECTED * len(result.solution.kept)
        fits = result.is_near and (result.solution.is_explained or result.kept_rms_px <= _FEW_PX)
        return result if is_sound and is_upright and is_one and fits else None

    def with_instead(self, index: int, *instead: Evidence) -> Result | None:
        """A variant with other observations, or none, in place of one."""
        known = self.evidence.known
        changed = (*known.evidence[:index], *instead, *known.evidence[index + 1 :])
        return self.variant(replace(known, evidence=changed), self.names)

    @property
    def surprise(self) -> float:
        """Twice the negative log likelihood of the file as it is."""
        return self.result.solution.neg_log_likelihood


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """A likely mistake.

    Attributes:
        kind: Causes of one kind may fit alike.
        error: What it is.
        surprise: Twice the negative log likelihood of the observations without the mistake.
    """

    kind: str
    error: AerodftError
    surprise: float


def misfit(result: Result) -> float:
    """Residual that four fifths of the observations stay below, in stated stds."""
    each = [left.sigma if math.isfinite(left.sigma) else OUT_OF_SIGHT for left in result.left]
    return float(np.quantile(each, 1 - _MAX_REJECTED)) if each else 0.0


def likely_mistake(attempt: Attempt) -> AerodftError | None:
    """The likely mistake in evidence that does not fit; None where it fits, or where nothing explains it.

    A cause is named where everything fits without it, far better than with any other cause.

    Returns:
        An :class:`InputError` that names it; :class:`NotDetermined` where unknowns are missing that nobody stated.
    """
    swapped = _swapped_columns(attempt)
    if swapped is not None:
        return swapped
    solution = attempt.result.solution
    is_likely = solution.p_value is None or solution.p_value >= _DOUBTFUL_P_VALUE
    if is_likely and np.all(solution.kept) and not attempt.result.is_pulled and attempt.result.is_consistent:
        return None
    if missing := _missing_unknowns(attempt):
        return missing
    causes = [cause for search in _SEARCHES for cause in search(attempt)]
    if error := _named(attempt, causes):
        return error
    rejected = np.count_nonzero(~solution.kept)
    return unseen_error(attempt.evidence, attempt.result) if rejected <= _MAX_UNSEEN * len(solution.kept) else None


def _named(attempt: Attempt, causes: Sequence[Cause]) -> AerodftError | None:
    """The error of the cause that is far likelier than all others and than none; None where there is no such cause."""
    if not causes:
        return None
    least = min(cause.surprise for cause in causes)
    likely = [cause for cause in causes if cause.surprise < least + _BETTER]
    if least + _BETTER > attempt.surprise:
        return None
    if len({cause.kind for cause in likely}) > 1:
        return _one_of_several(attempt) if attempt.result.is_consistent else None
    if likely[0].kind == MIRROR and len(likely) > 1 and not _is_said_by_first(likely):
        return InputError(
            "the landmarks are seen as in a mirror",
            where=attempt.evidence.path,
            got="; ".join(cause.error.what for cause in likely),
            expected="the image as the camera took it, and u, v and places in their order",
            hint="check which of these it is: each fits",
        )
    return likely[0].error


def _one_of_several(attempt: Attempt) -> NotDetermined:
    """The refusal of evidence that fits as it is, but far better without one of several mistakes."""
    scale = f"{attempt.result.solution.misfit:.3g} times as large as the stated stds"
    return NotDetermined(
        "no calibration",
        where=attempt.evidence.path,
        got=f"residuals {scale}, which more than one mistake would explain",
        expected="residuals as large as the stated stds",
        hint="check the heights, the pixels, the order of the landmarks and the camera file",
    )


def _is_said_by_first(mirrored: Sequence[Cause]) -> bool:
    """Whether the first of several mirror images says what the others are: a mirrored image itself."""
    return all(cause.error.what == MIRRORED_IMAGE for cause in mirrored[1:])


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
    missing = [name for name in POSE if name not in stated and name not in level]
    if not missing or not any(isinstance(each, Landmark) for each in known.evidence):
        return None
    variant = attempt.variant(known, (*attempt.names, *missing))
    if variant is None or _surprise(variant, len(missing)) + _BETTER > attempt.surprise:
        return None
    more = list(dict.fromkeys(_GROUP_OF.get(name, name) for name in missing))
    every = ",".join(dict.fromkeys((*attempt.names, *more)))
    return NotDetermined(
        "no calibration",
        where=attempt.evidence.path,
        got=f"neither {' nor '.join(more)} stated or asked for",
        expected=f"`unknowns` {every}, with which all fits{_fit(variant)}",
    )


def _wrong_priors(attempt: Attempt) -> Iterator[Cause]:
    """Stated numbers of the camera that all observations contradict."""
    known = attempt.evidence.known
    for names in _prior_groups(known, attempt.names):
        others = {name: prior for name, prior in known.priors.items() if name not in names}
        variant = attempt.variant(EvidenceSet(evidence=known.evidence, priors=others), (*attempt.names, *names))
        if variant is None:
            continue
        suspect = _SuspectPrior(attempt.evidence, {name: known.priors[name] for name in names}, variant)
        if suspect.stds_off() > _PRIOR_STDS:
            yield Cause(names[0], suspect.error(), _surprise(variant, len(names)))


def _prior_groups(known: EvidenceSet, unknowns: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    stated = [name for name, prior in known.priors.items() if prior.std > 0 or name not in expand_groups(unknowns)]
    if "elevation" in stated:
        stated.remove("elevation")  # alone, landmarks do not tell it
    if place := tuple(name for name in ("east", "north") if name in stated):
        yield place
    yield from ((name,) for name in stated if name not in place)


def _landmark_group(attempt: Attempt) -> Iterator[Cause]:
    """Rejected landmarks that agree among themselves, or of which those at other heights agree without the rest."""
    if error := common_error(attempt.evidence, attempt.result):
        yield Cause(_kind_of_strays(error), error, _surprise_of_kept(attempt.result))
        return
    known = attempt.evidence.known
    ups_m = np.array([each.position_m[2] if isinstance(each, Landmark) else None for each in known.evidence], float)
    heights_m = np.sort(ups_m[np.isfinite(ups_m)])
    gaps_m = np.diff(heights_m)
    if not len(gaps_m) or np.max(gaps_m) < _GAP_M:
        return
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
            yield Cause(_kind_of_strays(error), error, _surprise_of_kept(variant))
            return


def _kind_of_strays(error: InputError) -> str:
    return ORDER if INTERCHANGED in error.what else error.what


def _other_readings(attempt: Attempt) -> Iterator[Cause]:
    """Other readings of the file that fit."""
    for reading in alternative_readings(attempt.evidence, attempt.camera, attempt.names):
        variant = attempt.variant(reading.known, reading.names)
        if variant is not None:
            yield Cause(
                reading.kind,
                _reading_error(attempt, reading, variant),
                _surprise(variant) + reading.dropped * (_UNKNOWN_PENALTY + _BETTER),
            )


def _other_zoom(attempt: Attempt) -> Iterator[Cause]:
    """Another focal length than the camera file's that fits."""
    if {"focal", "fx", "fy"} & {*attempt.names, *attempt.evidence.known.priors}:
        return
    variant = attempt.variant(attempt.evidence.known, (*attempt.names, "focal"))
    if variant is None:
        return
    index = variant.names.index("focal")
    std_px = math.sqrt(variant.named_covariance[index, index])
    if abs(variant.camera.fx_px - attempt.camera.fx_px) <= _PRIOR_STDS * std_px:
        return
    error = InputError(
        "the image is not of this camera's mode",
        where=attempt.evidence.path,
        got=f"a focal length of {variant.camera.fx_px:.0f} px, with which all fits{_fit(variant)}",
        expected=f'{attempt.camera.fx_px:.0f} px, as camera "{attempt.camera.name}" has',
        hint="take the camera file of the zoom and crop that the image was taken with, or add focal to `unknowns`",
    )
    yield Cause(_LENS, error, _surprise(variant, 1))


def _surprise(variant: Result, more: int = 0) -> float:
    """Twice the negative log likelihood of a calibration with so many unknowns more than were asked for."""
    return variant.solution.neg_log_likelihood + _UNKNOWN_PENALTY * more


def _surprise_of_kept(result: Result) -> float:
    """Twice the negative log likelihood of the observations used, where the others are one mistake of one number."""
    solution = result.solution
    return solution.neg_log_likelihood_of_kept + _UNKNOWN_PENALTY


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
            (name == "height" and _is_close(prior.value * FOOT_M, found), "it looks like feet: write metres"),
            (
                name == "height" and is_map and _DATUM_M[0] <= off_m <= _DATUM_M[1],
                "are heights of two datums mixed, above the ellipsoid and above the sea?",
            ),
            (name == "focal" and prior.value <= _MILLIMETRES * found, "it looks like millimetres: write pixels"),
            (name in _GROUP_OF and is_map and off_m <= _NEAR_M, "are places of two datums or projections mixed?"),
        )
        return next((advice for is_so, advice in cases if is_so), "correct it, or state a larger std")


def _one_landmark(attempt: Attempt) -> Iterator[Cause]:
    """Landmarks without which all others fit as stated, or that do if one number of their place is left open.

    One number left open fits no better than a landmark left out: where that explains nothing, no number is tried.
    Heights that are all equal may be missing ones, which a tall landmark alone contradicts: then both are said.
    """
    heights_m = CompleteLandmarks.from_file(attempt.evidence).places[:, 2:]
    suspicion, hint = "", "correct its pixel or its place, or remove it"
    if heights_m.size and np.ptp(heights_m) < _SAME_HEIGHT_M:
        suspicion = ", or their heights, all equal, are not true"
        hint = f"state the landmarks' own heights; if all are on level ground, {hint}"
    evidence, kept = attempt.evidence, attempt.result.solution.kept
    for index in np.flatnonzero(kept).tolist() if np.count_nonzero(kept) <= _MAX_LEFT_OUT else ():
        landmark, stated = evidence.known.evidence[index], evidence.stated[index]
        if not isinstance(landmark, Landmark) or None in landmark.position_m:
            continue
        removed = attempt.with_instead(index)
        if removed is None or _surprise(removed, 1) >= attempt.surprise:
            continue
        east_m, north_m, up_m = landmark.position_m
        places = ((None, north_m, up_m), (east_m, None, up_m), (east_m, north_m, None))
        opened = [attempt.with_instead(index, replace(landmark, position_m=place)) for place in places]
        for variant, numbers in ((removed, _NUMBERS_OF_PIXEL), *((each, 1) for each in opened)):
            if variant is None or not variant.solution.is_explained:
                continue
            error = InputError(
                f"{stated.label}: pixel or place contradicts the other landmarks{suspicion}",
                where=evidence.path,
                got=f"{landmark.name}, without which all fits{_fit(variant)}",
                expected="the place that is seen at its pixel",
                hint=hint,
            )
            yield Cause(stated.label, error, _surprise(variant, numbers))


def _other_order(attempt: Attempt) -> Iterator[Cause]:
    """Pixels that belong to other landmarks than the file says."""
    points = CompleteLandmarks.from_file(attempt.evidence)
    places_m = attempt.evidence.frame.local_m(points.places)
    order = other_order(places_m, points.pixels, attempt.camera) if attempt.model is ProjectionModel.PINHOLE else None
    if order is None or np.array_equal(order, np.arange(len(order))):
        return
    evidence = (*points.at(points.pixels[order], places_m), *points.others)
    variant = attempt.variant(EvidenceSet(evidence=evidence, priors=attempt.evidence.known.priors), attempt.names)
    if variant is None:
        return
    names = [each.name for each in points.landmarks]
    moved = [
        f"{names[index]} where {name} is seen" for name, index in zip(names, order, strict=True) if names[index] != name
    ]
    error = InputError(
        "pixels and names of landmarks do not belong together",
        where=attempt.evidence.path,
        got=f"{', '.join(moved[:_MAX_NAMED])}{', ...' if len(moved) > _MAX_NAMED else ''}",
        expected="each landmark at its own pixel",
        hint=f"check the order of both lists: in another order all fits{_fit(variant)}",
    )
    yield Cause(ORDER, error, _surprise(variant))


def _other_lens(attempt: Attempt) -> Iterator[Cause]:
    """Another focal length and another distortion than the camera file's that fit."""
    bends = possible_coefficients(attempt.camera)[:_MOST_BENDS]
    lens_names = ("focal", *bends)
    taken = {*expand_groups(attempt.names), *attempt.evidence.known.priors}
    if {"fx", "fy", *possible_coefficients(attempt.camera), "focal"} & taken or attempt.model is ProjectionModel.DFT:
        return
    variant = attempt.variant(attempt.evidence.known, (*attempt.names, *lens_names))
    if variant is None:
        return
    values = zip(bends, variant.camera.distortion, strict=False)
    *lens, last = (f"{variant.camera.fx_px:.0f} px", *(f"{name} {value:.3g}" for name, value in values))
    error = InputError(
        "the image is not of this camera's lens",
        where=attempt.evidence.path,
        got=f"a focal length of {', '.join(lens)} and {last}, with which all fits{_fit(variant)}",
        expected=f'the lens of camera "{attempt.camera.name}"',
        hint=f"take the camera file of the lens and mode of the image, or add {','.join(lens_names)} to `unknowns`",
    )
    yield Cause(_LENS, error, _surprise(variant, len(lens_names)))


_SEARCHES: Final[tuple[Callable[[Attempt], Iterator[Cause]], ...]] = (
    _wrong_priors,
    _landmark_group,
    _one_landmark,
    _other_readings,
    _other_order,
    _other_zoom,
    _other_lens,
)


def _is_close(value: float, other: float) -> bool:
    return abs(value - other) <= _SIMILAR * abs(other)
