"""A whole calibration: from what is known and what is asked, to numbers that people and files can take."""

import math
from dataclasses import dataclass, replace
from typing import Final, Generic, TypeVar

import numpy as np

from aerodft.dft.projection import INTRINSICS
from aerodft.geometry.intrinsics import intrinsics_covariance
from aerodft.geometry.rotation import camera_angles
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.evidence import EvidenceSet, GroundLines, Prior, Vertical
from aerodft.model.measurement import ProjectionModel
from calibration.descent import used_rows
from calibration.errors_left import Leftover, leftovers, rms_px
from calibration.observability import Observability, observability
from calibration.residuals import Problem
from calibration.solve import Solution, solve
from calibration.state import GROUPS, State, Unknowns, coefficient_names, expanded

_DEG: Final = math.degrees(1.0)
_SAID = {
    "height": ("height_agl_m", 1.0),
    "tilt": ("tilt_deg", _DEG),
    "roll": ("roll_deg", _DEG),
    "heading": ("heading_deg", _DEG),
    "east": ("east_m", 1.0),
    "north": ("north_m", 1.0),
    "elevation": ("elevation_m", 1.0),
    "focal": ("focal_px", 1.0),
    "fx": ("fx_px", 1.0),
    "fy": ("fy_px", 1.0),
    "cx": ("cx_px", 1.0),
    "cy": ("cy_px", 1.0),
}
_FIRST_HEIGHT_M, _FIRST_TILT_RAD = 10.0, 1.0
_INTRINSICS = ("fx", "fy", "cx", "cy")


ProblemT = TypeVar("ProblemT")
FitT = TypeVar("FitT")


@dataclass(frozen=True, slots=True, eq=False)
class Outcome(Generic[ProblemT, FitT]):
    """What a calibration found.

    Attributes:
        problem: What was asked.
        solution: The fit.
        left: What is left of each observation.
        rms_px: Of the landmarks; None without any.
        weakest: The combination of unknowns that is known worst.
    """

    problem: ProblemT
    solution: FitT
    left: tuple[Leftover, ...]
    rms_px: float | None
    weakest: Observability


@dataclass(frozen=True, slots=True, eq=False)
class Result(Outcome[Problem, Solution]):
    """What a calibration of one camera found."""

    @property
    def camera(self) -> Camera:
        """The camera with its lens as found or known, and how well."""
        return self.solution.state.camera.with_covariance(self.solution.joint[INTRINSICS, INTRINSICS])

    @property
    def named_covariance(self) -> FloatArray:
        """``(n, n)`` of the unknowns as people see them, see :func:`above_ground`."""
        return above_ground(self.problem.unknowns.names, self.solution.covariance)

    @property
    def pose_covariance(self) -> FloatArray:
        """``(6, 6)`` as ``Pose.cov``."""
        return np.asarray(self.solution.joint[:6, :6])

    @property
    def lens_covariance(self) -> FloatArray:
        """``(6, m)`` as ``Pose.lens_cov``."""
        return np.asarray(self.solution.joint[:6, INTRINSICS])


def above_ground(names: tuple[str, ...], covariance: FloatArray) -> FloatArray:
    """The covariance ``(n, n)`` where a height is above the ground, which may be unknown too."""
    above = np.eye(len(names))
    if {"height", "elevation"} <= set(names):
        above[names.index("height"), names.index("elevation")] = -1.0
    with np.errstate(invalid="ignore"):
        cov = above @ covariance @ above.T
    return np.asarray(np.where(np.isnan(cov), np.inf, cov))


def said(name: str) -> tuple[str, float]:
    """An unknown's name for people, with its unit, and what its SI value is multiplied with."""
    return _SAID.get(name, (name, 1.0))


def possible_unknowns(camera: Camera) -> tuple[str, ...]:
    """What may be asked for of a camera: single unknowns and groups of them."""
    return (*_SAID, *coefficient_names(camera), *GROUPS)


def unknowns_of(names: tuple[str, ...], known: EvidenceSet, camera: Camera, model: ProjectionModel) -> Unknowns:
    """What is solved for: what was asked, and everything that is known beforehand with a std.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    asked = each_possible(names, possible_unknowns(camera))
    apart = [each.name for each in known.evidence if isinstance(each, Vertical | GroundLines)]
    if model is ProjectionModel.DFT and apart:
        raise ValueError(
            f"got {apart[0]} for the dft model, which has no rays: expected ranges, lengths, landmarks, a horizon, ..."
        )
    not_there = ("cx", "cy", "roll", *coefficient_names(camera)) if model is ProjectionModel.DFT else ()
    wrong = next((name for name in asked if name in not_there), None)
    if wrong is not None:
        raise ValueError(f"got {wrong} for the dft model, expected height, tilt, heading, position or focal")
    more = tuple(name for name, prior in known.priors.items() if prior.std > 0 and name not in not_there)
    return Unknowns(tuple(dict.fromkeys((*asked, *more))))


def each_possible(names: tuple[str, ...], possible: tuple[str, ...]) -> tuple[str, ...]:
    """The names with groups taken apart.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    asked = expanded(names)
    for name in asked:
        if name not in possible:
            raise ValueError(f"got {name}, expected some of {', '.join(possible)}")
    if "focal" in asked and {"fx", "fy"} & set(asked):
        raise ValueError("got focal beside fx or fy, expected one of the two")
    return asked


