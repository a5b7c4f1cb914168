"""OpenCV's fisheye lens ("Fisheye camera model"): the distorted radius is a polynomial of the angle from the axis.

The inverse is Newton's method inside the angle up to which the polynomial increases, NaN outside it.
"""

from functools import lru_cache

import numpy as np
from numpy.polynomial import Polynomial

from aerodft.geometry.kernels import fisheye_angles, meet_fisheye
from aerodft.geometry.lenses.model import Coefficients, Distorted, Intrinsics, Lens, first_positive_root
from aerodft.model import FloatArray, LensModel


class _Fisheye(Lens):
    def distort(self, coefficients: Coefficients, rays_cam: FloatArray) -> Distorted:
        polynomial, limit = _polynomial(coefficients), _valid_angle(coefficients)
        off_axis, z = np.hypot(rays_cam[..., 0], rays_cam[..., 1]), rays_cam[..., 2]
        angle = np.arctan2(off_axis, z)
        on_axis = off_axis == 0
        outward = rays_cam[..., :2] / np.where(on_axis, 1.0, off_axis)[..., None]
        scale = np.where(on_axis, 1 / z, polynomial(angle) / off_axis)
        slope = polynomial.deriv()(angle) / (off_axis**2 + z**2)
        jac = np.empty((*rays_cam.shape[:-1], 2, 3))
        radial = slope * z - scale
        jac[..., :2] = (
            scale[..., None, None] * np.eye(2) + radial[..., None, None] * outward[..., :, None] * outward[..., None, :]
        )
        jac[..., 2] = -(slope * off_axis)[..., None] * outward
        return Distorted(rays_cam[..., :2] * scale[..., None], jac, angle <= limit)

    def undistort(self, coefficients: Coefficients, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        polynomial, limit = _polynomial(coefficients), _valid_angle(coefficients)
        radius = np.linalg.norm(points, axis=-1)
        angle = np.empty(np.shape(radius))
        fisheye_angles(np.reshape(radius, -1), tuple(map(float, coefficients)), limit, angle.reshape(-1))
        with np.errstate(divide="ignore"):  # at the limit itself the derivative may be 0
            slope = np.asarray(1 / polynomial.deriv()(angle))
        outward = points / np.where(radius > 0, radius, 1.0)[..., None]
        sine_over_radius = np.where(radius > 0, np.sin(angle) / np.where(radius > 0, radius, 1.0), 1.0)
        rays = np.concatenate([points * sine_over_radius[..., None], np.cos(angle)[..., None]], axis=-1)
        radial = np.concatenate([outward * np.cos(angle)[..., None], -np.sin(angle)[..., None]], axis=-1)
        jac = radial[..., :, None] * (outward * slope[..., None])[..., None, :]
        across = np.eye(2) - outward[..., :, None] * outward[..., None, :]
        jac[..., :2, :] += across * sine_over_radius[..., None, None]
        jac[..., :2, :] = np.where((radius > 0)[..., None, None], jac[..., :2, :], np.eye(2) * slope[..., None, None])
        return rays, jac

    def by_coefficients(self, coefficients: Coefficients, rays_cam: FloatArray) -> FloatArray:  # noqa: ARG002
        off_axis = np.hypot(rays_cam[..., 0], rays_cam[..., 1])
        angle = np.arctan2(off_axis, rays_cam[..., 2])
        radial = rays_cam[..., :2] / np.where(off_axis > 0, off_axis, 1.0)[..., None]
        return np.asarray(radial[..., None] * angle[..., None, None] ** np.array([3, 5, 7, 9]))

    def meet_level(
        self,
        coefficients: Coefficients,
        intrinsics: Intrinsics,
        pixels_px: FloatArray,
        ground: tuple[FloatArray, FloatArray],
        out_m: FloatArray,
    ) -> None:
        coefficients = tuple(map(float, coefficients))
        meet_fisheye(pixels_px, (intrinsics, coefficients, _valid_angle(coefficients)), *ground, out_m)


def _polynomial(coefficients: Coefficients) -> Polynomial:
    k1, k2, k3, k4 = coefficients
    return Polynomial([0, 1, 0, k1, 0, k2, 0, k3, 0, k4])


@lru_cache(maxsize=64)
def _valid_angle(coefficients: Coefficients) -> float:
    """Angle from the axis up to which the distorted radius increases, at most half a turn."""
    slope = np.asarray(_polynomial(coefficients).deriv().coef, dtype=np.float64)
    return min(first_positive_root(slope), np.pi)


FISHEYE = _Fisheye(
    model=LensModel.FISHEYE,
    ideal="a fisheye of equal angles",
    wire_names=(("fisheye_opencv", 4), ("kannala_brandt", 4), ("equidistant", 4), ("fisheye", 4)),
    opencv_key="fisheye_model",
)
"""The entry."""
