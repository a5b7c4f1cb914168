"""State of a calibration: pose, intrinsics and ground of a camera, and its unknowns by name."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from aerodft.dft import ELEVATION, INTRINSICS, ROTATION, GroundPoints, project
from aerodft.geometry import angles_of_matrix, camera_attitude, from_rotation_vector, matrix, multiply
from aerodft.model import (
    Camera,
    CameraStd,
    FloatArray,
    FloatLike,
    Pose,
    ProjectionModel,
    read_only,
)

_POSITION_INDEX = {"east": 0, "north": 1, "height": 2}
_ANGLES = ("tilt", "roll", "heading")
_INTRINSIC_INDEX = {"fx": 0, "fy": 1, "cx": 2, "cy": 3}
_NADIR_SINE = 1e-6  # sine of a tilt below which roll and heading coincide
GROUPS = {"position": ("east", "north"), "principal_point": ("cx", "cy")}
"""Names of groups of unknowns."""


@dataclass(frozen=True, eq=False)  # no slots: cached properties
class State:
    """Values of all parameters of a camera.

    Attributes:
        camera: The intrinsics; all distortion coefficients are marked uncertain, so that derivatives include them.
        position_m: ``(3,)`` east, north and up.
        wxyz: ``(4,)`` from camera axes to east, north, up.
        elevation_m: Of the ground.
        model: Projection model.
    """

    camera: Camera
    position_m: FloatArray
    wxyz: FloatArray
    elevation_m: float = 0.0
    model: ProjectionModel = ProjectionModel.PINHOLE

    @classmethod
    def from_angles(
        cls,
        camera: Camera,
        position_m: FloatArray,
        angles_rad: tuple[float, float, float],
        elevation_m: float = 0.0,
        model: ProjectionModel = ProjectionModel.PINHOLE,
    ) -> "State":
        """A state from tilt, roll and heading."""
        uncertain = CameraStd(distortion=(1.0,) * len(camera.distortion))
        lens = replace(camera, std=uncertain, covariance=())
        return cls(lens, np.asarray(position_m, dtype=np.float64), camera_attitude(*angles_rad), elevation_m, model)

    @cached_property
    def rotation(self) -> FloatArray:
        """Rotation ``(3, 3)`` from camera axes to east, north, up."""
        return matrix(self.wxyz)

    @cached_property
    def angles_rad(self) -> tuple[float, float, float]:
        """Tilt, roll and heading."""
        tilt, roll, heading = angles_of_matrix(self.rotation)
        return float(tilt), float(roll), float(heading)

    @property
    def pose(self) -> Pose:
        """The camera's pose without its covariance."""
        return Pose(position_enu_m=self.position_m, wxyz=self.wxyz)

    def ground_points(self, pixels_px: FloatArray, elevation_m: FloatLike) -> GroundPoints:
        """Ground points of pixels ``(..., 2)`` on level planes at ``elevation_m``."""
        return project(self.camera, self.pose, pixels_px, elevation_m, self.model)

    def value(self, name: str) -> float:
        """Value of an unknown: metres, radians, pixels; distortion coefficients without unit."""
        if name in _POSITION_INDEX:
            return float(self.position_m[_POSITION_INDEX[name]])
        if name in _ANGLES:
            return self.angles_rad[_ANGLES.index(name)]
        if name == "elevation":
            return self.elevation_m
        if name in ("focal", "fx"):
            return self.camera.fx_px
        if name in _INTRINSIC_INDEX:
            return (self.camera.fy_px, self.camera.cx_px, self.camera.cy_px)[_INTRINSIC_INDEX[name] - 1]
        return self.camera.distortion[coefficient_names(self.camera).index(name)]

    @cached_property
    def angle_axes(self) -> FloatArray:
        """Derivatives of the small rotation in camera axes by tilt, roll and heading, as columns ``(3, 3)``."""
        _, _, heading = self.angles_rad
        attitudes_after = self.rotation.T
        axes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        axes[:, 0] = attitudes_after[:, 0] * math.cos(heading) - attitudes_after[:, 1] * math.sin(heading)
        axes[:, 2] = -attitudes_after[:, 2]
        return axes


def coefficient_names(camera: Camera) -> tuple[str, ...]:
    """Names of the camera's distortion coefficients, in their order."""
    return camera.lens.coefficients[: len(camera.distortion)]


def possible_coefficients(camera: Camera) -> tuple[str, ...]:
    """Names of all distortion coefficients that the camera's lens model may have."""
    return camera.lens.coefficients


def with_coefficients(camera: Camera, names: tuple[str, ...]) -> Camera:
    """The camera with as many distortion coefficients as the named ones need; added ones are 0 and exact."""
    known = possible_coefficients(camera)
    needed = max((known.index(name) + 1 for name in names if name in known), default=0)
    count = next(count for count in camera.lens.coefficient_counts if count >= max(needed, len(camera.distortion)))
    zeros = (0.0,) * (count - len(camera.distortion))
    if not zeros:
        return camera
    std, rows = camera.std, [(*row, *zeros) for row in camera.covariance]
    return replace(
        camera,
        distortion=(*camera.distortion, *zeros),
        std=replace(std, distortion=(*std.distortion, *zeros) if std.distortion else ()),
        covariance=(*rows, *((0.0,) * len(rows[0]) for _ in zeros)) if rows else (),
    )


