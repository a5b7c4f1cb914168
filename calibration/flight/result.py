"""Telemetry's biases from many images: the fit, what it leaves and can tell, and numbers for people and files.

What the images share is coupled by all of them, what is new in each by itself alone: that is eliminated from the normal
equations (Schur's complement), so that the number of images costs time in proportion only.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.model import BIASES, Camera, Evidence, EvidenceSet, FloatArray, Landmark, Prior, ProjectionModel
from calibration.descent import (
    Loss,
    NormalEquations,
    Rows,
    concatenate_residuals,
    covariance_of,
    descend,
    eliminate_image_unknowns,
    image_steps,
)
from calibration.flight.state import OWN, ImagesState, SharedUnknowns, View
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

_WORTH: Final = 4.0
"""A bias of which images tell less than half of this many of its prior's standard deviations is not told by them."""

_PLACES = {"height", "east", "north"}
_ADD: Final = (
    ({"time"}, "take images while the camera moves or turns, or leave time out"),
    ({"time", "heading"}, "take images while the camera turns the other way, or not at all"),
    ({"roll", "heading"}, "leave one of them out: straight down they turn about one axis"),
    ({"height"}, "add landmarks away from the point below the camera, or a known length"),
    ({"heading"}, "add landmarks away from the point below the camera"),
    ({"height", "elevation"}, "state elevation_m: only their difference is seen"),
    ({"height", "focal"}, "add images from another height"),
)
_MORE = "add images with other headings, heights and speeds, and landmarks all over them"
_GROUND = ("elevation", "focal", "fx", "fy", "cx", "cy")
_LENS_OF_THE_PAPER = ("elevation", "focal", "fx", "fy")
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
    """Images and unknowns, ready to be evaluated again and again.

    Args:
        views: The images.
        unknowns: What is not known, and shared by all of them.
        priors: Of these, by name.
        model: Projection model.
    """

    def __init__(
        self, views: tuple[View, ...], unknowns: SharedUnknowns, priors: dict[str, Prior], model: ProjectionModel
    ) -> None:
        self.views = views
        self.unknowns = unknowns
        self.priors = {name: priors[name] for name in unknowns.names if name in priors}
        self._problems = [Problem(EvidenceSet(evidence=view.evidence), Unknowns(()), model) for view in views]
        self._firsts = np.cumsum([0, *(len(view.evidence) for view in views)]).tolist()

    @property
    def evidence(self) -> tuple[Evidence, ...]:
        """The evidence of all images, one image after the other."""
        return tuple(each for view in self.views for each in view.evidence)

    @property
    def image_of(self) -> tuple[int, ...]:
        """Index of the image that each piece of evidence is from."""
        return tuple(index for index, view in enumerate(self.views) for _ in view.evidence)

    @property
    def count(self) -> int:
        """How many numbers are fitted."""
        return len(self.unknowns.names) + OWN * len(self.views)

    def cameras(self, state: ImagesState) -> tuple[State, ...]:
        """The camera of each image."""
        return tuple(self.unknowns.camera(state, index, view) for index, view in enumerate(self.views))

    def moved(self, state: ImagesState, step: FloatArray) -> ImagesState | None:
        """The guess after a step; None where no camera can be, and where telemetry does not reach."""
        try:
            moved = self.unknowns.moved(state, step)
            cameras = self.cameras(moved)
        except ValueError:
            return None
        return moved if all(holds(camera) for camera in cameras for holds in BOUNDS.values()) else None

    def evaluate(self, state: ImagesState) -> Rows:
        """All residuals of a guess."""
        parts = [self._of_image(state, index) for index in range(len(self.views))]
        ends = np.cumsum([0, *(len(part.values) for part in parts)]).tolist()
        whole = concatenate_residuals([*parts, self._of_priors(state)])
        rows = tuple(map(slice, ends[:-1], ends[1:]))
        return replace(whole, images=rows, own=OWN)

    def _of_image(self, state: ImagesState, index: int) -> Rows:
        """Residuals of one image's observations, and of what is new in it."""
        camera, by = self.unknowns.placed(state, index, self.views[index])
        own = np.eye(OWN, by.shape[1], by.shape[1] - OWN)
        new = Rows(state.own[index], own, np.full(OWN, -1), np.zeros(OWN))
        found = self._problems[index].observed(camera, by)
        if found is None:
            return new
        return concatenate_residuals([replace(found, owner=found.owner + self._firsts[index]), new])

    def _of_priors(self, state: ImagesState) -> Rows:
        names, count = self.unknowns.names, len(self.priors)
        values = np.array([(state.value(name) - prior.value) / prior.std for name, prior in self.priors.items()])
        by = np.zeros((count, len(names) + OWN))
        for row, (name, prior) in enumerate(self.priors.items()):
            by[row, names.index(name)] = 1 / prior.std
        return Rows(values, by, np.full(count, -1), np.zeros(count))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImagesSolution(Fit[ImagesState]):
    """The best fit of what many images share; the covariance is that of the shared unknowns.

    Attributes:
        cameras: The camera of each image.
        normal: Normal equations of what was used.
    """

    cameras: tuple[State, ...]
    normal: NormalEquations


