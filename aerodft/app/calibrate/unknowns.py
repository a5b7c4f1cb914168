"""``--unknowns``: what is to be found, as people write it."""

import difflib
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.errors import NoAnswerError, UsageError
from aerodft.model import Camera, EvidenceSet, ProjectionModel
from calibration.pose import Result, Unknowns, expanded, possible_unknowns, said, unknowns_of

_OPTION: Final = "--unknowns"
_UNITS: Final = ("_agl_m", "_m", "_deg", "_px")
_MEANT: Final = {
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


def names_from(text: str) -> tuple[str, ...]:
    """The names of a comma-separated list.

    Raises:
        UsageError: None, or one twice, by itself or in a group.
    """
    names = tuple(filter(None, (name.strip() for name in text.split(","))))
    if not names:
        raise UsageError(_OPTION, got="none", expected="e.g. height,tilt")
    every = expanded(names)
    twice = next((name for name in every if every.count(name) > 1), None)
    if twice is not None:
        raise UsageError(_OPTION, got=f"{twice} twice in {text}", expected="each once", hint=f"remove one {twice}")
    return names


def check_unknowns(names: tuple[str, ...], known: EvidenceSet, camera: Camera, model: ProjectionModel) -> None:
    """Refuse unknowns that there are not, or that exclude each other or the evidence.

    Raises:
        UsageError: Which, and what may be meant.
    """
    possible = possible_unknowns(camera)
    wrong = next((name for name in names if name not in possible), None)
    if wrong is not None:
        expected = f"some of {', '.join(possible)}"
        raise UsageError(_OPTION, got=wrong, expected=expected, hint=_suggestion(wrong, possible))
    try:
        unknowns_of(names, known, camera, model)
    except ValueError as error:
        raise UsageError(_OPTION, got=str(error).removeprefix("got ")) from None


def unstated(result: Result, known: EvidenceSet, where: Path, *, is_written: bool) -> NoAnswerError | None:
    """A height or tilt that nobody stated or asked for; None where nothing needs it.

    A roll, a heading or a place may be taken as 0, but nobody hangs at no height and looks in no direction.

    Args:
        result: The calibration, made with a guess of it.
        known: What is known beforehand, with what is stated as exact.
        where: The file of evidence, for the sentence.
        is_written: The pose goes into a file, which needs both.
    """
    names = result.problem.unknowns.names
    for name in ("height", "tilt"):
        if name in names or name in known.priors:
            continue
        state = result.solution.state
        found = result.problem.observed(state, Unknowns((name,)).by_unknowns(state))
        if is_written or (found is not None and np.any(found.by_unknowns)):
            every = ",".join((*names, name))
            return NoAnswerError(
                "no calibration",
                where=where,
                got=f"a {name} that is neither stated nor asked for",
                expected=f"{said(name)[0]} under [camera], or --unknowns {every}",
            )
    return None


def _suggestion(wrong: str, possible: tuple[str, ...]) -> str:
    lower = wrong.lower()
    if lower[:1] in ("k", "p") and lower[1:].isdigit():
        return "the camera file needs a distortion with that coefficient, which may be 0"
    stem = next((lower.removesuffix(unit) for unit in _UNITS if lower.endswith(unit)), lower)
    if meant := _MEANT.get(stem):
        return f"did you mean {meant}?"
    close = next(iter(difflib.get_close_matches(stem, possible, n=1, cutoff=0.6)), "")
    return f"did you mean {close}?" if close else ""
