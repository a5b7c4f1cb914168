"""A whole calibration: from what is known and what is asked, to numbers that people and files can take.

Beside the fit it says what is left of every observation: in the image, on the ground, and without it (the fits without
each of the observations come all at once, from the observations' leverages); and which unknown, or which combination of
them, the evidence does not determine, and what to add.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Generic, TypeVar

import numpy as np

from aerodft.dft import INTRINSICS, POSITION
from aerodft.geometry import camera_angles, intrinsics_covariance, matrix, meet_level, rays_from_pixels
from aerodft.model import (
    Camera,
    Evidence,
    EvidenceSet,
    FloatArray,
    GroundLines,
    GroundPoint,
    Landmark,
    Prior,
    ProjectionModel,
    SlantRange,
    Vertical,
)
from calibration.pose.descent import Rows, used_rows
from calibration.pose.residuals import Problem
from calibration.pose.solve import Solution, covariance_of, solve
from calibration.pose.state import (
    GROUPS,
    State,
    Unknowns,
    coefficient_names,
    expanded,
    possible_coefficients,
    with_coefficients,
)

_NOTHING_LEFT: Final = 1e-9
"""One less a leverage below which the other observations determine no fit."""
_NO_IMAGE_PX: Final = 1e6  # in the plane of the camera itself, where distances in the image have no meaning
LIMIT: Final = 0.5
"""An unknown whose standard deviation is more than this share of its natural size is not determined."""

_PART, _ALONE = 0.25, 0.97  # of a combination: below which an unknown has no part in it, and beyond which it is all
_LENS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
_POSE = {"east", "north", "height", "tilt", "roll", "heading"}
_ADD: Final = (
    ({"height", "focal"}, "add a landmark at another distance or a known length"),
    ({"tilt", "focal"}, "add a landmark nearer or farther, or the horizon"),
    ({"height", "tilt"}, "add landmarks or ranges at other distances"),
    ({"height", "elevation"}, "state one of them: only their difference is seen"),
    ({"tilt", "cy"}, "state the principal point, or add the horizon"),
    ({"roll", "heading"}, "state one of them: straight down they turn about one axis"),
    ({"heading", "east"}, "add a second landmark, far from the first"),
    ({"heading", "north"}, "add a second landmark, far from the first"),
    ({"focal"}, "add a known length, or landmarks at several distances"),
    ({"height"}, "add a known length, a range or a landmark"),
    ({"tilt"}, "add landmarks at several distances, or the horizon"),
    ({"roll"}, "add landmarks to the left and to the right, a vertical or the horizon"),
    ({"heading"}, "add a landmark whose place is known"),
    ({"east"}, "add a landmark whose place is known"),
    ({"north"}, "add a landmark whose place is known"),
    ({"elevation"}, "add landmarks of known height"),
)
_DEG: Final = math.degrees(1.0)
_DISPLAY_UNITS = {
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


def steps_without_each(solution: Solution) -> FloatArray:
    """Newton's steps ``(k, n)`` from the solution to the fit without each of its ``k`` observations.

    Cook and Weisberg, "Residuals and Influence in Regression" (1982), section 3.4. Zero for outliers, which the
    solution has not seen; NaN where the others determine no fit.
    """
    residuals, kept = solution.residuals, solution.kept
    steps = np.where(kept[:, None], np.nan, np.zeros((len(kept), residuals.by_unknowns.shape[1])))
    used = used_rows(residuals.owner, kept)
    jac, values = residuals.by_unknowns[used], residuals.values[used]
    cov = covariance_of(jac.T @ jac)
    if not np.all(np.isfinite(cov)):
        return steps
    settled = -cov @ (jac.T @ values)
    order = np.argsort(residuals.owner, kind="stable")
    first = np.searchsorted(residuals.owner[order], np.arange(len(kept)))
    counts = np.bincount(residuals.owner[residuals.owner >= 0], minlength=len(kept))
    for count in np.unique(counts[kept]):
        members = np.flatnonzero(kept & (counts == count))
        rows = order[first[members, None] + np.arange(count)]
        own = residuals.by_unknowns[rows]
        gain = own @ cov
        left = np.eye(count) - gain @ own.swapaxes(-1, -2)
        is_determined = np.linalg.eigvalsh(left)[:, 0] > _NOTHING_LEFT
        off = residuals.values[rows[is_determined]] + own[is_determined] @ settled
        steps[members[is_determined]] = settled + np.einsum(
            "gij,gi->gj", gain[is_determined], np.linalg.solve(left[is_determined], off[..., None])[..., 0]
        )
    return steps


def moves_the_lens(problem: Problem, solution: Solution) -> bool:
    """Whether intrinsics are among the unknowns."""
    return bool(np.any(problem.unknowns.by_unknowns(solution.state)[INTRINSICS]))


def landmarks_off_m(problem: Problem, solution: Solution, steps: FloatArray) -> FloatArray:
    """How far on the map ``(r,)`` the pixels of the ``r`` reprojected landmarks end from their places.

    Args:
        problem: Its unknowns do not move the lens.
        solution: The fit.
        steps: ``(r, n)``: each landmark's own step away from it.

    Returns:
        NaN where a pixel's ray does not come down to its landmark's level, and where the step is NaN.
    """
    state, unknowns = solution.state, problem.unknowns
    points, pixels = problem.landmarks
    wxyz = unknowns.turned(state, steps)
    is_determined = np.isfinite(wxyz[:, 0]) & np.isfinite(steps[:, 0])
    turned = matrix(wxyz[is_determined]) @ rays_from_pixels(state.camera, pixels[is_determined])[..., None]
    position = state.position_m + steps[is_determined] @ unknowns.by_unknowns(state)[POSITION].T
    found = meet_level(position, turned[..., 0], points[is_determined, 2]).points_enu_m - points[is_determined]
    off = np.full(len(points), np.nan)
    off[is_determined] = np.hypot(found[:, 0], found[:, 1])
    return off


@dataclass(frozen=True, slots=True)
class ObservationResidual:
    """One observation after the fit.

    Attributes:
        name: Its name.
        px: Distance in the image, px (2-D for landmarks); infinite where it is out of sight.
        sigma: Distance in the image in standard deviations; infinite where it is out of sight.
        ground_m: Distance on the ground, m: of a landmark's pixel from its place, of a range from what was measured;
            None for what has no place.
        loo_ground_m: Distance on the ground by a fit that has not seen it (leave one out): so well would the next one
            be measured.
        is_outlier: It was left out of the fit.
    """

    name: str
    px: float
    sigma: float
    ground_m: float | None
    loo_ground_m: float | None
    is_outlier: bool


def observation_residuals(problem: Problem, solution: Solution) -> tuple[ObservationResidual, ...]:
    """All observations, in their order."""
    steps = steps_without_each(solution)
    ground_m, loo_ground_m = (_on_the_ground(problem, solution, step) for step in (np.zeros_like(steps), steps))
    return residuals_of(problem.known.evidence, solution.residuals, solution.kept, ground_m, loo_ground_m)


def residuals_of(
    evidence: Sequence[Evidence],
    residuals: Rows,
    kept: np.ndarray,
    ground_m: Sequence[float | None],
    loo_ground_m: Sequence[float | None],
) -> tuple[ObservationResidual, ...]:
    """What is left in the image, beside what is left on the ground; as the fields of ``ObservationResidual``."""
    seen = residuals.owner >= 0
    px, sigma = (
        np.sqrt(np.bincount(residuals.owner[seen], np.square(values[seen])))
        for values in (residuals.px, residuals.values)
    )
    px[px > _NO_IMAGE_PX] = np.inf
    sigma[~np.isfinite(px)] = np.inf
    return tuple(
        map(
            ObservationResidual,
            (each.name for each in evidence),
            px.tolist(),
            sigma.tolist(),
            ground_m,
            loo_ground_m,
            (~kept).tolist(),
        )
    )


def _on_the_ground(problem: Problem, solution: Solution, steps: FloatArray) -> list[float | None]:
    """Ground errors of all observations, each one step ``(n,)`` away from the solution."""
    off: list[float | None] = [None] * len(steps)
    at_once = set()
    if not moves_the_lens(problem, solution):
        found = landmarks_off_m(problem, solution, steps[problem.reprojected])
        at_once = set(problem.reprojected.tolist())
        for index, value in zip(problem.reprojected.tolist(), found.tolist(), strict=True):
            off[index] = value if math.isfinite(value) else None
    for index, evidence in enumerate(problem.known.evidence):
        if index in at_once or not np.isfinite(steps[index, 0]):
            continue
        state = problem.moved(solution.state, steps[index])
        if state is not None:
            off[index] = ground_error_m(state, evidence)
    return off


def rms_px(evidence: tuple[Evidence, ...], left: tuple[ObservationResidual, ...]) -> float | None:
    """Root mean square of the landmarks' 2-D distances, px, those apart that are outliers or out of sight.

    None without landmarks.
    """
    squares = [
        one.px**2
        for one, each in zip(left, evidence, strict=True)
        if isinstance(each, Landmark) and not one.is_outlier and math.isfinite(one.px)
    ]
    return math.sqrt(sum(squares) / len(squares)) if squares else None


def ground_error_m(state: State, evidence: Evidence) -> float | None:
    """Distance between where a pixel meets the ground and where it is known to; None where it meets none."""
    if not isinstance(evidence, Landmark | GroundPoint | SlantRange):
        return None
    elevation_m = state.elevation_m
    if isinstance(evidence, Landmark):
        if evidence.position_m[2] is None:
            return None
        elevation_m = evidence.position_m[2]
    ground = state.ground_points(np.array([evidence.pixel]), elevation_m)
    if ground.status[0]:
        return None
    return _distance(state, evidence, ground.points_enu_m[0])


def _distance(state: State, evidence: Landmark | GroundPoint | SlantRange, point: FloatArray) -> float:
    away = point - state.position_m
    if isinstance(evidence, SlantRange):
        return abs(float(np.linalg.norm(away)) - evidence.range_m)
    if isinstance(evidence, GroundPoint):
        heading = state.value("heading")
        right, ahead = math.cos(heading), math.sin(heading)
        seen = (right * away[0] - ahead * away[1], ahead * away[0] + right * away[1])
        return math.dist(seen, evidence.xy_m)
    east, north, _ = evidence.position_m
    return math.hypot(
        0.0 if east is None else float(point[0]) - east, 0.0 if north is None else float(point[1]) - north
    )


@dataclass(frozen=True, slots=True)
class Observability:
    """How well the weakest combinations of unknowns are determined.

    Attributes:
        combination: Their unknowns with the parts that they have in them, the largest first.
        std_share: Standard deviation of the weakest as a share of the unknowns' natural sizes; infinite where nothing
            tells.
        advice: What to add; empty where all is determined.
        is_each: Each unknown is undetermined by itself, not only together with others.
    """

    combination: dict[str, float]
    std_share: float
    advice: str
    is_each: bool = False

    @property
    def is_determined(self) -> bool:
        """Whether every unknown is."""
        return self.std_share <= LIMIT

    @property
    def sentence(self) -> str:
        """What cannot be told; empty where everything can."""
        if self.is_determined:
            return ""
        names = list(self.combination)
        if len(names) == 1:
            return f"{names[0]} cannot be told: {self.advice}"
        apart = "" if self.is_each else " apart"
        return f"{', '.join(names[:-1])} and {names[-1]} cannot be told{apart}: {self.advice}"


def observability(problem: Problem, solution: Solution) -> Observability:
    """The weakest combinations of a solution's unknowns: all that are undetermined, or else the worst.

    Columns of the Jacobian are scaled by natural sizes (a height by itself, an angle by a radian, a focal length by
    itself, a place by the camera's height), so that its singular values say how many standard deviations of the
    evidence a whole size makes. A camera that turns freely is judged by rotations about its own axes: straight down,
    where roll and heading are anything, its attitude is known nevertheless.
    """
    names = problem.unknowns.names
    jac = solution.residuals.by_unknowns[used_rows(solution.residuals.owner, solution.kept)]
    above_m = _above(problem, solution.state)
    sizes = np.array([natural_size(name, solution.state, above_m) for name in names])
    _, singular, directions = np.linalg.svd(np.linalg.qr(jac * sizes, mode="r"))
    strengths = np.append(singular, np.zeros(len(names) - len(singular)))
    with np.errstate(divide="ignore"):
        shares = solution.sigma_scale / strengths
    weak = directions[shares > LIMIT] if shares[-1] > LIMIT else directions[-1:]
    weak = (weak * sizes) @ problem.unknowns.to_angles(solution.state).T / sizes
    return combined(names, weak, float(shares[-1]), lambda parts: _advice(parts, jac.shape))


def combined(
    names: tuple[str, ...], weak: FloatArray, share: float, advice: Callable[[set[str]], str]
) -> Observability:
    """Weak directions ``(k, n)`` in the space of the unknowns, in their natural sizes, in words.

    Args:
        names: The unknowns.
        weak: All that are undetermined, or else the worst.
        share: Standard deviation along the weakest.
        advice: What to add where these cannot be told.
    """
    weak = weak / np.linalg.norm(weak, axis=-1, keepdims=True)
    each = np.minimum(np.linalg.norm(weak, axis=0), 1.0)
    parts = {names[index]: float(each[index]) for index in np.argsort(-each, kind="stable") if each[index] > _PART}
    is_each = len(parts) == len(weak) and min(parts.values()) > _ALONE
    return Observability(parts, share, "" if share <= LIMIT else advice(set(parts)), is_each)


def _above(problem: Problem, state: State) -> float:
    """Height above the landmarks, or above the ground where there are none."""
    points, _ = problem.landmarks
    below = float(np.median(points[:, 2])) if len(points) else state.elevation_m
    return max(abs(state.value("height") - below), 1e-3)


def natural_size(name: str, state: State, above_m: float) -> float:
    """What an uncertainty of an unknown is a share of; ``above_m`` is the camera's height above what it sees."""
    if name in ("height", "east", "north", "elevation"):
        return above_m
    if name in ("focal", "fx", "fy"):
        return state.value(name)
    if name in ("cx", "cy"):
        return float(state.camera.width_px if name == "cx" else state.camera.height_px)
    return 1.0


def _advice(names: set[str], shape: tuple[int, ...]) -> str:
    numbers, unknowns = shape
    if numbers < unknowns:
        few = "1 number" if numbers == 1 else f"{numbers} numbers"
        return f"the observations are {few} for {unknowns} unknowns, add some"
    for wanted, advice in _ADD:
        if wanted == names:
            return advice
    if len(names & _POSE) > 2:  # noqa: PLR2004 - the camera may swing about a line of landmarks
        return "add landmarks elsewhere, not in one line with the others"
    for wanted, advice in _ADD:
        if wanted <= names:
            return advice
    return "add landmarks near the corners of the image" if names & set(_LENS) else "add landmarks"


def correlations(covariance: FloatArray) -> FloatArray:
    """``(n, n)`` correlation coefficients of a covariance; 0 beside what is exact, NaN where it is infinite."""
    std = np.sqrt(np.diag(covariance))
    size = np.where(std > 0, std, 1.0)
    known = np.isfinite(covariance)
    return np.where(known, np.where(known, covariance, 0.0) / np.outer(size, size), np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome(Generic[ProblemT, FitT]):
    """What a calibration found.

    Attributes:
        problem: Evidence and unknowns.
        solution: The fit.
        left: What is left of each observation.
        rms_px: Of the landmarks; None without any.
        weakest: The combination of unknowns that is known worst.
    """

    problem: ProblemT
    solution: FitT
    left: tuple[ObservationResidual, ...]
    rms_px: float | None
    weakest: Observability


@dataclass(frozen=True, slots=True, eq=False)
class Result(Outcome[Problem, Solution]):
    """What a calibration of one camera found."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, in the order of their covariance."""
        return self.problem.unknowns.names

    @property
    def evidence(self) -> tuple[Evidence, ...]:
        """The observations, in the order of their residuals."""
        return self.problem.known.evidence

    @property
    def display_units(self) -> dict[str, float]:
        """Names of the unknowns with their units, and what their SI values are multiplied with."""
        return dict(map(display_unit, self.names))

    @property
    def camera(self) -> Camera:
        """The camera with its lens as found or known, and how well."""
        return self.solution.state.camera.with_covariance(self.solution.joint[INTRINSICS, INTRINSICS])

    @property
    def named_covariance(self) -> FloatArray:
        """``(n, n)`` of the unknowns as people see them, see :func:`above_ground`."""
        return above_ground(self.names, self.solution.covariance)

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


def display_unit(name: str) -> tuple[str, float]:
    """An unknown's name for people, with its unit, and what its SI value is multiplied with."""
    return _DISPLAY_UNITS.get(name, (name, 1.0))


def possible_unknowns(camera: Camera) -> tuple[str, ...]:
    """What may be asked for of a camera: single unknowns and groups of them."""
    return (*_DISPLAY_UNITS, *possible_coefficients(camera), *GROUPS)


def unknowns_of(names: tuple[str, ...], known: EvidenceSet, camera: Camera, model: ProjectionModel) -> Unknowns:
    """What is solved for: what was asked, and everything that is known beforehand with a std.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    requested = each_possible(names, possible_unknowns(camera))
    of_rays = [each.name for each in known.evidence if isinstance(each, Vertical | GroundLines)]
    if model is ProjectionModel.DFT and of_rays:
        expected = "expected ranges, lengths, landmarks, a horizon, ..."
        raise ValueError(f"got {of_rays[0]} for the dft model, which has no rays: {expected}")
    not_there = ("cx", "cy", "roll", *possible_coefficients(camera)) if model is ProjectionModel.DFT else ()
    wrong = next((name for name in requested if name in not_there), None)
    if wrong is not None:
        raise ValueError(f"got {wrong} for the dft model, expected height, tilt, heading, position or focal")
    more = tuple(name for name, prior in known.priors.items() if prior.std > 0 and name not in not_there)
    return Unknowns(tuple(dict.fromkeys((*requested, *more))))


def each_possible(names: tuple[str, ...], possible: tuple[str, ...]) -> tuple[str, ...]:
    """The names with groups taken apart.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    requested = expanded(names)
    for name in requested:
        if name not in possible:
            raise ValueError(f"got {name}, expected some of {', '.join(possible)}")
    if "focal" in requested and {"fx", "fy"} & set(requested):
        raise ValueError("got focal beside fx or fy, expected one of the two")
    return requested


def calibrate(
    known: EvidenceSet, camera: Camera, names: tuple[str, ...], model: ProjectionModel = ProjectionModel.PINHOLE
) -> Result:
    """Find a camera's unknowns.

    Args:
        known: Observations and priors. A prior with a std of 0 is exact, or where to start from if it is asked for.
        camera: The camera; what is not asked for stays, and is as uncertain as the camera says. Distortion that it has
            none of is 0.
        names: What is asked for, see ``display_unit``; also ``position`` and ``principal_point``.
        model: Projection model.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    unknowns, camera = unknowns_of(names, known, camera, model), with_coefficients(camera, names)
    priors = {name: prior for name, prior in known.priors.items() if prior.std > 0}
    problem = Problem(EvidenceSet(evidence=known.evidence, priors=priors), unknowns, model)
    start = start_state(known.priors, camera, model)
    guessed = set(unknowns.names) <= {*known.priors, "focal", "fx", "fy", "cx", "cy", *coefficient_names(camera)}
    solution = solve(problem, start, guess_is_good=guessed)
    left, weakest = observation_residuals(problem, solution), observability(problem, solution)
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
    return State.from_angles(zoomed, position, angles, elevation, model)


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
        The solution with these covariances; what is undetermined stays so.
    """
    considered = [name for name in _names(camera) if not _is_determined(name, {*problem.unknowns.names, *stated})]
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


def _is_determined(name: str, others: set[str]) -> bool:
    return name in others or (name in ("fx", "fy") and "focal" in others)


def _covariance(camera: Camera, considered: list[str]) -> FloatArray:
    """``(p, p)`` of these parameters, as the camera file has it."""
    every, known = _names(camera), intrinsics_covariance(camera)
    cov = np.zeros((len(every), len(every)))
    cov[: len(known), : len(known)] = known
    rows = [every.index(name) for name in considered]
    return cov[np.ix_(rows, rows)]
