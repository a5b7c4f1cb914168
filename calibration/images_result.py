"""Telemetry's biases from many images: from what is known and asked, to numbers that people and files can take."""

from dataclasses import dataclass, replace

import numpy as np

from aerodft.model.arrays import FloatArray
from aerodft.model.calibration import BIASES
from aerodft.model.camera import Camera, CameraStd
from aerodft.model.evidence import Prior
from aerodft.model.measurement import ProjectionModel
from calibration.errors_left import Leftover, rms_px
from calibration.images_problem import ImagesProblem
from calibration.images_solve import ImagesSolution, images_leftovers, images_observability, solve_images
from calibration.images_state import OWN, ImagesState, SharedUnknowns, View
from calibration.observability import Observability
from calibration.result import above_ground, each_possible, said, start_state
from calibration.state import coefficient_names, expanded

_GROUND = ("elevation", "focal", "fx", "fy", "cx", "cy")
_LENS_OF_THE_PAPER = ("elevation", "focal", "fx", "fy")
_DEG = 180.0 / np.pi
_SAID = {
    "height": ("height_bias_m", 1.0),
    "tilt": ("tilt_bias_deg", _DEG),
    "roll": ("roll_bias_deg", _DEG),
    "heading": ("heading_bias_deg", _DEG),
    "pan": ("pan_bias_deg", _DEG),
    "east": ("east_bias_m", 1.0),
    "north": ("north_bias_m", 1.0),
    "time": ("time_offset_s", 1.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class ImagesResult:
    """What a calibration of many images found.

    Attributes:
        problem: What was asked.
        solution: The fit.
        left: What is left of each observation.
        rms_px: Of the landmarks; None without any.
        weakest: The combination of unknowns that is known worst.
    """

    problem: ImagesProblem
    solution: ImagesSolution
    left: tuple[Leftover, ...]
    rms_px: float | None
    weakest: Observability

    @property
    def names(self) -> tuple[str, ...]:
        """Of the unknowns, in the order of their covariance."""
        return self.problem.unknowns.names

    @property
    def named_values(self) -> dict[str, float]:
        """Values by the names that people see, in the order of the unknowns; a height is above the ground."""
        state = self.solution.state
        values = {}
        for name in self.names:
            key, scale = said_of_images(name)
            values[key] = scale * (state.value(name) - (self.ground_m if name == "height" else 0.0))
        return values

    @property
    def ground_m(self) -> float:
        """Elevation of the ground above where it was said to be."""
        return self.solution.state.base.elevation_m

    @property
    def named_covariance(self) -> FloatArray:
        """``(n, n)`` of the same, in SI units."""
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
        joint = to @ self.solution.covariance @ to.T
        covariance = tuple(map(tuple, joint.tolist())) if np.any(joint) else ()
        return replace(self.solution.state.base.camera, std=CameraStd(), covariance=covariance)


def said_of_images(name: str) -> tuple[str, float]:
    """A shared unknown's name for people, with its unit, and what its SI value is multiplied with."""
    return _SAID.get(name) or said(name)


def shared_unknowns(
    names: tuple[str, ...], priors: dict[str, Prior], camera: Camera, model: ProjectionModel
) -> SharedUnknowns:
    """What is solved for: what was asked, and everything that is known beforehand with a std.

    Raises:
        ValueError: An unknown that there is not, or that excludes another.
    """
    is_paper = model is ProjectionModel.DFT
    lens = _LENS_OF_THE_PAPER if is_paper else (*_GROUND, *coefficient_names(camera))
    possible = (*(name for name in BIASES if not (is_paper and name == "roll")), *lens)
    asked = each_possible(names, (*possible, "position"))
    more = tuple(name for name, prior in priors.items() if prior.std > 0)
    return SharedUnknowns(tuple(dict.fromkeys((*asked, *more))))


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
        names: What is asked for: some of ``BIASES``, ``position``, and lens and ground as ``calibration.result``.
        model: Projection model.

    Raises:
        ValueError: As ``shared_unknowns``.
    """
    unknowns = shared_unknowns(names, priors, camera, model)
    known = {name: prior for name, prior in priors.items() if prior.std > 0}
    problem = ImagesProblem(views, unknowns, known, model)
    biases = np.array([priors[name].value if name in priors else 0.0 for name in BIASES])
    lens = {name: prior for name, prior in priors.items() if name not in BIASES}
    start = ImagesState(start_state(lens, camera, model), biases, np.zeros((len(views), OWN)))
    solution = solve_images(problem, start)
    left = images_leftovers(problem, solution)
    weakest = images_observability(problem, solution, frozenset(expanded(names)))
    return ImagesResult(problem, solution, left, rms_px(problem.evidence, left), weakest)
