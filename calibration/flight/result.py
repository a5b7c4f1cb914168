"""Calibration of telemetry biases from many images: fit, residuals, observability and reported values.

Shared unknowns are coupled by all images, each image's own errors by that image alone: these are eliminated from the
normal equations (Schur complement), so that the time is proportional to the number of images.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.model import BIASES, Camera, Evidence, EvidenceSet, FloatArray, Landmark, Prior, ProjectionModel
from calibration.descent import (
    Loss,
    NormalEquations,
    Residuals,
    covariance_of,
    descend,
    eliminate_image_unknowns,
    image_steps,
)
from calibration.flight.state import OWN, ImagesState, ImageView, SharedUnknowns
from calibration.pose import (
    BOUNDS,
    LIMIT,
    ROBUST,
    Fit,
    Observability,
    ObservationResidual,
    Outcome,
    Problem,
    State,
    Unknowns,
    above_ground,
    checked_unknowns,
    describe_weakness,
    display_unit,
    expand_groups,
    goodness,
    ground_error_m,
    natural_size,
    possible_coefficients,
    residuals_of,
    rms_px,
    start_state,
    with_coefficients,
    without_outliers,
)

_BIAS_SIZE_STDS: Final = 4.0
"""Size of a bias in its prior's standard deviations; images that leave more than half of it do not determine it."""

_POSITION_BIASES = {"height", "east", "north"}
_ADVICE: Final = (
    ({"time"}, "take images while the camera moves or turns, or leave time out"),
    ({"time", "heading"}, "take images while the camera turns the other way, or not at all"),
    ({"roll", "heading"}, "leave one of them out: straight down they turn about one axis"),
    ({"height"}, "add landmarks away from the point below the camera, or a known length"),
    ({"heading"}, "add landmarks away from the point below the camera"),
    ({"height", "elevation"}, "state elevation_m: only their difference is seen"),
    ({"height", "focal"}, "add images from another height"),
)
_DEFAULT_ADVICE = "add images with other headings, heights and speeds, and landmarks all over them"
_PINHOLE_UNKNOWNS = ("elevation", "focal", "fx", "fy", "cx", "cy")
_DFT_UNKNOWNS = ("elevation", "focal", "fx", "fy")
_DEG = 180.0 / np.pi
_DISPLAY_UNITS = {
    "height": ("height_bias_m", 1.0),
    "tilt": ("tilt_bias_deg", _DEG),
    "roll": ("roll_bias_deg", _DEG),
    "heading": ("heading_bias_deg", _DEG),
    "pan": ("pan_bias_deg", _DEG),
    "east": ("east_bias_m", 1.0),
    "north": ("north_bias_m", 1.0),
    "time": ("time_offset_s", 1.0),
}


