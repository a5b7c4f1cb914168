"""Whether a calibration may be asked for, and whether its evidence determines what is asked."""

import difflib
import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from aerodft.adapters.config.evidence import EvidenceFile
from aerodft.errors import NotDetermined, Reason, UsageError
from aerodft.model import Camera, EvidenceSet, ProjectionModel
from aerodft.reports.calibration import values_of
from calibration.flight import ImagesResult
from calibration.pose import LIMIT, Result, Unknowns, display_unit, expand_groups, possible_unknowns, unknowns_of

_UNKNOWNS: Final = "`unknowns`"
_UNITS: Final = ("_agl_m", "_m", "_deg", "_px")
_SYNONYMS: Final = {
    "pitch": "tilt (from straight down: 90 deg + pitch)",
    "yaw": "heading",
    "azimuth": "heading",
    "altitude": "height",
    "fov": "focal",
    "f": "focal",
    "x": "east",
    "y": "north",
    "z": "height",
}
_DOUBT: Final = 3.0  # of residuals, in stated stds; below that it is not these that leave an unknown undetermined
_LINE, _NARROW = 3, 0.01  # landmarks that make one, and how narrow it is for its length
_ACCEPTED: Final = 10.0  # std of an accepted misfit, in natural sizes: beyond that the camera may be anywhere
_MAX_MISFIT: Final = 30.0  # of residuals, in stated stds; beyond that they are taken for a mistake
_MAX_OUTLIERS = 0.4  # of all observations; beyond that nobody can tell who is right


def check_unique(names: Sequence[str]) -> None:
    """Refuse no unknowns at all, and one that is named twice, by itself or in a group.

    Raises:
        UsageError: Which one.
    """
    if not names:
        raise UsageError(_UNKNOWNS, got="none", expected="e.g. height,tilt")
    every = expand_groups(tuple(names))
    twice = next((name for name in every if every.count(name) > 1), None)
    if twice is not None:
        got = f"{twice} twice in {','.join(names)}"
        raise UsageError(_UNKNOWNS, got=got, expected="each once", hint=f"remove one {twice}")


def check_unknowns(names: tuple[str, ...], known: EvidenceSet, camera: Camera, model: ProjectionModel) -> None:
    """Refuse unknowns that there are not, or that exclude each other or the evidence.

    Raises:
        UsageError: Which, and what may be meant.
    """
    possible = possible_unknowns(camera)
    wrong = next((name for name in names if name not in possible), None)
    if wrong is not None:
        expected = f"some of {', '.join(possible)}"
        raise UsageError(_UNKNOWNS, got=wrong, expected=expected, hint=_suggestion(wrong, possible))
    try:
        unknowns_of(names, known, camera, model)
    except ValueError as error:
        raise wrong_unknowns(error) from None


def wrong_unknowns(error: ValueError) -> UsageError:
    """The solver's error about unknowns, as a ``UsageError``."""
    return UsageError(_UNKNOWNS, got=str(error).removeprefix("got "))


def _suggestion(wrong: str, possible: tuple[str, ...]) -> str:
    lower = wrong.lower()
    stem = next((lower.removesuffix(unit) for unit in _UNITS if lower.endswith(unit)), lower)
    close = difflib.get_close_matches(stem, possible, n=1, cutoff=0.6)
    meant = _SYNONYMS.get(stem) or next(iter(close), "")
    return f"did you mean {meant}?" if meant else ""


def unstated_value(result: Result, evidence: EvidenceFile, *, is_saved: bool) -> NotDetermined | None:
    """A height or tilt that nobody stated or asked for; None where nothing needs it.

    A roll, a heading or a place may be taken as 0, but nobody hangs at no height and looks in no direction.

    Args:
        result: The calibration, made with a guess of it.
        evidence: What is known beforehand, with what is stated as exact.
        is_saved: The pose goes into a file, which needs both.
    """
    for name in ("height", "tilt"):
        if name in result.names or name in evidence.known.priors:
            continue
        state = result.solution.state
        found = result.problem.observed(state, Unknowns((name,)).jac_unknowns(state))
        if is_saved or (found is not None and np.any(found.jac_unknowns)):
            return NotDetermined(
                "no calibration",
                where=evidence.path,
                got=f"a {name} that is neither stated nor asked for",
                expected=f"{display_unit(name)[0]} under [camera], or {_UNKNOWNS} {','.join((*result.names, name))}",
            )
    return None


def not_determined(
    result: Result | ImagesResult, evidence: EvidenceFile, *, accept_misfit: bool
) -> NotDetermined | None:
    """Why the evidence gives no calibration; None where it gives one.

    Args:
        result: The calibration.
        evidence: What it is from.
        accept_misfit: Observations may contradict each other by more than stated stds explain.
    """
    why_not = _why_not(result, evidence, accept_misfit=accept_misfit)
    return NotDetermined("no calibration", where=evidence.path, got=Reason(why_not)) if why_not else None


def _why_not(result: Result | ImagesResult, evidence: EvidenceFile, *, accept_misfit: bool) -> str:
    solution, kept, share = result.solution, result.solution.kept, result.weakest.std_share
    is_told = share <= LIMIT * solution.sigma_scale  # if the stated stds were true
    if not is_told or (not result.weakest.is_determined and solution.misfit <= _DOUBT):
        return f"{result.weakest.sentence}{_in_line(result)}"
    is_elsewhere = isinstance(result, Result) and not result.is_in_view
    contradicts = is_elsewhere or (not _is_consistent(result) and not accept_misfit)
    if contradicts or share > (_ACCEPTED if accept_misfit else LIMIT):
        worst = max(result.left, key=lambda left: 0.0 if left.is_outlier else left.px)
        residual = f"{worst.px:.3g} px from its pixel" if math.isfinite(worst.px) else "out of sight"
        far = (
            f"residuals are {solution.misfit:.3g} times as large as the stated stds ({worst.name} is {residual}); check"
            " the camera file, the coordinates, the pixels and the stds"
        )
        far += ", or take it with stds scaled up by `accept_misfit`" if share <= _ACCEPTED and not is_elsewhere else ""
        if contradicts:
            return f"the observations contradict each other: {far}"
        return f"{result.weakest.sentence}; by the stated stds they could, but {far}"
    if isinstance(result, Result) and result.solution.alternative is not None:
        values = values_of(result.solution.alternative, result.names, evidence.frame)
        other = ", ".join(f"{key} {value:.4g}" for key, value in values.items())
        return (
            f"the observations fit another camera as well ({other}): add a landmark, or what you know of the camera"
            " under [camera]"
        )
    outliers = np.count_nonzero(~kept)
    if outliers <= _MAX_OUTLIERS * len(kept):
        return ""
    return (
        f"{outliers} of {len(kept)} observations disagree with the rest: check"
        " what is unknown (heading, position), the camera file, the coordinates and their stds"
    )


def _is_consistent(result: Result | ImagesResult) -> bool:
    """Whether observations agree as well as their stds say, or as well as those of careless people do."""
    is_rough = result.solution.misfit > _MAX_MISFIT
    return not is_rough and (not isinstance(result, Result) or result.is_consistent)


def _in_line(result: Result | ImagesResult) -> str:
    """Remark on landmarks of one image that all lie in one line; empty where they do not."""
    places_m = result.problem.landmarks[0] if isinstance(result, Result) else np.zeros((0, 3))
    if len(places_m) < _LINE:
        return ""
    along, across, *_ = np.linalg.svd(places_m - places_m.mean(axis=0), compute_uv=False)
    return "; all landmarks lie in one line: add one beside it" if across <= _NARROW * along else ""
