"""Where things stand by their outlines: against upright boards that are projected corner by corner."""

import itertools
import math

import cv2
import numpy as np
import pytest

from aerodft.dft import down_in_image, locate_box, locate_outline, simplify_outline
from aerodft.geometry import camera_pose, inverse, matrix, pixels_from_rays
from aerodft.model import Camera, FloatArray, Pose
from aerodft.vision.objects.moving import outlines_of

HALF_PIXEL = 0.5
CAMERA = Camera(
    name="c",
    width_px=1280,
    height_px=720,
    fx_px=900.0,
    fy_px=910.0,
    cx_px=650.0,
    cy_px=350.0,
    distortion=(-0.1, 0.02, 0.0003, -0.0002, 0.0),
)
POSES = [
    camera_pose(height_agl_m=height, tilt_rad=math.radians(tilt), roll_rad=math.radians(roll), heading_rad=0.4)
    for height, tilt, roll in itertools.product((6.0,), (30.0, 60.0, 78.0), (-25.0, 0.0, 12.0))
]


def pixels_of(pose: Pose, points_enu_m: FloatArray) -> FloatArray:
    return pixels_from_rays(CAMERA, (points_enu_m - pose.position_enu_m) @ matrix(inverse(pose.wxyz)).T)


def board(pose: Pose, aside_m: float, height_m: float = 1.8, width_m: float = 0.5) -> tuple[FloatArray, FloatArray]:
    """Its corners in the image, and the middles of its foot and of its top; it faces the camera."""
    axis = matrix(pose.wxyz)[:, 2]
    ahead = axis[:2] / np.linalg.norm(axis[:2])
    right = np.array([ahead[1], -ahead[0]])
    distance = pose.position_enu_m[2] * math.tan(min(math.acos(-axis[2]), math.radians(70.0)))
    foot = np.append(ahead * distance + right * aside_m, 0.0)
    to_foot = foot[:2] / np.linalg.norm(foot[:2])
    half = np.append(np.array([to_foot[1], -to_foot[0]]) * width_m / 2, 0.0)
    up = np.array([0.0, 0.0, height_m])
    corners = np.array([foot - half, foot + half, foot + half + up, foot - half + up])
    return pixels_of(pose, corners), pixels_of(pose, np.array([foot, foot + up]))


@pytest.mark.parametrize("aside_m", [-1.5, 0.0, 1.0])
@pytest.mark.parametrize("pose", POSES)
def test_a_board_stands_where_its_foot_is_projected_to(pose: Pose, aside_m: float) -> None:
    corners, (foot, top) = board(pose, aside_m)
    seen = locate_outline(CAMERA, pose, corners)
    assert np.linalg.norm(seen.foot_px - foot) < 2 * HALF_PIXEL
    assert np.linalg.norm(seen.top_px - top) < 4 * HALF_PIXEL, "seen from above, corners are farther from the nadir"
    assert np.linalg.norm(seen.foot_px - np.mean(corners, axis=0)) > 40 * HALF_PIXEL
    off = np.linalg.norm(seen.sides_px - corners[:2], axis=-1)
    assert np.max(off) < 3 * HALF_PIXEL, "its sides are those of its foot, which the top hides when seen from above"


def test_the_lowest_row_is_not_the_foot_where_the_camera_is_rolled() -> None:
    corners, (foot, _) = board(POSES[3], 0.0, width_m=0.1)  # rolled by 25 degrees
    seen = locate_outline(CAMERA, POSES[3], corners)
    high_and_wide = np.array([corners[:, 0].mean(), corners[:, 1].max()])
    assert np.linalg.norm(high_and_wide - foot) > 20 * HALF_PIXEL
    assert np.linalg.norm(seen.foot_px - foot) < HALF_PIXEL


@pytest.mark.parametrize("aside_m", [-1.5, 0.0, 1.0])
@pytest.mark.parametrize("pose", POSES)
def test_a_drawn_board_is_found_to_a_pixel_and_the_foot_s_covariance_covers_it(pose: Pose, aside_m: float) -> None:
    corners, (foot, top) = board(pose, aside_m)
    mask = np.zeros((CAMERA.height_px, CAMERA.width_px), dtype=np.uint8)
    cv2.fillPoly(mask, [np.round(corners * 16).astype(np.int32)], 1, shift=4)
    (outline,) = outlines_of(mask > 0)
    seen = locate_outline(CAMERA, pose, outline, edge_std_px=0.7)
    off = seen.foot_px - foot
    assert np.linalg.norm(seen.top_px - top) < 5 * HALF_PIXEL
    down = down_in_image(CAMERA, pose, outline)
    assert down is not None
    assert abs(off @ down) < 4 * HALF_PIXEL
    assert off @ np.linalg.solve(seen.foot_cov_px2, off) < 9.2, "99 % of two normal numbers"


@pytest.mark.parametrize("pose", POSES)
def test_a_box_around_a_thin_thing_gives_the_corner_that_it_stands_in(pose: Pose) -> None:
    corners, (foot, top) = board(pose, 0.7, width_m=0.02)
    low, high = corners.min(axis=0), corners.max(axis=0)
    box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    seen = locate_box(box, down_in_image(CAMERA, pose, corners))
    assert np.linalg.norm(seen.foot_px - foot) < 6 * HALF_PIXEL
    assert np.linalg.norm(seen.top_px - top) < 6 * HALF_PIXEL


def test_a_box_in_an_upright_camera_stands_on_the_middle_of_its_lower_side() -> None:
    seen = locate_box((100.0, 200.0, 140.0, 300.0), down_in_image(CAMERA, None, np.zeros((1, 2))))
    np.testing.assert_allclose(seen.foot_px, [120.0, 300.0], atol=1e-12)
    np.testing.assert_allclose(seen.top_px, [120.0, 200.0], atol=1e-12)
    np.testing.assert_allclose(seen.sides_px, [[100.0, 300.0], [140.0, 300.0]], atol=1e-12)
    # Somewhere in the middle half of 40 px: 20 / sqrt(12), and a pixel for the edge.
    np.testing.assert_allclose(np.sqrt(np.diag(seen.foot_cov_px2)), [math.hypot(1.0, 20 / math.sqrt(12)), 1.0])


def test_right_below_the_camera_there_is_no_foot_and_the_std_says_so() -> None:
    pose = camera_pose(height_agl_m=6.0, tilt_rad=0.0)
    around = np.array([[600.0, 300.0], [700.0, 300.0], [700.0, 400.0], [600.0, 400.0]])
    assert down_in_image(CAMERA, pose, around) is None
    seen = locate_outline(CAMERA, pose, around)
    np.testing.assert_allclose(seen.foot_px, [650.0, 350.0])
    assert np.sqrt(seen.foot_cov_px2[0, 0]) > 25


def test_fewer_corners_keep_the_area() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 3000, endpoint=False)
    circle = 100.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    fewer = simplify_outline(circle)
    assert len(fewer) == 64
    assert cv2.contourArea(fewer.astype(np.float32)) == pytest.approx(math.pi * 100.0**2, rel=0.003)


def test_outlines_have_the_area_of_their_pixels_and_the_largest_is_first() -> None:
    mask = np.zeros((50, 60), dtype=bool)
    mask[10, 20] = True
    mask[30:34, 40:45] = True
    five, one = outlines_of(mask, slack_px=0.0)
    assert cv2.contourArea(five.astype(np.float32)) == pytest.approx(20.0)
    np.testing.assert_allclose([one.min(axis=0), one.max(axis=0)], [[19.5, 9.5], [20.5, 10.5]])
    assert outlines_of(np.zeros((4, 4), dtype=bool)) == []
