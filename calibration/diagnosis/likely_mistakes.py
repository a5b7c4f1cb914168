"""Why evidence does not fit: every likely mistake is tried by solving without it, and named where that fits."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.adapters.config import LOCAL
from aerodft.adapters.config.evidence import EvidenceFile
from calibration.diagnosis.landmark_groups import group_error, unseen_error
from calibration.diagnosis.alternative_readings import Points, Reading, columns_swapped, readings
from aerodft.errors import AerodftError, InputError, NoAnswerError
from aerodft.model import Camera, EvidenceSet, FloatArray, Landmark, Prior, ProjectionModel
from calibration.pose import OUT_OF_SIGHT, Result, angles_deg, calibrate, expanded, said

_DOUBT: Final = 3.0  # how many times as large as stated residuals may be without a look for the cause
_BETTER: Final = 4.0  # by how much another reading must fit better
_ROUGH: Final = 10.0  # what a reading that fits may leave, in stated stds, which people state too small
_FEWEST_TO_SPARE: Final = 2  # degrees of freedom: with none, anything fits
_MOST_LEFT_OUT: Final = 0.2
_MOST_UNSEEN: Final = 0.4  # share of what was left out, above which it is the camera that is wrong
_MOST_ROLL_DEG, _MOST_TILT_DEG = 60.0, 120.0
_WIDER, _PRECISER = 3.0, 10.0  # by which swapped columns are wider apart, and fit better for their width
_PRIOR_STDS: Final = 6.0
_GAP_M: Final = 10.0
_POSE: Final = ("east", "north", "height", "tilt", "roll", "heading")
_SAID: Final = {"east": "position", "north": "position"}

_FOOT_M: Final = 0.3048
_ALIKE: Final = 0.05
_DATUM_M: Final = (10.0, 120.0)  # by how much heights above the ellipsoid and above the sea differ
_NEAR_M: Final = 2000.0
_ANGLES: Final = {"tilt", "roll", "heading"}
_TURNED: Final = {"roll", "heading"}
_MILLIMETRES: Final = 0.1  # of the focal length in pixels, below which a number is none


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """A calibration: what it was asked, and what it found."""

    found: EvidenceFile
    camera: Camera
    names: tuple[str, ...]
    model: ProjectionModel
    result: Result

    def trial(self, known: EvidenceSet, names: tuple[str, ...]) -> Result | None:
        """Another calibration; None where it cannot be asked, or tells nothing, or gives no camera that hangs well."""
        try:
            result = calibrate(known, self.camera, tuple(dict.fromkeys(names)), self.model)
        except ValueError:
            return None
        tilt_deg, roll_deg, _ = angles_deg(result.solution.state)
        is_sound = result.weakest.is_determined and result.solution.dof >= _FEWEST_TO_SPARE
        is_upright = abs(roll_deg) <= _MOST_ROLL_DEG and tilt_deg <= _MOST_TILT_DEG
        is_one = np.count_nonzero(~result.solution.kept) <= _MOST_LEFT_OUT * len(result.solution.kept)
        return result if is_sound and is_upright and is_one and misfit(result) <= _ROUGH else None

    def is_better(self, trial: Result) -> bool:
        """Whether a trial fits so much better than what was found that it cannot be chance."""
        return _BETTER * max(misfit(trial), 1.0) <= misfit(self.result)


def misfit(result: Result) -> float:
    """What four fifths of the observations are off by at most, in stated stds."""
    each = [left.sigma if math.isfinite(left.sigma) else OUT_OF_SIGHT for left in result.left]
    return float(np.quantile(each, 1 - _MOST_LEFT_OUT)) if each else 0.0


def cause_of_misfit(asked: Asked) -> AerodftError | None:
    """What is wrong with evidence that does not fit; None where it does, or where nothing explains it.

    Returns:
        An :class:`InputError` that names it; a :class:`NoAnswerError` where unknowns are missing that nobody stated.
    """
    swapped = _swapped_columns(asked)
    if swapped is not None:
        return swapped
    solution = asked.result.solution
    if solution.scaled <= _DOUBT and np.all(solution.kept) and not _is_pulled(asked.result):
        return None
    looks: tuple[Callable[[Asked], AerodftError | None], ...] = (_unasked, _prior, _groups, _reading, _zoom)
    for look in looks:
        if error := look(asked):
            return error
    left_out = np.count_nonzero(~solution.kept)
    return unseen_error(asked.found, asked.result) if left_out <= _MOST_UNSEEN * len(solution.kept) else None


def _is_pulled(result: Result) -> bool:
    """Whether a prior is far from where the observations put it."""
    residuals = result.solution.residuals
    return bool(np.any(np.abs(residuals.values[residuals.owner < 0]) > _PRIOR_STDS))


def _swapped_columns(asked: Asked) -> InputError | None:
    """Also where both ways fit: few pixels that are close together fit whatever is wide."""
    points, reading = Points.of(asked.found), columns_swapped(asked.found, asked.camera)
    if reading is None:
        return None
    narrow, wide = (float(np.max(np.ptp(each, axis=0))) for each in (points.pixels, points.places[:, :2]))
    if wide < _WIDER * narrow:
        return None
    trial = asked.trial(reading.known, reading.names)
    if trial is None or not trial.rms_px or _PRECISER * trial.rms_px / wide > (asked.result.rms_px or 0.0) / narrow:
        return None
    return _error(asked, reading, trial)


def _unasked(asked: Asked) -> NoAnswerError | None:
    """Unknowns that were neither asked for nor stated, and therefore taken as 0."""
    given = {*expanded(asked.names), *asked.found.known.priors}
    level = ("roll",) if asked.model is ProjectionModel.DFT else ()
    missing = [name for name in _POSE if name not in given and name not in level]
    if not missing or not any(isinstance(each, Landmark) for each in asked.found.known.evidence):
        return None
    trial = asked.trial(asked.found.known, (*asked.names, *missing))
    if trial is None or not asked.is_better(trial):
        return None
    more = list(dict.fromkeys(_SAID.get(name, name) for name in missing))
    every = ",".join(dict.fromkeys((*asked.names, *more)))
    return NoAnswerError(
        "no calibration",
        where=asked.found.path,
        got=f"neither {' nor '.join(more)} stated or asked for",
        expected=f"--unknowns {every}, with which all fits{_fit(trial)}",
    )


def _prior(asked: Asked) -> InputError | None:
    """A stated number of the camera that all observations contradict."""
    known, best = asked.found.known, None
    for names in _prior_groups(known, asked.names):
        others = {name: prior for name, prior in known.priors.items() if name not in names}
        trial = asked.trial(EvidenceSet(evidence=known.evidence, priors=others), (*asked.names, *names))
        if trial is None or (best is not None and misfit(trial) >= misfit(best.trial)):
            continue
        suspect = Suspect(names, {name: known.priors[name] for name in names}, trial)
        if suspect.stds_off() > _PRIOR_STDS:
            best = suspect
    return None if best is None else prior_error(asked.found, best)


def _prior_groups(known: EvidenceSet, asked: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    stated = [name for name, prior in known.priors.items() if prior.std > 0 or name not in expanded(asked)]
    if "elevation" in stated:
        stated.remove("elevation")  # alone, landmarks do not tell it
    if place := tuple(name for name in ("east", "north") if name in stated):
        yield place
    yield from ((name,) for name in stated if name not in place)


def _groups(asked: Asked) -> InputError | None:
    """Landmarks that were left out, or of which those at other heights can be left out, and agree among themselves."""
    if error := group_error(asked.found, asked.result):
        return error
    evidence = asked.found.known.evidence
    ups_m = np.array([each.position_m[2] if isinstance(each, Landmark) else None for each in evidence], dtype=float)
    heights_m = np.sort(ups_m[np.isfinite(ups_m)])
    gaps_m = np.diff(heights_m)
    if not len(gaps_m) or np.max(gaps_m) < _GAP_M:
        return None
    at = int(np.argmax(gaps_m))
    is_low = np.isnan(ups_m) | (ups_m <= heights_m[at])
    for most in (is_low, np.isnan(ups_m) | ~is_low):
        known = replace(
            asked.found.known, evidence=tuple(each for each, is_in in zip(evidence, most, strict=True) if is_in)
        )
        trial = asked.trial(known, asked.names)
        if trial is not None and (error := group_error(asked.found, _of_all(trial, most))):
            return error
    return None


def _of_all(trial: Result, most: np.ndarray) -> Result:
    """The trial, with what it has not seen as left out."""
    kept = most.copy()
    kept[most] = trial.solution.kept
    return replace(trial, solution=replace(trial.solution, kept=kept))


def _reading(asked: Asked) -> InputError | None:
    for reading in readings(asked.found, asked.camera, asked.names):
        trial = asked.trial(reading.known, reading.names)
        if trial is not None and asked.is_better(trial):
            return _error(asked, reading, trial)
    return None


def _zoom(asked: Asked) -> InputError | None:
    """Another focal length than the camera file's."""
    if {"focal", "fx", "fy"} & {*asked.names, *asked.found.known.priors}:
        return None
    trial = asked.trial(asked.found.known, (*asked.names, "focal"))
    if trial is None or not asked.is_better(trial):
        return None
    index = trial.problem.unknowns.names.index("focal")
    std_px = math.sqrt(trial.named_covariance[index, index])
    if abs(trial.camera.fx_px - asked.camera.fx_px) <= _PRIOR_STDS * std_px:
        return None
    return InputError(
        "the image is not of this camera's mode",
        where=asked.found.path,
        got=f"a focal length of {trial.camera.fx_px:.0f} px, with which all fits{_fit(trial)}",
        expected=f'{asked.camera.fx_px:.0f} px, as camera "{asked.camera.name}" has',
        hint="take the camera file of the zoom and crop that the image was taken with, or add focal to --unknowns",
    )


