"""One test for every statement in ``aerodft.conventions``."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft import conventions
from aerodft.dft import Request, Setup, project, to_ground_frame
from aerodft.geometry import (
    camera_angles,
    camera_attitude,
    camera_from_gimbal,
    camera_pose,
    from_rotation_vector,
    from_yaw_pitch_roll,
    matrix,
    multiply,
    pixels_from_rays,
    pose_covariance,
)
from aerodft.model import CODES, Camera, CameraStd, PoseSample, PoseStd, Probe, ProbeKind, ProjectionModel, Status
from tests.one_image import measure

EAST, NORTH, UP = np.eye(3)
RIGHT_CAM, DOWN_CAM, FORWARD_CAM = np.eye(3)
NANOMETRE = 1e-9

camera = Camera.from_fov(name="c", width_px=101, height_px=51, hfov_rad=1.2, vfov_rad=0.7)


def turned(wxyz, vector):
    return matrix(wxyz) @ vector


def test_pixel_zero_is_the_centre_of_the_top_left_pixel():
    assert (camera.cx_px, camera.cy_px) == (50.0, 25.0)  # the middle pixel of 101 x 51
    assert_allclose(pixels_from_rays(camera, FORWARD_CAM), [50.0, 25.0])


@pytest.mark.parametrize(("u", "inside"), [(-0.5, True), (-0.51, False), (100.5, True), (100.51, False)])
def test_image_spans_half_a_pixel_around_its_outermost_centres(u, inside):
    pose = camera_pose(height_agl_m=10.0, tilt_rad=0.0)
    status = CODES[int(project(camera, pose, np.array([[u, 25.0]]), 0.0, ProjectionModel.PINHOLE).status[0])]
    assert (status is Status.OK) is inside


def test_field_of_view_spans_the_whole_image_border_to_border():
    left = np.array([-math.tan(0.6), 0.0, 1.0])
    assert_allclose(pixels_from_rays(camera, left), [-0.5, 25.0])


def test_dft_model_takes_the_papers_centre():
    pose = camera_pose(height_agl_m=10.0, tilt_rad=0.5)
    ground = project(camera, pose, np.array([[50.5, 25.5]]), 0.0, ProjectionModel.DFT)
    assert_allclose(ground.points_enu_m[0], [0.0, 10 * math.tan(0.5), 0.0], atol=NANOMETRE)


def test_camera_axes_are_opencvs():
    pixel, _ = cv2.projectPoints(
        np.array([[0.3, -0.2, 1.0]]), np.zeros(3), np.zeros(3), np.array([[90.0, 0, 50], [0, 80, 25], [0, 0, 1]]), None
    )
    ours = replace(camera, fx_px=90.0, fy_px=80.0)
    assert_allclose(pixels_from_rays(ours, np.array([0.3, -0.2, 1.0])), pixel[0, 0])


@pytest.mark.parametrize("heading_deg", [0.0, 77.0, 250.0])
def test_tilt_is_from_straight_down(heading_deg):
    nadir = camera_attitude(0.0, 0.0, math.radians(heading_deg))
    horizon = camera_attitude(math.pi / 2, 0.0, math.radians(heading_deg))
    assert_allclose(turned(nadir, FORWARD_CAM), -UP, atol=NANOMETRE)
    assert_allclose(turned(horizon, FORWARD_CAM) @ UP, 0.0, atol=NANOMETRE)
    assert_allclose(turned(horizon, DOWN_CAM), -UP, atol=NANOMETRE)


def test_heading_is_clockwise_from_north():
    eastward = camera_attitude(math.pi / 2, 0.0, math.pi / 2)
    assert_allclose(turned(eastward, FORWARD_CAM), EAST, atol=NANOMETRE)
    assert_allclose(turned(eastward, RIGHT_CAM), -NORTH, atol=NANOMETRE)


def test_positive_roll_has_the_right_side_down():
    rolled = camera_attitude(1.0, 0.2, 0.7)
    assert turned(rolled, RIGHT_CAM) @ UP < 0
    about_axis = multiply(camera_attitude(1.0, 0.0, 0.7), from_rotation_vector(0.2 * FORWARD_CAM))
    assert_allclose(matrix(rolled), matrix(about_axis), atol=NANOMETRE)


def test_tilt_is_ninety_degrees_plus_gimbal_pitch():
    pitch = math.radians(-60.0)
    tilt, roll, heading = camera_angles(camera_from_gimbal(from_yaw_pitch_roll(math.radians(40.0), pitch, 0.0)))
    assert_allclose(np.degrees([tilt, roll, heading]), [30.0, 0.0, 40.0], atol=NANOMETRE)


def test_gimbal_roll_and_camera_roll_have_one_sign():
    _, roll, _ = camera_angles(camera_from_gimbal(from_yaw_pitch_roll(0.3, math.radians(-20.0), 0.1)))
    assert_allclose(roll, 0.1)


def test_enu_from_ned_is_its_own_inverse():
    once = np.array(conventions.ENU_SO3_NED_WXYZ)
    north_ned = np.array([1.0, 0.0, 0.0])
    assert_allclose(turned(once, north_ned), NORTH, atol=NANOMETRE)
    assert_allclose(turned(once, np.array([0.0, 0.0, 1.0])), -UP, atol=NANOMETRE)
    assert_allclose(turned(multiply(once, once), north_ned), north_ned, atol=NANOMETRE)


@pytest.mark.parametrize(("tilt_deg", "roll_deg"), [(0.0, 0.0), (0.0, 25.0), (30.0, 25.0), (67.0, -8.0)])
def test_ground_frame_has_y_ahead(tilt_deg, roll_deg):
    pose = camera_pose(
        height_agl_m=20.0,
        tilt_rad=math.radians(tilt_deg),
        roll_rad=math.radians(roll_deg),
        heading_rad=1.0,
        east_m=5.0,
        north_m=-3.0,
    )
    axis, up_in_image = turned(pose.wxyz, FORWARD_CAM), -turned(pose.wxyz, DOWN_CAM)
    ahead = axis if tilt_deg else up_in_image
    ahead = ahead * [1, 1, 0] / np.linalg.norm(ahead[:2])
    foot = pose.position_enu_m * [1, 1, 0]
    assert_allclose(to_ground_frame(pose, foot + 7.0 * ahead), [0.0, 7.0, 0.0], atol=NANOMETRE)
    assert_allclose(to_ground_frame(pose, foot + 7.0 * np.cross(ahead, UP)), [7.0, 0.0, 0.0], atol=NANOMETRE)


def test_quaternions_are_wxyz_and_hamilton():
    i, j, k = np.eye(4)[1:]
    assert_allclose(multiply(i, j), k)
    assert_allclose(matrix(-camera_attitude(0.3, 0.2, 0.1)), matrix(camera_attitude(0.3, 0.2, 0.1)))


def test_covariance_is_a_small_rotation_in_camera_axes_on_the_right():
    wxyz = camera_attitude(1.0, 0.3, 2.0)
    small = 1e-6
    raised = multiply(wxyz, from_rotation_vector(small * RIGHT_CAM))
    tilted, *_ = camera_angles(multiply(camera_attitude(1.0, 0.0, 2.0), from_rotation_vector(small * RIGHT_CAM)))
    assert_allclose(tilted, 1.0 + small, atol=1e-11)
    cov = pose_covariance(wxyz, PoseStd(tilt_rad=small).values)
    assert_allclose(cov[3:, 3:], np.diag([small**2, 0, 0]))
    assert_allclose(matrix(raised), matrix(wxyz) @ matrix(from_rotation_vector(small * RIGHT_CAM)))


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 80.0])
def test_heading_std_is_about_the_vertical(tilt_deg):
    wxyz = camera_attitude(math.radians(tilt_deg), 0.2, 2.0)
    cov = pose_covariance(wxyz, PoseStd(heading_rad=0.1).values)[3:, 3:]
    about_up = matrix(wxyz) @ cov @ matrix(wxyz).T
    assert_allclose(about_up, np.diag([0, 0, 0.01]), atol=NANOMETRE)


def test_nadir_covariance_is_regular():
    cov = pose_covariance(
        camera_attitude(0.0, 0.0, 0.0),
        PoseStd(height_agl_m=1.0, horizontal_m=1.0, tilt_rad=0.1, pan_rad=0.1, roll_rad=0.1).values,
    )
    assert np.linalg.cond(cov) < 1e3


@pytest.mark.parametrize("model", ProjectionModel)
def test_products_of_the_largest_numbers_are_finite(model):
    most = conventions.LARGEST
    pose = camera_pose(height_agl_m=most, tilt_rad=0.4, std=PoseStd(height_agl_m=most, tilt_rad=most, heading_rad=most))
    thin = replace(camera, fx_px=1e-9, fy_px=1e-9, cx_px=most, std=CameraStd(focal_px=most, principal_point_px=most))
    at = ((5.0, 20.0),)
    probe = Probe(name="p", kind=ProbeKind.POSITION, pixels=at, elevation_m=-most, elevation_std_m=most)
    request = Request(probe=probe, pixels=at, std_px=most)
    for each in (camera, thin):
        sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose)
        (refused,) = measure(Setup(camera=each, model=model), sample, (request,))
        assert refused.status in {Status.ILL_CONDITIONED, Status.ABOVE_HORIZON}
