"""OpenCV's omnidirectional model (``cv2.omnidir``) of C. Mei and P. Rives, for catadioptric cameras and wide fisheyes.

A ray is projected to the unit sphere, from there to a plane as seen from ``xi`` behind the sphere's centre, and
distorted there by Brown's k1, k2, p1, p2. Focal lengths are OpenCV's, of that plane: ``1 + xi`` times those on the
axis.
"""

import numpy as np

from aerodft.geometry.lenses.brown import (
    distort_plane,
    inverse_2x2,
    plane_by_coefficients,
    undistort_plane,
    valid_radius,
)
from aerodft.geometry.lenses.model import Coefficients, Distorted, Lens
from aerodft.model import BoolArray, FloatArray, LensModel


class _Omnidirectional(Lens):
    def distort(self, coefficients: Coefficients, rays_cam: FloatArray) -> Distorted:
        xi, brown = _split(coefficients)
        plane, depth, is_valid = _to_plane(xi, rays_cam)
        points, by_plane = distort_plane(brown, plane)
        length = np.linalg.norm(rays_cam, axis=-1)
        depth_by_ray = xi * rays_cam / length[..., None] + [0.0, 0.0, 1.0]
        plane_by_ray = (np.eye(3)[:2] - plane[..., :, None] * depth_by_ray[..., None, :]) / depth[..., None, None]
        is_valid &= np.linalg.norm(plane, axis=-1) <= valid_radius(brown)
        return Distorted(points, by_plane @ plane_by_ray, is_valid)

    def undistort(self, coefficients: Coefficients, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        xi, brown = _split(coefficients)
        plane = undistort_plane(brown, points)
        plane_by_point = inverse_2x2(distort_plane(brown, plane)[1])
        square = np.sum(np.square(plane), axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(1 + (1 - xi * xi) * square)  # NaN beyond the sphere's outline
            scale = (xi + root) / (1 + square)
            by_square = ((1 - xi * xi) / (2 * root) - scale) / (1 + square)
        rays = np.concatenate([scale[..., None] * plane, (scale - xi)[..., None]], axis=-1)
        by_plane = np.empty((*plane.shape[:-1], 3, 2))
        by_plane[..., 2, :] = 2 * by_square[..., None] * plane
        by_plane[..., :2, :] = scale[..., None, None] * np.eye(2) + plane[..., :, None] * by_plane[..., 2:, :]
        rays[np.isnan(rays).any(axis=-1)] = np.nan
        return rays, by_plane @ plane_by_point

    def by_coefficients(self, coefficients: Coefficients, rays_cam: FloatArray) -> FloatArray:
        xi, brown = _split(coefficients)
        plane, depth, _ = _to_plane(xi, rays_cam)
        by_plane = distort_plane(brown, plane)[1]
        plane_by_xi = -plane * (np.linalg.norm(rays_cam, axis=-1) / depth)[..., None]
        by_brown = plane_by_coefficients(brown, plane)[..., :4]
        return np.concatenate([by_plane @ plane_by_xi[..., None], by_brown], axis=-1)


def _split(coefficients: Coefficients) -> tuple[float, Coefficients]:
    """Xi, and all coefficients of Brown's model."""
    return coefficients[0], (*coefficients[1:], 0.0, 0.0, 0.0, 0.0)


def _to_plane(xi: float, rays_cam: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Points ``(..., 2)`` on the plane, depths ``(...)`` of rays below the centre of projection, which rays it sees."""
    length = np.linalg.norm(rays_cam, axis=-1)
    depth = rays_cam[..., 2] + xi * length
    with np.errstate(invalid="ignore", divide="ignore"):
        plane = rays_cam[..., :2] / depth[..., None]
    # From farther than the sphere's radius it is seen up to its outline, from within up to half a turn less.
    return plane, depth, np.asarray((depth > 0) & (length + xi * rays_cam[..., 2] > 0))


OMNIDIRECTIONAL = _Omnidirectional(
    model=LensModel("omnidirectional", "xi k1 k2 p1 p2", (0, 1, 5)),
    ideal="a pinhole",
    wire_names=(("omnidirectional", 5),),
    opencv_key="xi",
)
"""The entry."""