class ImagesProblem:
    """Residuals of many images by their unknowns.

    Args:
        views: The images.
        unknowns: Unknowns that all images share.
        priors: Their priors, by name.
        model: Projection model.
    """

    def __init__(
        self, views: tuple[ImageView, ...], unknowns: SharedUnknowns, priors: dict[str, Prior], model: ProjectionModel
    ) -> None:
        self.views = views
        self.unknowns = unknowns
        self.priors = {name: priors[name] for name in unknowns.names if name in priors}
        self._problems = [Problem(EvidenceSet(evidence=view.evidence), Unknowns(()), model) for view in views]
        self._evidence_starts = np.cumsum([0, *(len(view.evidence) for view in views)]).tolist()

    @property
    def evidence(self) -> tuple[Evidence, ...]:
        """Evidence of all images, in their order."""
        return tuple(each for view in self.views for each in view.evidence)

    @property
    def image_of(self) -> tuple[int, ...]:
        """Index of the image of each piece of evidence."""
        return tuple(index for index, view in enumerate(self.views) for _ in view.evidence)

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.unknowns.names) + OWN * len(self.views)

    def cameras(self, state: ImagesState) -> tuple[State, ...]:
        """Camera of each image."""
        return tuple(self.unknowns.camera(state, index, view) for index, view in enumerate(self.views))

    def moved(self, state: ImagesState, step: FloatArray) -> ImagesState | None:
        """Apply a step; None for an impossible camera or a time outside the telemetry."""
        try:
            moved = self.unknowns.moved(state, step)
            cameras = self.cameras(moved)
        except ValueError:
            return None
        return moved if all(holds(camera) for camera in cameras for holds in BOUNDS.values()) else None

    def evaluate(self, state: ImagesState) -> Residuals:
        """Residuals of all images and priors at a state."""
        image_rows = [self._image_residuals(state, index) for index in range(len(self.views))]
        ends = np.cumsum([0, *(len(part.values) for part in image_rows)]).tolist()
        whole = Residuals.concatenate([*image_rows, self._prior_residuals(state)])
        rows = tuple(map(slice, ends[:-1], ends[1:]))
        return replace(whole, images=rows, own=OWN)

    def _image_residuals(self, state: ImagesState, index: int) -> Residuals:
        """Residuals of one image's observations and of its own errors."""
        camera, by = self.unknowns.placed(state, index, self.views[index])
        own = np.eye(OWN, by.shape[1], by.shape[1] - OWN)
        own_rows = Residuals(state.own[index], own, np.full(OWN, -1), np.zeros(OWN), np.zeros(OWN))
        found = self._problems[index].observed(camera, by)
        if found is None:
            return own_rows
        return Residuals.concatenate([replace(found, owner=found.owner + self._evidence_starts[index]), own_rows])

    def _prior_residuals(self, state: ImagesState) -> Residuals:
        names, count = self.unknowns.names, len(self.priors)
        values = np.array([(state.value(name) - prior.value) / prior.std for name, prior in self.priors.items()])
        by = np.zeros((count, len(names) + OWN))
        for row, (name, prior) in enumerate(self.priors.items()):
            by[row, names.index(name)] = 1 / prior.std
        return Residuals(values, by, np.full(count, -1), np.zeros(count), np.zeros(count))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImagesSolution(Fit[ImagesState]):
    """Best fit of the shared unknowns, with their covariance.

    Attributes:
        cameras: The camera of each image.
        normal: Normal equations of the observations used.
    """

    cameras: tuple[State, ...]
    normal: NormalEquations


def solve_images(problem: ImagesProblem, start: ImagesState) -> ImagesSolution:
    """Fit the shared unknowns; telemetry is near enough to the truth to start from."""
    robust = descend(problem, start, ROBUST)
    end, kept = without_outliers(problem, robust, len(problem.evidence), problem.count)
    weights = Loss(end.residuals.owner, None, kept).weights(end.residuals)
    chi2, dof = float(weights @ np.square(end.residuals.values)), int(np.count_nonzero(weights)) - problem.count
    p_value, scale = goodness(chi2, dof)
    sigma_scale = max(scale, 1.0)  # landmarks that fit well say nothing of telemetry's stds
    normal = end.residuals.normal(weights)
    return ImagesSolution(
        state=end.state,
        cameras=problem.cameras(end.state),
        residuals=end.residuals,
        normal=normal,
        kept=kept,
        covariance=covariance_of(normal.reduced()) * sigma_scale**2,
        chi2=chi2,
        dof=dof,
        p_value=p_value,
        sigma_scale=sigma_scale,
    )


def image_observation_residuals(problem: ImagesProblem, solution: ImagesSolution) -> tuple[ObservationResidual, ...]:
    """Residuals of all observations, in their order."""
    reduced, residuals = solution.normal.reduced(), solution.residuals
    ground_m: list[float | None] = []
    loo_ground_m: list[float | None] = []
    for index, (evidence, image) in enumerate(zip(problem.evidence, problem.image_of, strict=True)):
        span = residuals.images[image]
        rows = np.flatnonzero(residuals.owner[span] == index) + span.start
        camera = solution.cameras[image]
        without = _leave_one_out_camera(problem, solution, reduced, image, rows) if solution.kept[index] else camera
        ground_m.append(ground_error_m(camera, evidence))
        loo_ground_m.append(None if without is None else ground_error_m(without, evidence))
    return residuals_of(problem.evidence, residuals, solution.kept, ground_m, loo_ground_m)


