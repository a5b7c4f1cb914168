"""A calibration of one camera: from evidence and unknowns to results for people and files.

Beside the fit: residuals of every observation in the image and on the ground, also with the observation left out (all
at once, from leverages); and the unknowns, or combinations of them, that are not determined, with what to add.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Generic, TypeVar

import numpy as np

from aerodft.dft import INTRINSICS, POSITION
from aerodft.geometry import LENS_MODELS, camera_angles, intrinsics_covariance, matrix, meet_level, rays_from_pixels
from aerodft.model import (
    Camera,
    Evidence,
    EvidenceSet,
    FloatArray,
    GroundLines,
    Landmark,
    Prior,
    ProjectionModel,
    Vertical,
)
from calibration.descent import Residuals, covariance_of, used_rows
from calibration.pose.residuals import Problem, ground_error_m
from calibration.pose.solve import Solution, solve
from calibration.pose.state import (
    GROUPS,
    State,
    Unknowns,
    coefficient_names,
    expand_groups,
    possible_coefficients,
    with_coefficients,
)

_MIN_REMAINDER: Final = 1e-9
"""Smallest 1 - leverage with which the other observations determine a fit."""
_MAX_RESIDUAL_PX: Final = 1e6  # larger ones are of points near the camera's own plane, without meaning
_MAX_UNEXPLAINED_SHARE: Final = 0.003
"""Largest unexplained residual (rms), as a share of the image's diagonal, that may be one of careless clicks and of a
lens without distortion in its file: 7 px of 1920 x 1080, 15 px of 4000 x 3000. At half of it surveys by a phone are
refused; at twice of it a camera 9 std from the truth passes whose landmarks' heights were in feet."""
_MAX_RESIDUAL_SHARE: Final = 0.03
"""Largest residual (rms) of any fit, as a share of the image's diagonal: 66 px of 1920 x 1080. Chosen: beyond it the
landmarks are seen elsewhere, whatever their stds."""
_MAX_PRIOR_STDS: Final = 6.0  # distance of a prior from its fitted value, beyond which observations contradict it
LIMIT: Final = 0.5
"""An unknown whose standard deviation is a larger fraction of its natural size is not determined."""

