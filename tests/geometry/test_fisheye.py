"""The compiled fisheye loop against what the lens is by its definition, and where the image folds."""

import numpy as np
from numpy.testing import assert_allclose

from aerodft.geometry.kernels import meet_fisheye

INTRINSICS = (1000.0, 1100.0, 1010.0, 490.0)
NADIR = np.diag([1.0, -1.0, -1.0])  # a camera that looks straight down from a height of 1


def test_beyond_the_fold_nothing_is_seen():
    coefficients, limit = (-0.2, 0.0, 0.0, 0.0), np.sqrt(1 / 0.6)  # where d/da (a - 0.2 a^3) is 0
    edge_px = 1010.0 + 1000.0 * (limit - 0.2 * limit**3)
    u = np.concatenate([np.linspace(0.0, edge_px - 0.01, 300), np.linspace(edge_px + 0.01, 4000.0, 300)])
    pixels, points = np.stack([u, np.full(600, 490.0)], axis=-1), np.empty((600, 2))
    meet_fisheye(pixels, (INTRINSICS, coefficients, limit), NADIR, np.zeros(2), points)
    assert np.array_equal(np.isnan(points[:, 0]), (u > edge_px) | (u < 2 * 1010.0 - edge_px))


def test_an_equidistant_lens_sees_the_tangent_of_its_angle():
    """Without coefficients the distance from the principal point is the angle; sideways it meets no ground."""
    angles = np.array([0.0, 0.3, 1.0, 1.5, 1.6, 3.0])
    pixels = np.stack([1010.0 + 1000.0 * angles, np.full(6, 490.0)], axis=-1)
    points = np.empty((6, 2))
    meet_fisheye(pixels, (INTRINSICS, (0.0, 0.0, 0.0, 0.0), np.pi), NADIR, np.array([5.0, 7.0]), points)
    wanted = np.where(angles < np.pi / 2, 5.0 + np.tan(angles), np.nan)
    assert_allclose(points[:, 0], wanted, rtol=1e-12)
    assert_allclose(points[:4, 1], 7.0, rtol=1e-12)