def calibrate(
    known: EvidenceSet, camera: Camera, names: tuple[str, ...], model: ProjectionModel = ProjectionModel.PINHOLE
) -> Result:
    """Find a camera's unknowns.

    Args:
        known: Observations and priors. A prior with a std of 0 is exact, or where to start from if it is asked for.
        camera: The camera; what is not asked for stays, and is as uncertain as the camera says.
        names: What is asked for, see ``said``; also ``position`` and ``principal_point``.
        model: Projection model.

    Raises:
        ValueError: As ``unknowns_of``.
    """
    unknowns = unknowns_of(names, known, camera, model)
    priors = {name: prior for name, prior in known.priors.items() if prior.std > 0}
    problem = Problem(EvidenceSet(evidence=known.evidence, priors=priors), unknowns, model)
    start = start_state(known.priors, camera, model)
    guessed = set(unknowns.names) <= {*known.priors, "focal", "fx", "fy", "cx", "cy", *coefficient_names(camera)}
    solution = solve(problem, start, guess_is_good=guessed)
    left, weakest = leftovers(problem, solution), observability(problem, solution)
    solution = with_lens(problem, solution, camera, frozenset(known.priors))
    return Result(problem, solution, left, rms_px(known.evidence, left), weakest)


def start_state(priors: dict[str, Prior], camera: Camera, model: ProjectionModel) -> State:
    """What is known, and where to start from for what is not."""

    def stated(name: str, otherwise: float) -> float:
        return priors[name].value if name in priors else otherwise

    focal = stated("focal", camera.fx_px)
    zoomed = replace(camera, fx_px=focal, fy_px=camera.fy_px * focal / camera.fx_px)
    elevation = stated("elevation", 0.0)
    position = np.array([stated("east", 0.0), stated("north", 0.0), stated("height", elevation + _FIRST_HEIGHT_M)])
    angles = (stated("tilt", _FIRST_TILT_RAD), stated("roll", 0.0), stated("heading", 0.0))
    return State.of(zoomed, position, angles, elevation, model)


def angles_deg(state: State) -> tuple[float, float, float]:
    """Tilt, roll and heading, degrees."""
    tilt, roll, heading = (math.degrees(float(angle)) for angle in camera_angles(state.wxyz))
    return tilt, roll, heading


def with_lens(problem: Problem, solution: Solution, camera: Camera, stated: frozenset[str]) -> Solution:
    """The solution, with covariances in which the lens is as uncertain as the camera file says.

    Its parameters are considered, not estimated: they stay as the camera file has them, and what they are off by goes
    into every unknown as the fit lets it (Schmidt's consider analysis; Tapley, Schutz and Born, "Statistical Orbit
    Determination", 2004, section 6.4).

    Args:
        problem: What was fitted.
        solution: The fit, with the lens taken as exact where it was not asked for.
        camera: The camera file's, with its stds or covariance.
        stated: Unknowns that somebody stated: these are not as the camera file has them.

    Returns:
        The same values; what is undetermined stays so.
    """
    considered = [name for name in _names(camera) if not _is_told(name, {*problem.unknowns.names, *stated})]
    lens_cov = _covariance(camera, considered)
    if not np.any(lens_cov) or not np.all(np.isfinite(solution.covariance)):
        return solution
    by_lens = Unknowns(tuple(considered)).by_unknowns(solution.state)
    steps = _steps(problem, solution, by_lens)
    in_angles = problem.unknowns.to_angles(solution.state) @ steps
    moves = problem.unknowns.by_unknowns(solution.state) @ steps + by_lens
    return replace(
        solution,
        covariance=solution.covariance + in_angles @ lens_cov @ in_angles.T,
        joint=solution.joint + moves @ lens_cov @ moves.T,
    )


def _steps(problem: Problem, solution: Solution, by_lens: FloatArray) -> FloatArray:
    """``(n, p)``: what the fit makes of each considered parameter, to first order."""
    residuals = solution.residuals
    seen = residuals.owner >= 0
    by_considered = np.zeros((len(seen), by_lens.shape[1]))
    found = problem.observed(solution.state, by_lens)
    if found is not None:
        by_considered[seen] = found.by_unknowns
    used = used_rows(residuals.owner, solution.kept)
    return np.asarray(-np.linalg.pinv(residuals.by_unknowns[used]) @ by_considered[used])


def _names(camera: Camera) -> tuple[str, ...]:
    return (*_INTRINSICS, *coefficient_names(camera))


def _is_told(name: str, others: set[str]) -> bool:
    return name in others or (name in ("fx", "fy") and "focal" in others)


def _covariance(camera: Camera, considered: list[str]) -> FloatArray:
    """``(p, p)`` of these parameters, as the camera file has it."""
    every, known = _names(camera), intrinsics_covariance(camera)
    cov = np.zeros((len(every), len(every)))
    cov[: len(known), : len(known)] = known
    rows = [every.index(name) for name in considered]
    return cov[np.ix_(rows, rows)]
