"""Standard deviations of whole depth maps against drawn errors, and against the engine's of single pixels."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft import POSITION, project, shared_covariance
from aerodft.dft.maps import depth_map, plane_at_elevation, range_std
from aerodft.geometry import Plane, camera_pose, matrix
from aerodft.model import Camera, CameraStd, LensModel, PoseStd, ProjectionModel

STD = CameraStd(focal_px=1.0, principal_point_px=0.5)
PLAIN = Camera(name="plain", width_px=48, height_px=36, fx_px=60.0, fy_px=55.0, cx_px=20.0, cy_px=19.0, std=STD)
BROWN = replace(PLAIN, distortion=(-0.2, 0.05, 0.002, -0.001), std=replace(STD, distortion=(0.01, 0.01, 1e-3, 1e-3)))
FISHEYE = replace(PLAIN, lens=LensModel.FISHEYE, distortion=(0.03, -0.01, 0.002, 0.0))
POSE_STD = PoseStd(height_agl_m=0.3, horizontal_m=0.4, tilt_rad=0.003, pan_rad=0.002, roll_rad=0.004, heading_rad=0.01)
PIXELS = np.stack(np.meshgrid(np.arange(48.0), np.arange(36.0)), axis=-1)
DRAWS = 40_000


def pose_of(tilt_deg, roll_deg=0.0):
    angles = {"tilt_rad": math.radians(tilt_deg), "roll_rad": math.radians(roll_deg), "heading_rad": 0.7}
    pose = camera_pose(height_agl_m=40.0, **angles, std=POSE_STD)
    motion = {"velocity_enu_mps": np.array([3.0, 1.0, 2.0]), "rate_cam_radps": np.array([0.1, 0.0, 0.2])}
    return replace(pose, **motion, time_std_s=0.02)


@pytest.mark.parametrize("camera", [PLAIN, BROWN, FISHEYE, replace(PLAIN, std=CameraStd())], ids=range(4))
@settings(max_examples=10, deadline=None)
@given(tilt_deg=st.floats(0.0, 95.0), roll_deg=st.floats(-40.0, 40.0), slope_deg=st.floats(0.0, 30.0))
def test_every_pixel_is_known_as_well_as_when_it_is_measured_alone(camera, tilt_deg, roll_deg, slope_deg):
    pose, ground = pose_of(tilt_deg, roll_deg), Plane.sloping([0.0, 0.0, 0.0], math.radians(slope_deg), 2.0)
    got = range_std(camera, pose, plane_at_elevation(ground, 1.0), 0.2)
    alone = project(camera, pose, PIXELS.reshape(-1, 2), 1.0, ProjectionModel.PINHOLE, ground)
    with np.errstate(all="ignore"):
        away = alone.points_enu_m - pose.position_enu_m
        range_m = np.linalg.norm(away, axis=-1)
        by = np.einsum("ki,kij->kj", away / range_m[:, None], alone.jac_shared)
        by[:, POSITION] -= away / range_m[:, None]
        want = np.sqrt(np.einsum("ki,ij,kj->k", by, shared_covariance(camera, pose, 0.2), by))
    clear = (alone.status == 0) & (range_m < 2000.0)
    assert_allclose(got.ravel()[clear], want[clear], rtol=1e-3)
    seen = depth_map(camera, pose, 1.0, 2000.0, ground)
    assert np.array_equal(np.isfinite(seen.range_m) & np.isfinite(got), np.isfinite(seen.range_m))


def drawn_ranges_m(pose, pixel, plane, rng):
    """Slant ranges with drawn errors, rays by OpenCV, the plane met in closed form."""
    moves = rng.multivariate_normal(np.zeros(6), pose.cov, DRAWS)
    late = rng.normal(0.0, pose.time_std_s, (DRAWS, 1))
    moves += late * np.concatenate([pose.velocity_enu_mps, pose.rate_cam_radps])
    share, shift = rng.normal(0.0, STD.focal_px / PLAIN.fx_px, DRAWS), rng.normal(0.0, 0.5, (DRAWS, 2))
    # A longer lens, an axis that is elsewhere: the same as another pixel.
    u = PLAIN.cx_px + (pixel[0] - PLAIN.cx_px - shift[:, 0]) / (1 + share)
    v = PLAIN.cy_px + (pixel[1] - PLAIN.cy_px - shift[:, 1]) / (1 + share)
    intrinsics = np.array([[PLAIN.fx_px, 0, PLAIN.cx_px], [0, PLAIN.fy_px, PLAIN.cy_px], [0, 0, 1.0]])
    xy = cv2.undistortPoints(np.stack([u, v], axis=-1)[:, None], intrinsics, np.zeros(4))[:, 0]
    rays = np.column_stack([xy, np.ones(DRAWS)])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    rays += np.cross(moves[:, 3:], rays)
    rays_enu = rays @ matrix(pose.wxyz).T
    above_m = (pose.position_enu_m + moves[:, :3]) @ plane.normal_enu - plane.offset_m
    return -above_m / (rays_enu @ plane.normal_enu)


@pytest.mark.parametrize(("tilt_deg", "slope_deg"), [(0.0, 0.0), (40.0, 0.0), (60.0, 15.0)])
def test_drawn_errors_spread_as_much(tilt_deg, slope_deg):
    pose, plane = pose_of(tilt_deg, 10.0), Plane.sloping([0.0, 0.0, 0.0], math.radians(slope_deg), 0.5)
    got, rng = range_std(PLAIN, pose, plane), np.random.default_rng(4)
    for pixel in ((3, 30), (24, 18), (44, 12)):
        drawn = np.std(drawn_ranges_m(pose, pixel, plane, rng))
        assert got[pixel[1], pixel[0]] == pytest.approx(drawn, rel=0.03)


def test_nothing_is_known_of_what_is_not_seen():
    pose = pose_of(95.0)
    got = range_std(PLAIN, pose, plane_at_elevation(None, 0.0))
    assert np.array_equal(np.isnan(got), np.isnan(depth_map(PLAIN, pose).range_m))
    assert np.all(np.isnan(range_std(PLAIN, pose, plane_at_elevation(None, 40.0))))
    exact = camera_pose(height_agl_m=40.0, tilt_rad=0.3)
    assert np.all(range_std(replace(PLAIN, std=CameraStd()), exact, plane_at_elevation(None, 0.0)) == 0.0)
