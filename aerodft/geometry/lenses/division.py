"""The division model of A. W. Fitzgibbon.

"Simultaneous linear estimation of multiple view geometry and lens distortion", CVPR 2001.
An image point at the radius ``r`` from the principal point, in focal lengths, is on the ray ``(x, y, 1 + k1 r^2)``. One
coefficient below 0 bends as wide-angle lenses do, up to more than half a turn across; both directions are closed forms.
"""

import numpy as np

from aerodft.geometry.lenses.model import Coefficients, Distorted, Lens
from aerodft.model import BoolArray, FloatArray, LensModel


class _Division(Lens):
    def distort(self, coefficients: Coefficients, rays_cam: FloatArray) -> Distorted:
        scale, root, is_valid = _scale(coefficients[0], rays_cam)
        xy, z = rays_cam[..., :2], rays_cam[..., 2]
        # The scale is 2 / (z + root), root^2 = z^2 - 4 k1 (x^2 + y^2).
        by_root = -np.square(scale) / 2
        by_xy = by_root[..., None] * (-4 * coefficients[0] * xy / root[..., None])
        jac = np.empty((*rays_cam.shape[:-1], 2, 3))
        jac[..., :2] = scale[..., None, None] * np.eye(2) + xy[..., :, None] * by_xy[..., None, :]
        jac[..., 2] = xy * (by_root * (1 + z / root))[..., None]
        return Distorted(scale[..., None] * xy, jac, is_valid)

    def undistort(self, coefficients: Coefficients, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        bend = coefficients[0] * np.sum(np.square(points), axis=-1)
        is_valid = (bend < 1)[..., None]  # beyond, the angle from the axis falls again
        jac = np.zeros((*points.shape[:-1], 3, 2))
        jac[..., 0, 0] = jac[..., 1, 1] = 1.0
        jac[..., 2, :] = 2 * coefficients[0] * points
        rays = np.concatenate([points, (1 + bend)[..., None]], axis=-1)
        return np.where(is_valid, rays, np.nan), np.where(is_valid[..., None], jac, np.nan)

    def by_coefficients(self, coefficients: Coefficients, rays_cam: FloatArray) -> FloatArray:
        scale, root, _ = _scale(coefficients[0], rays_cam)
        xy = rays_cam[..., :2]
        by_k1 = np.square(scale) * np.sum(np.square(xy), axis=-1) / root
        return np.asarray((by_k1[..., None] * xy)[..., None])

    def is_pinhole(self, coefficients: Coefficients) -> bool:
        return not any(coefficients)


def _scale(k1: float, rays_cam: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Image point over ray's x and y ``(...)``; the root in it; whether there is one."""
    z = rays_cam[..., 2]
    square = np.square(z) - 4 * k1 * np.sum(np.square(rays_cam[..., :2]), axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(square)
        return np.asarray(2 / (z + root)), root, np.asarray((square > 0) & (z + root > 0))


DIVISION = _Division(model=LensModel("division", "k1", (0, 1)), ideal="a pinhole", wire_names=(("division", 1),))
"""The entry."""
