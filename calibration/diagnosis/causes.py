"""Why evidence does not fit: every likely mistake is tried by solving with it."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.adapters.config import LOCAL
from aerodft.adapters.config.evidence import EvidenceFile
from aerodft.errors import AerodftError, InputError, NotDetermined
from aerodft.model import Camera, EvidenceSet, FloatArray, Landmark, Prior, ProjectionModel
from calibration.diagnosis.readings import (
    FOOT_M,
    POSE,
    CompleteLandmarks,
    Reading,
    alternative_readings,
    columns_swapped,
)
from calibration.diagnosis.strays import common_error, unseen_error
from calibration.pose import OUT_OF_SIGHT, Result, angles_deg, calibrate, display_unit, expand_groups

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
    missing = [name for name in POSE if name not in stated and name not in level]
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
            (name == "height" and _is_close(prior.value * FOOT_M, found), "it looks like feet: write metres"),
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