def _error(asked: Asked, reading: Reading, trial: Result) -> InputError:
    got = "" if asked.result.rms_px is None else f"residuals of {misfit(asked.result):.0f} times the stated stds"
    return InputError(reading.what, where=asked.found.path, got=got, hint=f"{reading.hint}: then all fits{_fit(trial)}")


def _fit(trial: Result) -> str:
    return "" if trial.rms_px is None else f" to {trial.rms_px:.1f} px"


@dataclass(frozen=True, slots=True, eq=False)
class Suspect:
    """Something stated of the camera, and the calibration without it.

    Attributes:
        names: Its unknowns.
        priors: What is stated of them.
        trial: The calibration.
    """

    names: tuple[str, ...]
    priors: dict[str, Prior]
    trial: Result

    def off(self, name: str) -> float:
        """What is stated less what was found, SI."""
        off = self.priors[name].value - self.trial.solution.state.value(name)
        return math.remainder(off, 2 * math.pi) if name in _TURNED else off

    def stds_off(self) -> float:
        """How far the two are apart, in standard deviations of their difference."""
        every = self.trial.problem.unknowns.names
        variances = np.diag(self.trial.solution.covariance)
        return max(
            abs(self.off(name)) / math.sqrt(self.priors[name].std ** 2 + variances[every.index(name)])
            for name in self.names
        )


