"""A camera's turn, from points through OpenCV's projection: errors against stated stds, strays, and the lens's part."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerodft.geometry import (
    find_rotation,
    from_rotation_vector,
    inverse,
    matrix,
    multiply,
    rotated_pixels,
    to_rotation_vector,
)
from aerodft.model import Camera, CameraStd, LensModel

BROWN = Camera(
    name="brown",
    width_px=1920,
    height_px=1080,
    fx_px=1590.0,
    fy_px=1602.0,
    cx_px=971.0,
    cy_px=528.0,
    distortion=(-0.28, 0.09, 0.0012, -0.0007),
    std=CameraStd(focal_px=8.0, principal_point_px=5.0, distortion=(0.01, 0.01, 1e-4, 1e-4)),
)
FISHEYE = replace(
    BROWN, name="fisheye", lens=LensModel.FISHEYE, distortion=(-0.03, 0.004, 0.0, 0.0), fx_px=900.0, fy_px=905.0
)
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-12)


def by_opencv(camera, rotvec, pixels):
    """Where points at ``pixels`` are seen after the turn, by OpenCV alone."""
    intrinsics = np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])
    distortion, pixels = np.array(camera.distortion), np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
    if camera.lens is LensModel.FISHEYE:
        flat = cv2.fisheye.undistortPoints(pixels, intrinsics, distortion, criteria=STOP)
    else:
        flat = cv2.undistortPoints(pixels, intrinsics, distortion, criteria=STOP)
    rays = np.concatenate([flat, np.ones((len(flat), 1, 1))], axis=-1)
    project = cv2.fisheye.projectPoints if camera.lens is LensModel.FISHEYE else cv2.projectPoints
    return project(rays, np.asarray(rotvec, dtype=np.float64), np.zeros(3), intrinsics, distortion)[0].reshape(-1, 2)


def scattered(rng, count, camera=BROWN):
    return rng.uniform([250, 150], [camera.width_px - 250, camera.height_px - 150], size=(count, 2))


def error_rad(turn, rotvec):
    """``e`` with truth = exp(e) estimate, as the covariance means it."""
    return to_rotation_vector(multiply(from_rotation_vector(np.asarray(rotvec)), inverse(turn.wxyz)))


@pytest.mark.parametrize("camera", [BROWN, FISHEYE], ids=lambda camera: camera.name)
@settings(max_examples=25, deadline=None)
@given(rotvec=st.tuples(*[st.floats(-0.1, 0.1)] * 3), seed=st.integers(0, 1000))
def test_a_turn_without_noise_is_found_exactly(camera, rotvec, seed):
    then = scattered(np.random.default_rng(seed), 40, camera)
    now = by_opencv(camera, rotvec, then)
    np.testing.assert_allclose(rotated_pixels(camera, from_rotation_vector(np.array(rotvec)), then), now, atol=1e-5)
    turn = find_rotation(camera, then, now)
    assert turn is not None
    assert turn.inliers.all()
    np.testing.assert_allclose(error_rad(turn, rotvec), 0.0, atol=1e-8)


def test_errors_are_as_large_as_stated_with_two_thirds_of_the_points_astray():
    rng, z = np.random.default_rng(4), []
    for _ in range(150):
        then, rotvec = scattered(rng, 90), rng.normal(scale=0.03, size=3)
        now = by_opencv(BROWN, rotvec, then) + rng.normal(scale=0.3, size=(90, 2))
        now[:54] += rng.normal(scale=25.0, size=(54, 2))
        turn = find_rotation(BROWN, then, now)
        assert turn is not None
        assert np.count_nonzero(turn.inliers[:54]) <= 6
        z.append(np.linalg.solve(np.linalg.cholesky(turn.cov), error_rad(turn, rotvec)))
    np.testing.assert_allclose(np.std(z, axis=0), 1.0, atol=0.2)
    np.testing.assert_allclose(np.mean(z, axis=0), 0.0, atol=0.3)


@pytest.mark.parametrize("column", range(8))
def test_what_the_lens_adds_is_what_another_lens_gives(column):
    rotvec, then = (0.05, -0.07, 0.04), scattered(np.random.default_rng(1), 80)
    turn = find_rotation(BROWN, then, by_opencv(BROWN, rotvec, then))
    step = [0.5, 0.5, 0.5, 0.5, 1e-4, 1e-4, 1e-5, 1e-5][column]
    fields = ("fx_px", "fy_px", "cx_px", "cy_px")
    if column < len(fields):
        true = replace(BROWN, **{fields[column]: getattr(BROWN, fields[column]) + step})
    else:
        bent = list(BROWN.distortion)
        bent[column - 4] += step
        true = replace(BROWN, distortion=tuple(bent))
    seen = find_rotation(BROWN, then, by_opencv(true, rotvec, then))
    assert turn is not None
    assert seen is not None
    got = turn.jac_intrinsics[:, column] * step
    np.testing.assert_allclose(got, error_rad(seen, rotvec), atol=0.02 * np.linalg.norm(got) + 1e-9)


def test_a_pinhole_turn_is_the_homography_of_its_rotation():
    camera = replace(BROWN, distortion=(), std=CameraStd())
    rotvec, then = np.array([0.02, -0.04, 0.1]), scattered(np.random.default_rng(2), 30)
    intrinsics = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]])
    homography = intrinsics @ matrix(from_rotation_vector(rotvec)) @ np.linalg.inv(intrinsics)
    now = cv2.perspectiveTransform(then[:, None], homography)[:, 0]
    turn = find_rotation(camera, then, now)
    assert turn is not None
    np.testing.assert_allclose(error_rad(turn, rotvec), 0.0, atol=1e-9)


@pytest.mark.parametrize("count", [0, 1, 5])
def test_too_few_points_tell_nothing(count):
    then = scattered(np.random.default_rng(0), count)
    assert find_rotation(BROWN, then, then) is None


def test_points_that_all_go_their_own_way_tell_nothing():
    rng = np.random.default_rng(8)
    assert find_rotation(BROWN, scattered(rng, 60), scattered(rng, 60)) is None


def test_points_in_one_place_tell_nothing():
    then = np.full((20, 2), 700.0)
    assert find_rotation(BROWN, then, then) is None