_MIN_PART, _MIN_WHOLE = 0.25, 0.97  # of an unknown in a combination: to be named in it; to be the combination
_LENS: Final = frozenset(name for model in LENS_MODELS for name in model.coefficients)
_POSE = {"east", "north", "height", "tilt", "roll", "heading"}
_SUGGESTIONS: Final = (
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


def leave_one_out_steps(solution: Solution) -> FloatArray:
    """Newton steps ``(k, n)`` from the solution to the fits with each of its ``k`` observations left out.

    Cook and Weisberg, "Residuals and Influence in Regression" (1982), section 3.4. Zero for outliers, which are not in
    the fit; NaN where the others determine none.
    """
    residuals, kept = solution.residuals, solution.kept
    steps = np.where(kept[:, None], np.nan, np.zeros((len(kept), residuals.jac_unknowns.shape[1])))
    used = used_rows(residuals.owner, kept)
    jac, values = residuals.jac_unknowns[used], residuals.values[used]
    cov = covariance_of(jac.T @ jac)
    if not np.all(np.isfinite(cov)):
        return steps
    newton_step = -cov @ (jac.T @ values)
    order = np.argsort(residuals.owner, kind="stable")
    first = np.searchsorted(residuals.owner[order], np.arange(len(kept)))
    counts = np.bincount(residuals.owner[residuals.owner >= 0], minlength=len(kept))
    for count in np.unique(counts[kept]):
        observations = np.flatnonzero(kept & (counts == count))
        rows = order[first[observations, None] + np.arange(count)]
        jac_of_observation = residuals.jac_unknowns[rows]
        gain = jac_of_observation @ cov
        remainder = np.eye(count) - gain @ jac_of_observation.swapaxes(-1, -2)
        is_determined = np.linalg.eigvalsh(remainder)[:, 0] > _MIN_REMAINDER
        residual = residuals.values[rows[is_determined]] + jac_of_observation[is_determined] @ newton_step
        steps[observations[is_determined]] = newton_step + np.einsum(
            "gij,gi->gj", gain[is_determined], np.linalg.solve(remainder[is_determined], residual[..., None])[..., 0]
        )
    return steps


def has_lens_unknowns(problem: Problem, solution: Solution) -> bool:
    """Whether intrinsics are among the unknowns."""
    return bool(np.any(problem.unknowns.jac_unknowns(solution.state)[INTRINSICS]))


def landmark_errors_m(problem: Problem, solution: Solution, steps: FloatArray) -> FloatArray:
    """Horizontal errors ``(r,)`` of ground points of the ``r`` reprojected landmarks' pixels.

    Args:
        problem: A problem without lens unknowns.
        solution: The fit.
        steps: ``(r, n)`` step from the fit for each landmark.

    Returns:
        NaN where a ray does not reach its landmark's level, and where the step is NaN.
    """
    state, unknowns = solution.state, problem.unknowns
    points, pixels = problem.landmarks
    wxyz = unknowns.attitudes_after(state, steps)
    is_determined = np.isfinite(wxyz[:, 0]) & np.isfinite(steps[:, 0])
    directions = matrix(wxyz[is_determined]) @ rays_from_pixels(state.camera, pixels[is_determined])[..., None]
    position = state.position_m + steps[is_determined] @ unknowns.jac_unknowns(state)[POSITION].T
    offsets = meet_level(position, directions[..., 0], points[is_determined, 2]).points_enu_m - points[is_determined]
    distances = np.full(len(points), np.nan)
    distances[is_determined] = np.hypot(offsets[:, 0], offsets[:, 1])
    return distances


@dataclass(frozen=True, slots=True)
class ObservationResidual:
    """Residuals of one observation.

    Attributes:
        name: Its name.
        px: Distance in the image, px (2-D for landmarks); infinite out of sight.
        sigma: Distance in the image in standard deviations; infinite out of sight.
        ground_m: Error on the ground, m: of a landmark's ground point, or of a range; None for other kinds.
        loo_ground_m: Error on the ground by the fit without the observation (leave one out), as of the next
            measurement.
        is_outlier: Whether it was excluded from the fit.
    """

    name: str
    px: float
    sigma: float
    ground_m: float | None
    loo_ground_m: float | None
    is_outlier: bool


def observation_residuals(problem: Problem, solution: Solution) -> tuple[ObservationResidual, ...]:
    """Residuals of all observations, in their order."""
    steps = leave_one_out_steps(solution)
    ground_m, loo_ground_m = (_ground_errors(problem, solution, step) for step in (np.zeros_like(steps), steps))
    return residuals_of(problem.known.evidence, solution.residuals, solution.kept, ground_m, loo_ground_m)


def residuals_of(
    evidence: Sequence[Evidence],
    residuals: Residuals,
    kept: np.ndarray,
    ground_m: Sequence[float | None],
    loo_ground_m: Sequence[float | None],
) -> tuple[ObservationResidual, ...]:
    """Residuals in the image and on the ground of observations; arguments as the fields of ``ObservationResidual``."""
    seen = residuals.owner >= 0
    px, sigma = (
        np.sqrt(np.bincount(residuals.owner[seen], np.square(values[seen])))
        for values in (residuals.px, residuals.values)
    )
    px[px > _MAX_RESIDUAL_PX] = np.inf
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


def _ground_errors(problem: Problem, solution: Solution, steps: FloatArray) -> list[float | None]:
    """Ground errors of all observations, each at its step ``(n,)`` from the solution."""
    errors: list[float | None] = [None] * len(steps)
    done = set()
    if not has_lens_unknowns(problem, solution):
        distances = landmark_errors_m(problem, solution, steps[problem.reprojected])
        done = set(problem.reprojected.tolist())
        for index, value in zip(problem.reprojected.tolist(), distances.tolist(), strict=True):
            errors[index] = value if math.isfinite(value) else None
    for index, evidence in enumerate(problem.known.evidence):
        if index in done or not np.isfinite(steps[index, 0]):
            continue
        state = problem.moved(solution.state, steps[index])
        if state is not None:
            errors[index] = ground_error_m(state, evidence)
    return errors


def rms_px(evidence: tuple[Evidence, ...], left: tuple[ObservationResidual, ...]) -> float | None:
    """Root mean square of the landmarks' 2-D distances, px, without outliers and those out of sight.

    None without landmarks.
    """
    squares = [
        one.px**2
        for one, each in zip(left, evidence, strict=True)
        if isinstance(each, Landmark) and not one.is_outlier and math.isfinite(one.px)
    ]
    return math.sqrt(sum(squares) / len(squares)) if squares else None


@dataclass(frozen=True, slots=True)
class Observability:
    """The weakest combinations of unknowns, and how well they are determined.

    Attributes:
        combination: Their unknowns with their parts, largest first.
        std_share: Standard deviation of the weakest as a fraction of the unknowns' natural sizes; infinite without
            information.
        advice: What to add; empty if all is determined.
        is_each: Whether each unknown is undetermined by itself, not only together with others.
    """

    combination: dict[str, float]
    std_share: float
    advice: str
    is_each: bool = False

    @property
    def is_determined(self) -> bool:
        """Whether every unknown is determined."""
        return self.std_share <= LIMIT

    @property
    def sentence(self) -> str:
        """Sentence on what cannot be told; empty if all is determined."""
        if self.is_determined:
            return ""
        names = list(self.combination)
        if len(names) == 1:
            return f"{names[0]} cannot be told: {self.advice}"
        apart = "" if self.is_each else " apart"
        return f"{', '.join(names[:-1])} and {names[-1]} cannot be told{apart}: {self.advice}"


def observability(problem: Problem, solution: Solution) -> Observability:
    """The weakest combinations of a solution's unknowns: all undetermined ones, or else the worst.

    Columns of the Jacobian are scaled by natural sizes (a height by itself, an angle by a radian, a focal length by
    itself, a position by the camera's height): its singular values are then standard deviations of the evidence per
    natural size. A free attitude is judged by rotations about the camera's axes: at nadir, where roll and heading
    coincide, it is determined nevertheless.
    """
    names = problem.unknowns.names
    jac = solution.residuals.jac_unknowns[used_rows(solution.residuals.owner, solution.kept)]
    above_m = _height_above_evidence(problem, solution.state)
    sizes = np.array([natural_size(name, solution.state, above_m) for name in names])
    _, singular, directions = np.linalg.svd(np.linalg.qr(jac * sizes, mode="r"))
    strengths = np.append(singular, np.zeros(len(names) - len(singular)))
    with np.errstate(divide="ignore"):
        shares = solution.sigma_scale / strengths
    weak = directions[shares > LIMIT] if shares[-1] > LIMIT else directions[-1:]
    weak = (weak * sizes) @ problem.unknowns.to_angles(solution.state).T / sizes
    return describe_weakness(names, weak, float(shares[-1]), lambda parts: _advice(parts, jac.shape))


def describe_weakness(
    names: tuple[str, ...], weak: FloatArray, share: float, advice: Callable[[set[str]], str]
) -> Observability:
    """Observability from weak directions ``(k, n)`` in the space of the unknowns, in natural sizes.

    Args:
        names: The unknowns.
        weak: All undetermined directions, or else the worst.
        share: Standard deviation along the weakest.
        advice: What to add, by the undetermined unknowns.
    """
    weak = weak / np.linalg.norm(weak, axis=-1, keepdims=True)
    each = np.minimum(np.linalg.norm(weak, axis=0), 1.0)
    parts = {names[index]: float(each[index]) for index in np.argsort(-each, kind="stable") if each[index] > _MIN_PART}
    is_each = len(parts) == len(weak) and min(parts.values()) > _MIN_WHOLE
    return Observability(parts, share, "" if share <= LIMIT else advice(set(parts)), is_each)


def _height_above_evidence(problem: Problem, state: State) -> float:
    """Height above the landmarks, or above the ground without landmarks."""
    points, _ = problem.landmarks
    below = float(np.median(points[:, 2])) if len(points) else state.elevation_m
    return max(abs(state.value("height") - below), 1e-3)


def natural_size(name: str, state: State, above_m: float) -> float:
    """Natural size of an unknown; ``above_m`` is the camera's height above the evidence."""
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
    for wanted, advice in _SUGGESTIONS:
        if wanted == names:
            return advice
    if len(names & _POSE) > 2:  # noqa: PLR2004 - the camera may swing about a line of landmarks
        return "add landmarks elsewhere, not in one line with the others"
    for wanted, advice in _SUGGESTIONS:
        if wanted <= names:
            return advice
    return "add landmarks near the corners of the image" if names & _LENS else "add landmarks"


def correlations(covariance: FloatArray) -> FloatArray:
    """Correlation coefficients ``(n, n)`` of a covariance; 0 for exact values, NaN where it is infinite."""
    std = np.sqrt(np.diag(covariance))
    size = np.where(std > 0, std, 1.0)
    known = np.isfinite(covariance)
    return np.where(known, np.where(known, covariance, 0.0) / np.outer(size, size), np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome(Generic[ProblemT, FitT]):
    """Problem, solution and residuals of a calibration.

    Attributes:
        problem: Evidence and unknowns.
        solution: The fit.
        left: Residuals of each observation.
        rms_px: Of the landmarks; None without landmarks.
        weakest: The weakest combination of unknowns.
    """

    problem: ProblemT
    solution: FitT
    left: tuple[ObservationResidual, ...]
    rms_px: float | None
    weakest: Observability


@dataclass(frozen=True, slots=True, eq=False)
class Result(Outcome[Problem, Solution]):
    """Result of a calibration of one camera."""

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
        """Names of the unknowns with units, and factors from SI."""
        return dict(map(display_unit, self.names))

    @property
    def kept_rms_px(self) -> float:
        """Root mean square of the residuals of all observations used, px; infinite where one is out of sight."""
        used = [left.px for left in self.left if not left.is_outlier]
        return math.sqrt(sum(px * px for px in used) / len(used)) if used else 0.0

    @property
    def is_in_view(self) -> bool:
        """Whether the observations used are seen near where the fit has them, whatever their stds."""
        return self.kept_rms_px <= _MAX_RESIDUAL_SHARE * self._diagonal_px

    @property
    def is_pulled(self) -> bool:
        """Whether a prior is far from its fitted value, in its std."""
        residuals = self.solution.residuals
        return bool(np.any(np.abs(residuals.values[residuals.owner < 0]) > _MAX_PRIOR_STDS))

    @property
    def is_near(self) -> bool:
        """Whether the residuals are as small as those of careless clicks."""
        return self.kept_rms_px <= _MAX_UNEXPLAINED_SHARE * self._diagonal_px

    @property
    def is_consistent(self) -> bool:
        """Whether stated stds explain the residuals, or these are as small as those of careless clicks."""
        return self.is_in_view and (self.solution.is_explained or (self.is_near and not self.is_pulled))

    @property
    def _diagonal_px(self) -> float:
        lens = self.solution.state.camera
        return math.hypot(lens.width_px, lens.height_px)

    @property
    def camera(self) -> Camera:
        """The camera with its lens as estimated or known, and its covariance."""
        return self.solution.state.camera.with_covariance(self.solution.joint[INTRINSICS, INTRINSICS])

    @property
    def named_covariance(self) -> FloatArray:
        """Covariance ``(n, n)`` of the unknowns for people, see :func:`above_ground`."""
        return above_ground(self.names, self.solution.covariance)

    @property
    def pose_covariance(self) -> FloatArray:
        """Covariance ``(6, 6)`` as ``Pose.cov``."""
        return np.asarray(self.solution.joint[:6, :6])

    @property
    def lens_covariance(self) -> FloatArray:
        """Covariance ``(6, m)`` as ``Pose.lens_cov``."""
        return np.asarray(self.solution.joint[:6, INTRINSICS])


def above_ground(names: tuple[str, ...], covariance: FloatArray) -> FloatArray:
    """Covariance ``(n, n)`` with the height above the ground, which may be unknown too."""
    above = np.eye(len(names))
    if {"height", "elevation"} <= set(names):
        above[names.index("height"), names.index("elevation")] = -1.0
    with np.errstate(invalid="ignore"):
        cov = above @ covariance @ above.T
    return np.asarray(np.where(np.isnan(cov), np.inf, cov))


def display_unit(name: str) -> tuple[str, float]:
    """Name of an unknown for people, with its unit, and the factor from SI."""
    return _DISPLAY_UNITS.get(name, (name, 1.0))


def possible_unknowns(camera: Camera) -> tuple[str, ...]:
    """Unknowns of a camera that may be asked for, singly and as groups."""
    return (*_DISPLAY_UNITS, *possible_coefficients(camera), *GROUPS)


def unknowns_of(names: tuple[str, ...], known: EvidenceSet, camera: Camera, model: ProjectionModel) -> Unknowns:
    """The unknowns of a problem: those asked for, and those with a prior that has a std.

    Raises:
        ValueError: An impossible unknown, or one that excludes another.
    """
    requested = checked_unknowns(names, possible_unknowns(camera))
    of_rays = [each.name for each in known.evidence if isinstance(each, Vertical | GroundLines)]
    if model is ProjectionModel.DFT and of_rays:
        expected = "expected ranges, lengths, landmarks, a horizon, ..."
        raise ValueError(f"got {of_rays[0]} for the dft model, which has no rays: {expected}")
    absent = ("cx", "cy", "roll", *possible_coefficients(camera)) if model is ProjectionModel.DFT else ()
    wrong = next((name for name in requested if name in absent), None)
    if wrong is not None:
        raise ValueError(f"got {wrong} for the dft model, expected height, tilt, heading, position or focal")
    with_priors = tuple(name for name, prior in known.priors.items() if prior.std > 0 and name not in absent)
    return Unknowns(tuple(dict.fromkeys((*requested, *with_priors))))


def checked_unknowns(names: tuple[str, ...], possible: tuple[str, ...]) -> tuple[str, ...]:
    """Names with groups expanded, checked against those that are possible.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    requested = expand_groups(names)
    for name in requested:
        if name not in possible:
            raise ValueError(f"got {name}, expected some of {', '.join(possible)}")
    if "focal" in requested and {"fx", "fy"} & set(requested):
        raise ValueError("got focal beside fx or fy, expected one of the two")
    return requested


def calibrate(
    known: EvidenceSet,
    camera: Camera,
    names: tuple[str, ...],
    model: ProjectionModel = ProjectionModel.PINHOLE,
    *,
    is_quick: bool = False,
) -> Result:
    """Estimate a camera's unknowns.

    Args:
        known: Observations and priors. A prior with a std of 0 is exact, or a first value if it is asked for.
        camera: The camera; what is not asked for is kept, with the camera's uncertainty. Missing distortion
            coefficients are 0.
        names: Unknowns, see ``display_unit``; also ``position`` and ``principal_point``.
        model: Projection model.
        is_quick: See ``solve``.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    unknowns, camera = unknowns_of(names, known, camera, model), with_coefficients(camera, names)
    priors = {name: prior for name, prior in known.priors.items() if prior.std > 0}
    problem = Problem(EvidenceSet(evidence=known.evidence, priors=priors), unknowns, model)
    start = start_state(known.priors, camera, model)
    guessed = set(unknowns.names) <= {*known.priors, "focal", "fx", "fy", "cx", "cy", *coefficient_names(camera)}
    solution = solve(problem, start, guess_is_good=guessed, is_quick=is_quick)
    left, weakest = observation_residuals(problem, solution), observability(problem, solution)
    solution = with_lens(problem, solution, camera, frozenset(known.priors))
    return Result(problem, solution, left, rms_px(known.evidence, left), weakest)


def start_state(priors: dict[str, Prior], camera: Camera, model: ProjectionModel) -> State:
    """State of known values, and of first values of the unknowns."""

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
    """The solution with covariances that include the uncertainty of the camera file's lens.

    Its parameters are considered, not estimated: their errors propagate to every unknown through the fit (Schmidt's
    consider analysis; Tapley, Schutz and Born, "Statistical Orbit Determination", 2004, section 6.4).

    Args:
        problem: The problem.
        solution: The fit, with an exact lens where it was not asked for.
        camera: The camera file's, with its stds or covariance.
        stated: Unknowns with stated values, which replace the camera file's.

    Returns:
        The solution with these covariances; undetermined ones are kept.
    """
    considered = [name for name in _intrinsic_names(camera) if not _is_known(name, {*problem.unknowns.names, *stated})]
    lens_cov = _intrinsics_covariance(camera, considered)
    if not np.any(lens_cov) or not np.all(np.isfinite(solution.covariance)):
        return solution
    by_lens = Unknowns(tuple(considered)).jac_unknowns(solution.state)
    steps = _sensitivities(problem, solution, by_lens)
    in_angles = problem.unknowns.to_angles(solution.state) @ steps
    moves = problem.unknowns.jac_unknowns(solution.state) @ steps + by_lens
    return replace(
        solution,
        covariance=solution.covariance + in_angles @ lens_cov @ in_angles.T,
        joint=solution.joint + moves @ lens_cov @ moves.T,
    )


def _sensitivities(problem: Problem, solution: Solution, by_lens: FloatArray) -> FloatArray:
    """Sensitivities ``(n, p)`` of the fit to the considered parameters, to first order."""
    residuals = solution.residuals
    is_evidence = residuals.owner >= 0
    by_considered = np.zeros((len(is_evidence), by_lens.shape[1]))
    by_observations = problem.observed(solution.state, by_lens)
    if by_observations is not None:
        by_considered[is_evidence] = by_observations.jac_unknowns
    used = used_rows(residuals.owner, solution.kept)
    return np.asarray(-np.linalg.pinv(residuals.jac_unknowns[used]) @ by_considered[used])


def _intrinsic_names(camera: Camera) -> tuple[str, ...]:
    return (*_INTRINSICS, *coefficient_names(camera))


def _is_known(name: str, others: set[str]) -> bool:
    return name in others or (name in ("fx", "fy") and "focal" in others)


def _intrinsics_covariance(camera: Camera, considered: list[str]) -> FloatArray:
    """Covariance ``(p, p)`` of these parameters by the camera file."""
    every, known = _intrinsic_names(camera), intrinsics_covariance(camera)
    cov = np.zeros((len(every), len(every)))
    cov[: len(known), : len(known)] = known
    rows = [every.index(name) for name in considered]
    return cov[np.ix_(rows, rows)]