@dataclass(frozen=True, slots=True)
class Unknowns:
    """The unknowns of a problem.

    Attributes:
        names: In the order of the solution, groups expanded.
    """

    names: tuple[str, ...]

    @property
    def has_free_attitude(self) -> bool:
        """Whether all three angles are unknown: then steps are rotations about the camera's axes, regular at nadir."""
        return set(_ANGLES) <= set(self.names)

    def jac_unknowns(self, state: State) -> FloatArray:
        """Derivatives ``(s, n)`` of the errors of ``dft.projection`` by steps of the unknowns.

        With a free attitude the three angles stand for rotations about the camera's x, z and y axes.
        """
        by = _constant_columns(self.names, coefficient_names(state.camera))
        angles = set() if self.has_free_attitude else set(_ANGLES) & set(self.names)
        if not (angles or "focal" in self.names):
            return by
        by = by.copy()
        for name in angles:
            by[ROTATION, self.names.index(name)] = state.angle_axes[:, _ANGLES.index(name)]
        if "focal" in self.names:
            by[INTRINSICS.start + 1, self.names.index("focal")] = state.camera.fy_px / state.camera.fx_px
        return by

    def moved(self, state: State, step: FloatArray) -> State:
        """The state after a step ``(n,)``.

        Raises:
            ValueError: The step leads to an impossible camera.
        """
        errors = self.jac_unknowns(state) @ step
        wxyz = self.attitudes_after(state, step)
        if np.isnan(wxyz[0]):
            raise ValueError(f"got a step from a tilt of {state.value('tilt')} rad past nadir or zenith, expected none")
        lens = state.camera
        fx, fy, cx, cy, *coefficients = errors[INTRINSICS].tolist()
        if any(errors[INTRINSICS]):
            distortion = tuple(k + step for k, step in zip(lens.distortion, coefficients, strict=True))
            lens = replace(
                lens,
                fx_px=lens.fx_px + fx,
                fy_px=lens.fy_px + fy,
                cx_px=lens.cx_px + cx,
                cy_px=lens.cy_px + cy,
                distortion=distortion,
            )
        return replace(
            state,
            camera=lens,
            position_m=state.position_m + errors[:3],
            wxyz=wxyz,
            elevation_m=state.elevation_m + float(errors[ELEVATION]),
        )

    def attitudes_after(self, state: State, steps: FloatArray) -> FloatArray:
        """Attitudes ``(..., 4)`` after steps ``(..., n)``; NaN past nadir, where a known heading would flip."""
        if self.has_free_attitude:
            return multiply(state.wxyz, from_rotation_vector(steps @ self.jac_unknowns(state)[ROTATION].T))
        if not set(_ANGLES) & set(self.names):
            return np.broadcast_to(state.wxyz, (*steps.shape[:-1], 4))
        tilt, roll, heading = (
            angle + (steps[..., self.names.index(name)] if name in self.names else 0.0)
            for angle, name in zip(state.angles_rad, _ANGLES, strict=True)
        )
        is_valid = (tilt >= 0.0) & (tilt <= math.pi)
        return np.where(np.asarray(is_valid)[..., None], camera_attitude(tilt, roll, heading), np.nan)

    def to_angles(self, state: State) -> FloatArray:
        """Derivatives ``(n, n)`` of the unknowns by name by the solver's steps.

        At nadir, where roll and heading are about one axis, the whole rotation counts as heading.
        """
        change = np.eye(len(self.names))
        if self.has_free_attitude:
            columns = [self.names.index(name) for name in _ANGLES]
            steps = np.linalg.pinv(state.angle_axes, rcond=_NADIR_SINE) @ np.eye(3)[:, [0, 2, 1]]
            if math.sin(state.angles_rad[0]) < _NADIR_SINE:  # the pseudo-inverse gives half to each
                steps[1:] = [[0.0], [2.0]] * steps[2]
            change[np.ix_(columns, columns)] = steps
        return change


@lru_cache(maxsize=64)
def _constant_columns(names: tuple[str, ...], coefficients: tuple[str, ...]) -> FloatArray:
    """The part ``(s, n)`` of ``Unknowns.jac_unknowns`` that is independent of the state."""
    by = np.zeros((7 + 4 + len(coefficients), len(names)))
    for column, name in enumerate(names):
        if name in _POSITION_INDEX:
            by[_POSITION_INDEX[name], column] = 1.0
        elif name in _ANGLES:
            by[ROTATION, column] = np.eye(3)[:, [0, 2, 1]][:, _ANGLES.index(name)]
        elif name == "elevation":
            by[ELEVATION, column] = 1.0
        elif name == "focal":
            by[INTRINSICS.start, column] = 1.0
        elif name in _INTRINSIC_INDEX:
            by[INTRINSICS.start + _INTRINSIC_INDEX[name], column] = 1.0
        else:
            by[INTRINSICS.start + 4 + coefficients.index(name), column] = 1.0
    return read_only(by)


def expand_groups(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names with groups expanded."""
    return tuple(each for name in names for each in GROUPS.get(name, (name,)))


BOUNDS: dict[str, Callable[[State], bool]] = {
    "height": lambda state: float(state.position_m[2]) > state.elevation_m,
    "focal": lambda state: 0.05 < state.camera.fx_px / state.camera.width_px < 50,  # noqa: PLR2004 - 169 to 1 degrees
}
"""Bounds of all cameras."""