def _leave_one_out_camera(
    problem: ImagesProblem, solution: ImagesSolution, reduced: FloatArray, image: int, rows: np.ndarray
) -> State | None:
    """Camera of an image one Newton step after removal of an observation; None where it is undetermined."""
    normal, by, values = solution.normal, solution.residuals.jac_unknowns[rows], solution.residuals.values[rows]
    count = len(normal.shared_slope)
    block, slope = normal.blocks[image : image + 1], normal.slopes[image : image + 1]
    reduced_block, reduced_slope = block - by.T @ by, slope - by.T @ values
    before, _ = eliminate_image_unknowns(block, slope, count)
    after, after_slope = eliminate_image_unknowns(reduced_block, reduced_slope, count)
    others = normal.slope[:count] - slope[0, :count]
    covariance = covariance_of(reduced - before[0] + after[0])
    if not np.all(np.isfinite(covariance)):
        return None
    shared = -covariance @ (others + after_slope[0])
    own = np.zeros_like(solution.state.own)
    own[image] = image_steps(reduced_block, reduced_slope, shared)[0]
    try:
        moved = problem.unknowns.moved(solution.state, np.append(shared, own.ravel()))
        return problem.unknowns.camera(moved, image, problem.views[image])
    except ValueError:
        return None


def images_observability(problem: ImagesProblem, solution: ImagesSolution, requested: frozenset[str]) -> Observability:
    """Observability of the requested unknowns by images and landmarks, without telemetry's priors.

    As ``calibration.pose`` judges one image, with two differences. Telemetry's prior of a requested bias is left out:
    with it all would be known. And a bias has the size of telemetry's possible error.
    """
    names, state = problem.unknowns.names, solution.state
    information, sizes = solution.normal.reduced().copy(), np.empty(len(names))
    above_m = _height_above_landmarks(problem.evidence, solution)
    for index, name in enumerate(names):
        is_place = name in _POSITION_BIASES or name not in BIASES
        sizes[index] = natural_size(name, state.base, above_m) if is_place else 1.0
        prior = problem.priors.get(name)
        if prior is not None and name in BIASES:
            sizes[index] = min(sizes[index], _BIAS_SIZE_STDS * prior.std)
            information[index, index] -= prior.std**-2 if name in requested else 0.0
    values, directions = np.linalg.eigh(information * np.outer(sizes, sizes))
    with np.errstate(divide="ignore"):
        shares = solution.sigma_scale / np.sqrt(np.maximum(values, 0.0))
    is_undetermined = shares[0] > LIMIT * solution.sigma_scale  # by the scene; else it is the stds' fault
    limit = LIMIT * (solution.sigma_scale if is_undetermined else 1.0)
    weak = directions.T[shares > limit] if shares[0] > LIMIT else directions.T[:1]
    return describe_weakness(
        names, weak, float(shares[0]), lambda parts: next((say for of, say in _ADVICE if of == parts), _DEFAULT_ADVICE)
    )


def _height_above_landmarks(evidence: tuple[Evidence, ...], solution: ImagesSolution) -> float:
    heights = [float(camera.position_m[2]) - camera.elevation_m for camera in solution.cameras]
    places = [each.position_m[2] for each in evidence if isinstance(each, Landmark)]
    known = [place for place in places if place is not None]
    below = float(np.median(known)) - solution.state.base.elevation_m if known else 0.0
    return max(abs(float(np.median(heights)) - below), 1e-3)


