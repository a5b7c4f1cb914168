"""The compiled undistortion against the forward model, and against the lens's own way for a few pixels."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.geometry import pixels_from_rays, rays_from_pixels
from aerodft.geometry.kernels import brown, normalise, undistort
from aerodft.model import Camera

ROUNDING = 2e-15
INTRINSICS = (1000.0, 1100.0, 1010.0, 490.0)
LENSES = {
    "mild": (-0.1, 0.02, 5e-4, -3e-4, 0.0, 0.0, 0.0, 0.0),
    "barrel": (-0.35, 0.15, 1e-3, -2e-3, -0.02, 0.0, 0.0, 0.0),
    "pincushion": (0.3, 0.1, -1e-3, 2e-3, 0.02, 0.0, 0.0, 0.0),
    "rational": (0.3, -0.1, 1e-3, 2e-3, 0.02, 0.2, 0.01, 0.001),
    "folded": (-0.42, 0.25, 2e-3, 1e-3, -0.1, 0.0, 0.0, 0.0),
}


def camera_of(lens):
    fx, fy, cx, cy = INTRINSICS
    return Camera(
        name=lens, width_px=1920, height_px=1080, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, distortion=LENSES[lens]
    )


@pytest.mark.parametrize("lens", LENSES)
def test_what_is_undistorted_is_distorted_back_to_where_it_was(lens):
    rng = np.random.default_rng(3)
    wanted = rng.uniform(-0.7, 0.7, (5000, 2))
    distorted = np.stack(brown(LENSES[lens], *wanted.T)[:2], axis=-1)
    found = np.full((5000, 2), np.nan)
    undistort(distorted, LENSES[lens], 1.2, found)
    again = np.stack(brown(LENSES[lens], *found.T)[:2], axis=-1)
    assert_allclose(again, distorted, rtol=0, atol=ROUNDING)
    assert_allclose(found, wanted, rtol=0, atol=1e-13)


@pytest.mark.parametrize("lens", LENSES)
def test_the_forward_model_is_opencvs(lens):
    rays = np.concatenate([np.random.default_rng(4).uniform(-0.6, 0.6, (500, 2)), np.ones((500, 1))], axis=-1)
    theirs, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), np.array(LENSES[lens]))
    ours = np.stack(brown(LENSES[lens], rays[:, 0], rays[:, 1])[:2], axis=-1)
    assert_allclose(ours, theirs[:, 0], rtol=0, atol=1e-14)


@pytest.mark.parametrize("lens", LENSES)
def test_many_pixels_have_the_rays_of_a_few(lens):
    """Near the fold, where Newton's start matters, more of many than of a few may be found; never fewer."""
    camera = camera_of(lens)
    pixels = np.random.default_rng(5).uniform([-1500, -1500], [3500, 2500], (3000, 2))
    many = rays_from_pixels(camera, pixels)
    few = np.concatenate([rays_from_pixels(camera, some) for some in np.split(pixels, 30)])
    seen = ~np.isnan(many[:, 0])
    assert np.all(seen | np.isnan(few[:, 0]))
    assert np.count_nonzero(seen & np.isnan(few[:, 0])) <= 5
    assert_allclose(pixels_from_rays(camera, many[seen]), pixels[seen], rtol=0, atol=1e-9)
    assert_allclose(many[~np.isnan(few[:, 0])], few[~np.isnan(few[:, 0])], rtol=1e-12, atol=1e-13)


def test_where_the_image_folds_there_is_no_inverse():
    """On the axis u of a radial lens the largest distorted radius is known in closed form."""
    camera = replace(camera_of("folded"), distortion=(-0.25, 0.0, 0.0, 0.0))
    radius = np.sqrt(1 / 0.75)  # where d/dr (r - r^3 / 4) is 0
    edge_px = 1010.0 + 1000.0 * (radius - radius**3 / 4)
    u = np.concatenate([np.linspace(1010.0, edge_px - 0.01, 400), np.linspace(edge_px + 0.01, 5000.0, 400)])
    rays = rays_from_pixels(camera, np.stack([u, np.full(800, 490.0)], axis=-1))
    assert np.array_equal(np.isnan(rays[:, 0]), u > edge_px)


def test_what_is_not_a_number_stays_none():
    found = np.zeros((3, 2))
    undistort(np.array([[np.nan, 0.1], [0.1, np.inf], [0.1, 0.1]]), LENSES["mild"], np.inf, found)
    assert np.array_equal(np.isnan(found), [[True, True], [True, True], [False, False]])


def test_pixels_are_counted_from_the_principal_point():
    camera = replace(camera_of("mild"), distortion=())
    pixels, out = np.random.default_rng(7).uniform(0, 1000, (9, 2)), np.empty((9, 2))
    normalise(pixels, INTRINSICS, out)
    assert_allclose(out, rays_from_pixels(camera, pixels)[:, :2], rtol=1e-14, atol=1e-15)