def prior_error(found: EvidenceFile, suspect: Suspect) -> InputError:
    """The sentence about it."""
    state, names = suspect.trial.solution.state, suspect.names
    if "east" in names or "north" in names:
        key, stated, seen = "position", _place(found, suspect), _listed(found, state.position_m)
    else:
        name = names[0]
        key, scale = said(name)
        spread = f" +- {scale * suspect.priors[name].std:.3g}" if suspect.priors[name].std else ""
        stated, seen = f"{scale * suspect.priors[name].value:.6g}{spread}", f"{scale * state.value(name):.6g}"
    return InputError(
        f"the camera's {key} contradicts the observations",
        where=found.path,
        got=stated,
        expected=f"about {seen}, as all fits without it",
        hint=_meant(found, suspect),
    )


def _place(found: EvidenceFile, suspect: Suspect) -> str:
    """What is stated of east and north, in the file's coordinates."""
    place_m = suspect.trial.solution.state.position_m.copy()
    for axis, name in enumerate(("east", "north")):
        if name in suspect.priors:
            place_m[axis] = suspect.priors[name].value
    return _listed(found, place_m)


def _listed(found: EvidenceFile, place_m: FloatArray) -> str:
    return f"[{', '.join(f'{value:.10g}' for value in found.frame.file_coordinates(place_m)[:2])}]"


def _meant(found: EvidenceFile, suspect: Suspect) -> str:
    """What to do about it."""
    name, on_map = suspect.names[0], found.frame.crs != LOCAL
    prior, true = suspect.priors[name], suspect.trial.solution.state.value(name)
    off_m = max(abs(suspect.off(each)) for each in suspect.names)
    below_rad = abs(math.pi / 2 - prior.value - true)
    cases = (
        (name in _ANGLES and _alike(math.degrees(prior.value), true), "it looks like radians: write degrees"),
        (
            name == "tilt" and below_rad <= 3 * prior.std + math.radians(1.0),
            "it looks like an angle below the horizon: tilt counts from straight down",
        ),
        (name == "height" and _alike(prior.value * _FOOT_M, true), "it looks like feet: write metres"),
        (
            name == "height" and on_map and _DATUM_M[0] <= off_m <= _DATUM_M[1],
            "are heights of two datums mixed, above the ellipsoid and above the sea?",
        ),
        (name == "focal" and prior.value <= _MILLIMETRES * true, "it looks like millimetres: write pixels"),
        (
            name in ("east", "north") and on_map and off_m <= _NEAR_M,
            "are places of two datums or projections mixed?",
        ),
    )
    return next((meant for is_so, meant in cases if is_so), "correct it, or state a larger std")


def _alike(value: float, other: float) -> bool:
    return abs(value - other) <= _ALIKE * abs(other)
