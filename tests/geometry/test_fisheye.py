"""The compiled fisheye loops against the lens's own way, and where the image folds."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.geometry.fisheye import RAYS_AT_ONCE, fisheye_rays, meet_fisheye
from aerodft.geometry.intrinsics import rays_by_intrinsics
from aerodft.geometry.lens import rays_with_jacobian
from aerodft.model.camera import Camera, CameraStd, LensModel

INTRINSICS = (1000.0, 1100.0, 1010.0, 490.0)
LENSES = {
    "wide": ((0.05, -0.01, 0.002, -0.0005), np.pi),
    "folded": ((-0.12, 0.0, 0.0, 0.0), np.sqrt(1 / 0.36)),  # where d/da (a - 0.12 a^3) is 0
}
NADIR = np.diag([1.0, -1.0, -1.0])  # a camera that looks straight down from a height of 1


def camera_of(lens):
    fx, fy, cx, cy = INTRINSICS
    return Camera(
        name=lens,
        width_px=1920,
        height_px=1080,
        fx_px=fx,
        fy_px=fy,
        cx_px=cx,
        cy_px=cy,
        lens=LensModel.FISHEYE,
        distortion=LENSES[lens][0],
        std=CameraStd(focal_px=1.0, distortion=(1e-3,) * 4),
    )


@pytest.mark.parametrize("lens", LENSES)
def test_rays_and_what_they_depend_on_are_the_lenss(lens):
    pixels = np.concatenate([[[1010.0, 490.0]], np.random.default_rng(9).uniform([-900, -900], [2900, 1900], (999, 2))])
    rays, bends = np.full((11, RAYS_AT_ONCE), np.nan), np.full((8, RAYS_AT_ONCE), np.nan)
    fisheye_rays(pixels, (INTRINSICS, *LENSES[lens]), rays, bends)
    with np.errstate(invalid="ignore", divide="ignore"):  # beyond the fold
        few = [rays_with_jacobian(camera_of(lens), some) for some in np.split(pixels, 10)]
        by_coefficients = rays_by_intrinsics(camera_of(lens), pixels)[..., 4:]
    wanted = np.concatenate([each.rays_cam for each in few])
    seen = ~np.isnan(wanted[:, 0])
    assert np.array_equal(~np.isnan(rays[0, :1000]), seen)
    assert_allclose(rays[:3, :1000].T, wanted, rtol=0, atol=1e-12)
    by_px = rays[3:9, :1000].T.reshape(-1, 3, 2)
    assert_allclose(by_px[seen], np.concatenate([each.jac_px for each in few])[seen], rtol=1e-8, atol=1e-12)
    moved = -np.einsum("nij,njc->nic", by_px, bends[:, :1000].T.reshape(-1, 4, 2).swapaxes(-1, -2))
    assert_allclose(moved[seen], by_coefficients[seen], rtol=1e-8, atol=1e-12)


def test_beyond_the_fold_nothing_is_seen():
    coefficients, limit = LENSES["folded"]
    edge_px = 1010.0 + 1000.0 * (limit - 0.12 * limit**3)
    u = np.concatenate([np.linspace(0.0, edge_px - 0.01, 300), np.linspace(edge_px + 0.01, 4000.0, 300)])
    pixels, rays = np.stack([u, np.full(600, 490.0)], axis=-1), np.empty((11, RAYS_AT_ONCE))
    fisheye_rays(pixels, (INTRINSICS, coefficients, limit), rays, np.empty((0, RAYS_AT_ONCE)))
    assert np.array_equal(np.isnan(rays[0, :600]), u > edge_px)


def test_an_equidistant_lens_sees_the_tangent_of_its_angle():
    """Without coefficients the distance from the principal point is the angle; sideways it meets no ground."""
    angles = np.array([0.0, 0.3, 1.0, 1.5, 1.6, 3.0])
    pixels = np.stack([1010.0 + 1000.0 * angles, np.full(6, 490.0)], axis=-1)
    points = np.empty((6, 2))
    meet_fisheye(pixels, (INTRINSICS, (0.0, 0.0, 0.0, 0.0), np.pi), NADIR, np.array([5.0, 7.0]), points)
    wanted = np.where(angles < np.pi / 2, 5.0 + np.tan(angles), np.nan)
    assert_allclose(points[:, 0], wanted, rtol=1e-12)
    assert_allclose(points[:4, 1], 7.0, rtol=1e-12)
