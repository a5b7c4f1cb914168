"""A number that is stated of a camera, and that everything else contradicts: what it is, and what it may have meant."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.adapters.config.crs import LOCAL
from aerodft.adapters.config.evidence import EvidenceFile
from aerodft.errors import InputError
from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import Prior
from calibration.result import Result, said

_FOOT_M: Final = 0.3048
_ALIKE: Final = 0.05
_DATUM_M: Final = (10.0, 120.0)  # by how much heights above the ellipsoid and above the sea differ
_NEAR_M: Final = 2000.0
_ANGLES: Final = {"tilt", "roll", "heading"}
_TURNED: Final = {"roll", "heading"}
_MILLIMETRES: Final = 0.1  # of the focal length in pixels, below which a number is none


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