def solve_images(problem: ImagesProblem, start: ImagesState) -> ImagesSolution:
    """Fit what the images share; telemetry is near enough to the truth to start from."""
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
    """All observations, in their order."""
    reduced, residuals = solution.normal.reduced(), solution.residuals
    ground_m: list[float | None] = []
    loo_ground_m: list[float | None] = []
    for index, (evidence, image) in enumerate(zip(problem.evidence, problem.image_of, strict=True)):
        span = residuals.images[image]
        rows = np.flatnonzero(residuals.owner[span] == index) + span.start
        camera = solution.cameras[image]
        without = _without(problem, solution, reduced, image, rows) if solution.kept[index] else camera
        ground_m.append(ground_error_m(camera, evidence))
        loo_ground_m.append(None if without is None else ground_error_m(without, evidence))
    return residuals_of(problem.evidence, residuals, solution.kept, ground_m, loo_ground_m)


def _without(
    problem: ImagesProblem, solution: ImagesSolution, reduced: FloatArray, image: int, rows: np.ndarray
) -> State | None:
    """An image's camera one Newton step after an observation was taken away; None where the others determine none."""
    normal, by, values = solution.normal, solution.residuals.by_unknowns[rows], solution.residuals.values[rows]
    count = len(normal.shared_slope)
    block, slope = normal.blocks[image : image + 1], normal.slopes[image : image + 1]
    less, pull = block - by.T @ by, slope - by.T @ values
    before, _ = eliminate_image_unknowns(block, slope, count)
    after, pulled = eliminate_image_unknowns(less, pull, count)
    others = normal.slope[:count] - slope[0, :count]
    inverted = covariance_of(reduced - before[0] + after[0])
    if not np.all(np.isfinite(inverted)):
        return None
    shared = -inverted @ (others + pulled[0])
    own = np.zeros_like(solution.state.own)
    own[image] = image_steps(less, pull, shared)[0]
    try:
        moved = problem.unknowns.moved(solution.state, np.append(shared, own.ravel()))
        return problem.unknowns.camera(moved, image, problem.views[image])
    except ValueError:
        return None


def images_observability(problem: ImagesProblem, solution: ImagesSolution, requested: frozenset[str]) -> Observability:
    """What images and landmarks tell of what was asked, telemetry's word for it apart.

    As ``calibration.pose`` judges one image, with two differences. What telemetry says of a bias that is asked for does
    not count: with it everything would be known. And a bias has the size of what telemetry may be off by.
    """
    names, state = problem.unknowns.names, solution.state
    information, sizes = solution.normal.reduced().copy(), np.empty(len(names))
    above_m = _above_m(problem.evidence, solution)
    for index, name in enumerate(names):
        is_place = name in _PLACES or name not in BIASES
        sizes[index] = natural_size(name, state.base, above_m) if is_place else 1.0
        prior = problem.priors.get(name)
        if prior is not None and name in BIASES:
            sizes[index] = min(sizes[index], _WORTH * prior.std)
            information[index, index] -= prior.std**-2 if name in requested else 0.0
    values, directions = np.linalg.eigh(information * np.outer(sizes, sizes))
    with np.errstate(divide="ignore"):
        shares = solution.sigma_scale / np.sqrt(np.maximum(values, 0.0))
    is_undetermined = shares[0] > LIMIT * solution.sigma_scale  # by the scene; else it is the stds' fault
    limit = LIMIT * (solution.sigma_scale if is_undetermined else 1.0)
    weak = directions.T[shares > limit] if shares[0] > LIMIT else directions.T[:1]
    return describe_weakness(
        names, weak, float(shares[0]), lambda parts: next((say for of, say in _ADD if of == parts), _MORE)
    )