@dataclass(frozen=True, slots=True, eq=False)
class ImagesResult(Outcome[ImagesProblem, ImagesSolution]):
    """Result of a calibration of many images."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, in the order of their covariance."""
        return self.problem.unknowns.names

    @property
    def evidence(self) -> tuple[Evidence, ...]:
        """The observations of all images, in the order of their residuals."""
        return self.problem.evidence

    @property
    def display_units(self) -> dict[str, float]:
        """Names of the unknowns with their units, and the factors of their SI values."""
        return dict(_DISPLAY_UNITS.get(name) or display_unit(name) for name in self.names)

    @property
    def named_values(self) -> dict[str, float]:
        """Values by their reported names, in the order of the unknowns; a height is above the ground."""
        state = self.solution.state
        heights = {"height": state.value("height") - self.ground_m} if "height" in self.names else {}
        return {
            key: scale * heights.get(name, state.value(name))
            for name, (key, scale) in zip(self.names, self.display_units.items(), strict=True)
        }

    @property
    def ground_m(self) -> float:
        """Estimated elevation of the ground above the stated one."""
        return self.solution.state.base.elevation_m

    @property
    def named_covariance(self) -> FloatArray:
        """Covariance ``(n, n)`` of the values, in SI units."""
        return above_ground(self.names, self.solution.covariance)

    @property
    def bias_covariance(self) -> FloatArray:
        """Covariance ``(8, 8 + m)`` of the biases, as ``BIASES`` and above the ground, and with the intrinsics."""
        to = self.problem.unknowns.to_shared(self.solution.state)
        if "elevation" in self.names:
            to[BIASES.index("height"), self.names.index("elevation")] = -1.0
        return np.asarray((to @ self.solution.covariance @ to.T)[: len(BIASES)])

    @property
    def camera(self) -> Camera:
        """Camera with the estimated intrinsics and their covariance."""
        to = self.problem.unknowns.to_shared(self.solution.state)[len(BIASES) :]
        return self.solution.state.base.camera.with_covariance(np.asarray(to @ self.solution.covariance @ to.T))


def shared_unknowns(
    names: tuple[str, ...], priors: dict[str, Prior], camera: Camera, model: ProjectionModel
) -> SharedUnknowns:
    """Unknowns to solve for: the requested ones, and all with a prior of non-zero std.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    is_paper = model is ProjectionModel.DFT
    lens = _DFT_UNKNOWNS if is_paper else (*_PINHOLE_UNKNOWNS, *possible_coefficients(camera))
    possible = (*(name for name in BIASES if not (is_paper and name == "roll")), *lens)
    requested = checked_unknowns(names, (*possible, "position"))
    with_prior = tuple(name for name, prior in priors.items() if prior.std > 0)
    return SharedUnknowns(tuple(dict.fromkeys((*requested, *with_prior))))


def calibrate_images(
    views: tuple[ImageView, ...],
    priors: dict[str, Prior],
    camera: Camera,
    names: tuple[str, ...],
    model: ProjectionModel = ProjectionModel.PINHOLE,
) -> ImagesResult:
    """Estimate telemetry biases and the lens from many images.

    Args:
        views: The images.
        priors: Of biases (around 0 by default), lens and ground, by name. One with a std of 0 is exact, or the start if
            it is requested.
        camera: The camera; unknowns that are not requested are exact.
        names: Requested unknowns: some of ``BIASES``, ``position``, and lens and ground as ``calibration.pose``.
        model: Projection model.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    unknowns, camera = shared_unknowns(names, priors, camera, model), with_coefficients(camera, names)
    known = {name: prior for name, prior in priors.items() if prior.std > 0}
    problem = ImagesProblem(views, unknowns, known, model)
    biases = np.array([priors[name].value if name in priors else 0.0 for name in BIASES])
    lens = {name: prior for name, prior in priors.items() if name not in BIASES}
    start = ImagesState(start_state(lens, camera, model), biases, np.zeros((len(views), OWN)))
    solution = solve_images(problem, start)
    residuals = image_observation_residuals(problem, solution)
    weakest = images_observability(problem, solution, frozenset(expand_groups(names)))
    return ImagesResult(problem, solution, residuals, rms_px(problem.evidence, residuals), weakest)
