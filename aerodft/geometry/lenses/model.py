"""What a lens model is: everything that the rest of aerodft asks of a lens."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from aerodft.model import BoolArray, FloatArray, LensModel

Coefficients: TypeAlias = tuple[float, ...]
"""All coefficients that a model may have, those that a camera leaves out as 0."""
Intrinsics: TypeAlias = tuple[float, float, float, float]
"""fx, fy, cx and cy in px."""

_MIN_RECIPROCAL_ROOT = 1e-9  # smaller reciprocals are of roots beyond any image


@dataclass(frozen=True, slots=True, eq=False)
class Distorted:
    """Image points of rays.

    Attributes:
        points: ``(..., 2)`` from the principal point in focal lengths.
        jac_ray: ``(..., 2, 3)`` derivative by the ray.
        is_valid: ``(...)`` whether the ray is in front of the camera, within the range where the model is one to one.
    """

    points: FloatArray
    jac_ray: FloatArray
    is_valid: BoolArray


@dataclass(frozen=True, kw_only=True)
class Lens:
    """One model of lens distortion; methods take all its coefficients.

    Attributes:
        model: Its name in camera files, with the names of its coefficients in their order.
        ideal: What it is with coefficients of 0, as a noun.
        wire_names: Names in camera messages of Foxglove and ROS, each with its number of coefficients, in increasing
            order; the first that holds all coefficients is written, all are read.
        opencv_key: Key that marks the model in calibrations of OpenCV's FileStorage; empty where none does.
    """

    model: LensModel
    ideal: str
    wire_names: tuple[tuple[str, int], ...]
    opencv_key: str = ""

    def distort(self, coefficients: Coefficients, rays_cam: FloatArray) -> Distorted:
        """Image points of rays ``(..., 3)`` of any length."""
        raise NotImplementedError

    def undistort(self, coefficients: Coefficients, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rays ``(..., 3)``, not normalised, of image points ``(..., 2)``; their Jacobian ``(..., 3, 2)``.

        NaN where the model has no inverse.
        """
        raise NotImplementedError

    def by_coefficients(self, coefficients: Coefficients, rays_cam: FloatArray) -> FloatArray:
        """Derivative ``(..., 2, n)`` of the image points of rays ``(..., 3)`` by the coefficients."""
        raise NotImplementedError

    def is_pinhole(self, coefficients: Coefficients) -> bool:  # noqa: ARG002 - for others
        """Whether there is no distortion at all, so that a homography leads from pixels to level ground."""
        return False

    def rays(self, coefficients: Coefficients, points: FloatArray) -> FloatArray:
        """Rays of ``undistort`` without their Jacobian."""
        return self.undistort(coefficients, points)[0]

    def meet_level(
        self,
        coefficients: Coefficients,
        intrinsics: Intrinsics,
        pixels_px: FloatArray,
        ground: tuple[FloatArray, FloatArray],
        out_m: FloatArray,
    ) -> None:
        """Intersect the rays of pixels with level ground.

        Args:
            coefficients: Of the lens.
            intrinsics: Of the camera.
            pixels_px: ``(n, 2)``.
            ground: ``(3, 3)`` camera axes to axes with the third upwards, in units of the height; ``(3,)`` ground point
                below the camera.
            out_m: ``(n, 3)`` points, written; NaN for rays that do not go down, and where the model has no inverse.
        """
        ground_from_ray, foot_m = ground
        points = (pixels_px - intrinsics[2:]) / intrinsics[:2]
        away = self.rays(coefficients, points) @ ground_from_ray.T
        is_hit = away[:, 2] < 0
        with np.errstate(invalid="ignore", divide="ignore"):
            reach = np.where(is_hit, -1 / away[:, 2], np.nan)
        out_m[:, :2] = foot_m[:2] + reach[:, None] * away[:, :2]
        out_m[:, 2] = np.where(is_hit, foot_m[2], np.nan)


def first_positive_root(coefficients: FloatArray) -> float:
    """Smallest positive root of a polynomial, constant term first; infinite where there is none.

    Solved as the reversed polynomial, in which a tiny last coefficient does no harm.
    """
    roots = np.roots(coefficients)
    real = roots[np.abs(np.imag(roots)) < 1e-9 * (1 + np.abs(roots))].real
    largest = max(real[real > _MIN_RECIPROCAL_ROOT], default=0.0)
    return float(1 / largest) if largest > 0 else np.inf