def _above_m(evidence: tuple[Evidence, ...], solution: ImagesSolution) -> float:
    heights = [float(camera.position_m[2]) - camera.elevation_m for camera in solution.cameras]
    places = [each.position_m[2] for each in evidence if isinstance(each, Landmark)]
    known = [place for place in places if place is not None]
    below = float(np.median(known)) - solution.state.base.elevation_m if known else 0.0
    return max(abs(float(np.median(heights)) - below), 1e-3)


@dataclass(frozen=True, slots=True, eq=False)
class ImagesResult(Outcome[ImagesProblem, ImagesSolution]):
    """What a calibration of many images found."""

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
        """Names of the unknowns with their units, and what their SI values are multiplied with."""
        return dict(_DISPLAY_UNITS.get(name) or display_unit(name) for name in self.names)

    @property
    def named_values(self) -> dict[str, float]:
        """Values by the names that people see, in the order of the unknowns; a height is above the ground."""
        state = self.solution.state
        heights = {"height": state.value("height") - self.ground_m} if "height" in self.names else {}
        return {
            key: scale * heights.get(name, state.value(name))
            for name, (key, scale) in zip(self.names, self.display_units.items(), strict=True)
        }

    @property
    def ground_m(self) -> float:
        """Elevation of the ground above where it was said to be."""
        return self.solution.state.base.elevation_m

    @property
    def named_covariance(self) -> FloatArray:
        """``(n, n)`` of the values, in SI units."""
        return above_ground(self.names, self.solution.covariance)

    @property
    def bias_covariance(self) -> FloatArray:
        """``(8, 8 + m)`` of the biases, as ``BIASES`` and above the ground, and with the intrinsics."""
        to = self.problem.unknowns.to_shared(self.solution.state)
        if "elevation" in self.names:
            to[BIASES.index("height"), self.names.index("elevation")] = -1.0
        return np.asarray((to @ self.solution.covariance @ to.T)[: len(BIASES)])

    @property
    def camera(self) -> Camera:
        """The camera with what was found of its lens, and how well."""
        to = self.problem.unknowns.to_shared(self.solution.state)[len(BIASES) :]
        return self.solution.state.base.camera.with_covariance(np.asarray(to @ self.solution.covariance @ to.T))


def shared_unknowns(
    names: tuple[str, ...], priors: dict[str, Prior], camera: Camera, model: ProjectionModel
) -> SharedUnknowns:
    """What is solved for: what was asked, and everything that is known beforehand with a std.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    is_paper = model is ProjectionModel.DFT
    lens = _LENS_OF_THE_PAPER if is_paper else (*_GROUND, *possible_coefficients(camera))
    possible = (*(name for name in BIASES if not (is_paper and name == "roll")), *lens)
    requested = checked_unknowns(names, (*possible, "position"))
    more = tuple(name for name, prior in priors.items() if prior.std > 0)
    return SharedUnknowns(tuple(dict.fromkeys((*requested, *more))))


def calibrate_images(
    views: tuple[View, ...],
    priors: dict[str, Prior],
    camera: Camera,
    names: tuple[str, ...],
    model: ProjectionModel = ProjectionModel.PINHOLE,
) -> ImagesResult:
    """Find what telemetry is off by in all images, and the lens.

    Args:
        views: The images.
        priors: Of biases (around 0 where nobody knows better), lens and ground, by name. One with a std of 0 is exact,
            or where to start from if it is asked for.
        camera: The camera; what is not asked for is taken as exact.
        names: What is asked for: some of ``BIASES``, ``position``, and lens and ground as ``calibration.pose``.
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
    left = image_observation_residuals(problem, solution)
    weakest = images_observability(problem, solution, frozenset(expand_groups(names)))
    return ImagesResult(problem, solution, left, rms_px(problem.evidence, left), weakest)
