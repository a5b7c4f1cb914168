"""The lens against OpenCV, and against itself as an exact inverse."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.geometry import pixels_from_rays, rays_from_pixels, rays_with_jacobian
from aerodft.model import Camera, LensModel

ROUND_TRIP_PX = 1e-9
OPENCV_PX = 1e-8

base = Camera(name="off-centre", width_px=1920, height_px=1080, fx_px=1000.0, fy_px=1100.0, cx_px=1010.0, cy_px=490.0)
LENSES = {
    "perfect": base,
    "brown": replace(base, distortion=(-0.3, 0.1, 1e-3, -2e-3, -0.01)),
    "rational": replace(base, distortion=(0.3, -0.1, 1e-3, 2e-3, 0.02, 0.2, 0.01, 0.001)),
    "fisheye": replace(base, lens=LensModel.FISHEYE, distortion=(0.05, -0.01, 0.002, -0.0005)),
}
pixels = st.tuples(st.floats(-0.5, 1919.5), st.floats(-0.5, 1079.5))


@pytest.mark.parametrize("lens", LENSES)
@given(pixel=pixels)
@settings(max_examples=200, deadline=None)
def test_rays_project_back_to_their_pixels(lens, pixel):
    camera = LENSES[lens]
    rays = rays_from_pixels(camera, np.array(pixel))
    assert_allclose(pixels_from_rays(camera, 3.0 * rays), pixel, atol=ROUND_TRIP_PX, rtol=0)


@pytest.mark.parametrize("lens", LENSES)
def test_projection_is_opencvs(lens):
    camera = LENSES[lens]
    grid = np.stack(np.meshgrid(np.linspace(0, 1919, 40), np.linspace(0, 1079, 30)), axis=-1).reshape(-1, 2)
    rays = rays_from_pixels(camera, grid)
    matrix = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]])
    coefficients = np.array(camera.distortion or (0.0, 0.0, 0.0, 0.0))
    zero = np.zeros(3)
    if camera.lens is LensModel.FISHEYE:
        theirs, _ = cv2.fisheye.projectPoints(rays[:, None], zero, zero, matrix, coefficients)
    else:
        theirs, _ = cv2.projectPoints(rays, zero, zero, matrix, coefficients)
    assert_allclose(theirs.reshape(-1, 2), grid, atol=OPENCV_PX, rtol=0)


@pytest.mark.parametrize("lens", LENSES)
@given(pixel=pixels)
@settings(max_examples=50, deadline=None)
def test_jacobians_are_the_finite_differences(lens, pixel):
    camera, step = LENSES[lens], 1e-3
    rays = rays_with_jacobian(camera, np.array(pixel))
    for axis in (0, 1):
        shift = step * np.eye(2)[axis]
        difference = rays_from_pixels(camera, pixel + shift) - rays_from_pixels(camera, pixel - shift)
        assert_allclose(rays.jac_px[:, axis], difference / (2 * step), atol=1e-9)


@pytest.mark.parametrize("shape", [(), (1,), (5,), (2, 3)])
def test_leading_axes_are_batch(shape):
    camera = LENSES["brown"]
    batch = np.random.default_rng(1).uniform(0, 1000, (*shape, 2))
    rays = rays_with_jacobian(camera, batch)
    assert rays.rays_cam.shape == (*shape, 3)
    assert rays.jac_px.shape == (*shape, 3, 2)
    one_by_one = np.array([rays_from_pixels(camera, pixel) for pixel in batch.reshape(-1, 2)]).reshape(*shape, 3)
    assert np.array_equal(rays.rays_cam, one_by_one)


def test_beyond_the_valid_radius_there_is_no_ray_and_no_pixel():
    camera = replace(base, distortion=(-0.42, 0.25, 0.0, 0.0, -0.1))
    rays = rays_from_pixels(camera, np.array([[960.0, 540.0], [-300.0, -300.0]]))
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1]).all()
    assert np.isnan(pixels_from_rays(camera, np.array([2.0, 1.0, 1.0]))).all()


def test_behind_the_camera_there_is_no_pixel():
    assert np.isnan(pixels_from_rays(base, np.array([0.1, 0.1, -1.0]))).all()


def test_fisheye_sees_beyond_a_right_angle():
    camera = replace(LENSES["fisheye"], distortion=(0.0, 0.0, 0.0, 0.0))
    ray = np.array([np.sin(1.7), 0.0, np.cos(1.7)])
    assert_allclose(pixels_from_rays(camera, ray), [1010.0 + 1700.0, 490.0])


def test_a_coefficient_of_next_to_nothing_is_nothing():
    """Its reciprocal is infinite, and what a polynomial is divided by to find its roots."""
    none = replace(LENSES["fisheye"], distortion=(0.0, 0.0, 0.0, 0.0))
    next_to_none = replace(none, distortion=(1e-320, 0.0, 0.0, 5e-324))
    pixels = np.array([[5.0, 5.0], [900.0, 700.0]])
    assert_allclose(rays_from_pixels(next_to_none, pixels), rays_from_pixels(none, pixels))


@pytest.mark.parametrize("distortion", [(-0.3, 0.1, 0.003, -0.002, -0.01), (-0.25, 0.0, 0.0, 0.0)])
def test_many_pixels_have_the_rays_of_few(distortion):
    """A compiled loop undistorts many pixels; a few go the slow and sure way. Some lie beyond the lens model."""
    camera = Camera(
        name="c", width_px=640, height_px=480, fx_px=250.0, fy_px=260.0, cx_px=330.0, cy_px=228.0, distortion=distortion
    )
    pixels = np.random.default_rng(4).uniform([0, 0], [640, 480], (600, 2))
    few = np.concatenate([rays_from_pixels(camera, part) for part in np.split(pixels, 6)])
    many = rays_from_pixels(camera, np.asfortranarray(pixels))
    assert_allclose(many, few, rtol=1e-9, atol=1e-11)
    assert np.isnan(few).any() == (len(distortion) == 4)


@pytest.mark.parametrize("bent", [(), (-0.2, 0.05, 1e-3, -1e-3, 0.01)])
def test_rays_of_many_pixels_are_those_with_derivatives(bent):
    """Of a whole image derivatives are left out; a strong lens has pixels without a ray."""
    camera = Camera(
        name="wide", width_px=400, height_px=300, fx_px=120.0, fy_px=118.0, cx_px=196.0, cy_px=153.0, distortion=bent
    )
    pixels = np.stack(np.meshgrid(np.arange(400.0), np.arange(300.0)), axis=-1)
    np.testing.assert_array_equal(rays_from_pixels(camera, pixels), rays_with_jacobian(camera, pixels).rays_cam)
