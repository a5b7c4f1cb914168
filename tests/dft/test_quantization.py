"""Quantization error by Section 5.1's definition, against a plain loop over the 8 neighbours."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft.paper.tables import pixel_depth, quantization_column, quantization_error
from aerodft.model import Camera

SMALL = Camera.from_fov(name="small", width_px=12, height_px=9, hfov_rad=0.9, vfov_rad=0.7)


def depth_by_hand(camera, height, tilt, i, j):
    phi = (i - camera.width_px / 2) * camera.hfov_rad / camera.width_px
    psi = tilt + (camera.height_px / 2 - j) * camera.vfov_rad / camera.height_px
    if abs(psi) >= math.pi / 2:
        return math.inf
    y = height * math.tan(psi)
    return math.sqrt(height**2 + y**2 + (y * math.tan(phi)) ** 2)


def error_by_hand(camera, height, tilt, i, j):
    own = depth_by_hand(camera, height, tilt, i, j)
    if not math.isfinite(own):
        return math.nan
    around = [
        depth_by_hand(camera, height, tilt, i + di, j + dj)
        for di in (-1, 0, 1)
        for dj in (-1, 0, 1)
        if -0.5 <= i + di <= camera.width_px - 0.5 and -0.5 <= j + dj <= camera.height_px - 0.5
    ]
    return max(abs(other - own) for other in around)


def every_pixel(camera):
    return np.stack(np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px)), axis=-1).astype(float)


@given(height=st.floats(0.5, 300), tilt=st.floats(0, 2.0))
@settings(max_examples=60, deadline=None)
def test_every_pixel_is_as_the_loop_says(height, tilt):
    """Nadir, horizon in the image (infinite, NaN) and wholly above it included."""
    pixels = every_pixel(SMALL)
    found = quantization_error(SMALL, height, tilt, pixels)
    want = [[error_by_hand(SMALL, height, tilt, i, j) for i, j in row] for row in pixels]
    assert_allclose(found, want, rtol=1e-9, atol=1e-9)


def test_horizon_in_the_image():
    """Rows above it have no depth, the first row below it no bound, the next one a number."""
    step = SMALL.vfov_rad / SMALL.height_px
    tilt = math.pi / 2 - step * 1.2  # rows 0..3 above, psi of row 4 is 0.7 step below the horizon
    errors = quantization_error(SMALL, 10.0, tilt, every_pixel(SMALL))
    assert np.isnan(errors[:4]).all()
    assert np.isinf(errors[4]).all()
    assert np.isfinite(errors[5:]).all()


@pytest.mark.parametrize("pixel", [(-1.0, 4.0), (12.0, 4.0), (3.0, -0.6), (3.0, 9.0), (math.nan, 4.0)])
def test_outside_the_image_there_is_no_error(pixel):
    assert np.isnan(quantization_error(SMALL, 10.0, 0.5, np.array(pixel)))


def test_neighbours_outside_the_image_do_not_count():
    top = quantization_error(SMALL, 10.0, 0.9, np.array([6.0, 0.0]))
    down = [depth_by_hand(SMALL, 10.0, 0.9, i, j) for i, j in ((6, 0), (5, 1), (6, 1), (7, 1), (5, 0), (7, 0))]
    assert_allclose(top, max(abs(z - down[0]) for z in down), rtol=1e-12)


@given(height=st.floats(1, 50), tilt_deg=st.floats(30, 60))
@settings(max_examples=40, deadline=None)
def test_inside_the_middle_column_it_is_the_next_row_up(height, tilt_deg):
    """On the axis, Z = h / cos(psi): the closed form of the largest of the eight."""
    tilt = math.radians(tilt_deg)
    depth, error = quantization_column(SMALL, height, tilt)
    step = SMALL.vfov_rad / SMALL.height_px
    psi = tilt + (SMALL.height_px / 2 - np.arange(SMALL.height_px)) * step
    assert_allclose(depth, height / np.cos(psi), rtol=1e-9)
    lateral_offset = np.hypot(height / np.cos(psi + step), height * np.tan(psi + step) * math.tan(SMALL.hfov_rad / 12))
    assert_allclose(error[1:-1], (lateral_offset - depth)[1:-1], rtol=1e-9)


def test_column_and_shapes():
    pixels = every_pixel(SMALL)
    depth, error = quantization_column(SMALL, 10.0, 0.8, column_px=3.0)
    assert_allclose(depth, pixel_depth(SMALL, 10.0, 0.8, pixels)[:, 3])
    assert_allclose(error, quantization_error(SMALL, 10.0, 0.8, pixels)[:, 3])
    assert [quantization_error(SMALL, 10.0, 0.8, p).shape for p in (pixels[0, 0], pixels[0], pixels)] == [
        (), (12,), (9, 12)
    ]  # fmt: skip


@pytest.mark.parametrize("height", [0.0, -1.0, math.nan])
def test_a_camera_in_the_ground_is_refused(height):
    with pytest.raises(ValueError, match="must be above 0"):
        quantization_error(SMALL, height, 0.5, every_pixel(SMALL))
