"""Ground points against OpenCV and the paper's closed forms; Jacobians against finite differences."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from aerodft.dft import ELEVATION, POSITION, ROTATION, project, shared_count
from aerodft.geometry import Plane, camera_pose, from_rotation_vector, matrix, multiply
from aerodft.model import CODES, Camera, CameraStd, LensModel, Pose, ProjectionModel, Status

MICROMETRE = 1e-6
PINHOLE, DFT = ProjectionModel.PINHOLE, ProjectionModel.DFT

camera = Camera(
    name="c",
    width_px=1920,
    height_px=1080,
    fx_px=1600.0,
    fy_px=1620.0,
    cx_px=990.0,
    cy_px=500.0,
    distortion=(-0.1, 0.02, 1e-3, -1e-3),
)


def opencv_pixels(pose, points_enu_m):
    cam_r_enu = matrix(pose.wxyz).T
    rotation_vector = Rotation.from_matrix(cam_r_enu).as_rotvec()  # cv2.Rodrigues loses half its digits near pi
    intrinsics = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]])
    translation = -cam_r_enu @ pose.position_enu_m
    pixels, _ = cv2.projectPoints(points_enu_m, rotation_vector, translation, intrinsics, np.array(camera.distortion))
    return pixels.reshape(-1, 2)


@given(
    height=st.floats(2, 300),
    tilt=st.floats(0, 1.4),
    roll=st.floats(-3.1, 3.1),
    heading=st.floats(0, 6.28),
    elevation=st.floats(-2, 1.5),
    u=st.floats(0, 1919),
    v=st.floats(0, 1079),
)
@settings(max_examples=300, deadline=None)
def test_ground_points_project_to_their_pixels_in_opencv(height, tilt, roll, heading, elevation, u, v):
    pose = camera_pose(
        height_agl_m=height, tilt_rad=tilt, roll_rad=roll, heading_rad=heading, east_m=12.0, north_m=-5.0
    )
    ground = project(camera, pose, np.array([[u, v]]), elevation, PINHOLE)
    assume(ground.status[0] == CODES.index(Status.OK))
    assume(ground.depression_rad[0] > math.radians(0.2))
    assert ground.points_enu_m[0, 2] == elevation
    range_m = np.linalg.norm(ground.points_enu_m[0] - pose.position_enu_m)
    assert_allclose(
        opencv_pixels(pose, ground.points_enu_m), [[u, v]], atol=1e-6, err_msg=f"range {range_m:.1f} m", rtol=0
    )


@given(i=st.floats(0, 3887), j=st.floats(0, 2591), height=st.floats(1, 100), tilt_deg=st.floats(0, 60))
@settings(max_examples=200, deadline=None)
def test_dft_is_the_papers_equations_2_to_6(i, j, height, tilt_deg):
    width, rows, hfov, vfov = 3888, 2592, math.radians(64.3), math.radians(45.3)
    canon = Camera.from_fov(name="Canon 1000D", width_px=width, height_px=rows, hfov_rad=hfov, vfov_rad=vfov)
    pose = camera_pose(height_agl_m=height, tilt_rad=math.radians(tilt_deg))
    ground = project(canon, pose, np.array([[i, j]]), 0.0, DFT)
    phi = (i - width / 2) * (hfov / width)
    psi = math.radians(tilt_deg) + (rows / 2 - j) * (vfov / rows)
    y = height * math.tan(psi)
    x = y * math.tan(phi)
    assert_allclose(ground.points_enu_m[0], [x, y, 0.0], atol=MICROMETRE, rtol=1e-9)
    z = math.sqrt(height**2 + y**2 + x**2)
    assert_allclose(np.linalg.norm(ground.points_enu_m[0] - pose.position_enu_m), z, atol=MICROMETRE)


def perturbed(pose, shift):
    turn = from_rotation_vector(shift[ROTATION])
    return Pose(position_enu_m=pose.position_enu_m + shift[POSITION], wxyz=multiply(pose.wxyz, turn))


def perturbed_camera(lens, shift):
    fx, fy, cx, cy = shift[7:11]
    bent = tuple(np.array(lens.distortion) + shift[11:]) if len(shift) > 11 else lens.distortion
    return replace(
        lens,
        fx_px=lens.fx_px + fx,
        fy_px=lens.fy_px + fy,
        cx_px=lens.cx_px + cx,
        cy_px=lens.cy_px + cy,
        distortion=bent,
    )


def uncertain(lens):
    return replace(lens, std=CameraStd(distortion=(0.001,) * len(lens.distortion)))


LENSES = {
    "brown": uncertain(camera),
    "rational": uncertain(replace(camera, distortion=(0.3, -0.1, 1e-3, -1e-3, 0.02, 0.35, -0.08, 0.01))),
    "fisheye": uncertain(replace(camera, lens=LensModel.FISHEYE, distortion=(0.05, -0.01, 0.004, -0.001))),
    "exact": camera,
}
GROUNDS = {"level": None, "slope": Plane.sloping([3.0, 1.0, 2.0], 0.2, 1.0)}


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
@pytest.mark.parametrize("surface", GROUNDS.values(), ids=GROUNDS)
@given(
    tilt=st.floats(0, 1.1),
    roll=st.floats(-0.5, 0.5),
    heading=st.floats(0, 6.28),
    u=st.floats(0, 1919),
    v=st.floats(300, 1079),
)
@settings(max_examples=25, deadline=None)
def test_pinhole_jacobian_is_the_finite_difference(lens, surface, tilt, roll, heading, u, v):
    pose = camera_pose(height_agl_m=50.0, tilt_rad=tilt, roll_rad=roll, heading_rad=heading)
    pixels, step = np.array([[u, v]]), 1e-6
    ground = project(lens, pose, pixels, 1.0, PINHOLE, surface)
    assume(ground.status[0] == 0 and np.linalg.norm(ground.points_enu_m - pose.position_enu_m) < 300)
    for column in range(shared_count(lens)):
        shift = step * np.eye(shared_count(lens))[column]
        ends = [
            project(
                perturbed_camera(lens, s), perturbed(pose, s), pixels, 1.0 + s[ELEVATION], PINHOLE, surface
            ).points_enu_m
            for s in (shift, -shift)
        ]
        want = (ends[0] - ends[1])[0] / (2 * step)
        assert_allclose(ground.jac_shared[0, :, column], want, rtol=1e-5, atol=1e-4, err_msg=f"column {column}")
    for axis in (0, 1):
        shift = step * np.eye(2)[axis]
        ends = [project(lens, pose, pixels + s, 1.0, PINHOLE, surface).points_enu_m for s in (shift, -shift)]
        assert_allclose(ground.jac_px[0, :, axis], (ends[0] - ends[1])[0] / (2 * step), rtol=1e-5, atol=1e-5)


@given(tilt=st.floats(0.1, 1.0), heading=st.floats(0, 6.28), u=st.floats(0, 1919), v=st.floats(300, 1079))
@settings(max_examples=40, deadline=None)
def test_the_papers_jacobian_is_the_finite_difference(tilt, heading, u, v):
    plain = Camera.from_fov(name="p", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.7)
    pose = camera_pose(height_agl_m=50.0, tilt_rad=tilt, heading_rad=heading)
    pixels, step, columns = np.array([[u, v]]), 1e-6, (0, 1, 2, 3, ELEVATION, 7, 8)
    ground = project(plain, pose, pixels, 1.0, DFT)
    for column in columns:
        shift = step * np.eye(shared_count(plain))[column]
        ends = [
            project(perturbed_camera(plain, s), perturbed(pose, s), pixels, 1.0 + s[ELEVATION], DFT).points_enu_m
            for s in (shift, -shift)
        ]
        want = (ends[0] - ends[1])[0] / (2 * step)
        assert_allclose(ground.jac_shared[0, :, column], want, rtol=1e-5, atol=1e-4, err_msg=f"column {column}")


@pytest.mark.parametrize("model", [PINHOLE, DFT])
@pytest.mark.parametrize(
    ("tilt_deg", "elevation", "pixel", "status"),
    [
        (30.0, 0.0, (960.0, 540.0), Status.OK),
        (30.0, 0.0, (-1.0, 540.0), Status.OUT_OF_IMAGE),
        (30.0, 0.0, (math.nan, 540.0), Status.OUT_OF_IMAGE),
        (89.0, 0.0, (960.0, 10.0), Status.ABOVE_HORIZON),
        (30.0, 10.0, (960.0, 540.0), Status.BELOW_SURFACE),
        (30.0, 11.0, (960.0, 540.0), Status.BELOW_SURFACE),
    ],
)
def test_misses_have_a_status_and_no_number(model, tilt_deg, elevation, pixel, status):
    pose = camera_pose(height_agl_m=10.0, tilt_rad=math.radians(tilt_deg))
    ground = project(camera, pose, np.array([pixel]), elevation, model)
    assert CODES[ground.status[0]] is status
    assert np.isfinite(ground.points_enu_m[0]).all() == (status is Status.OK)


def test_paper_equation_5_is_half_of_the_truth_at_30_degrees():
    """DESIGN's warning in figures: the paper's X at 30 degrees of tilt, beside the pinhole's."""
    plain = Camera.from_fov(name="p", width_px=1000, height_px=1000, hfov_rad=1.0, vfov_rad=1.0)
    pose = camera_pose(height_agl_m=10.0, tilt_rad=math.radians(30.0))
    pixel = np.array([[600.0, 499.5]])
    paper = project(plain, pose, pixel, 0.0, DFT).points_enu_m[0, 0]
    truth = project(plain, pose, pixel, 0.0, PINHOLE).points_enu_m[0, 0]
    assert 0.45 < paper / truth < 0.55
