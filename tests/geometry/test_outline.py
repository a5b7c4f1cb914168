"""Footprints and horizons against closed forms, and against what a pixel sees one by one."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft.depth_map import depth_map
from aerodft.geometry.lens import rays_from_pixels
from aerodft.geometry.outline import footprint, horizon_line
from aerodft.geometry.poses import camera_pose
from aerodft.geometry.rotation import matrix
from aerodft.model.camera import Camera, LensModel

PLAIN = Camera(name="plain", width_px=640, height_px=480, fx_px=500.0, fy_px=510.0, cx_px=330.0, cy_px=228.0)
BROWN = replace(PLAIN, name="brown", distortion=(-0.2, 0.05, 0.002, -0.001, 0.0))
FISHEYE = replace(PLAIN, name="fisheye", lens=LensModel.FISHEYE, distortion=(0.03, -0.01, 0.002, 0.0))
ALL_ROUND = Camera(
    name="all round",
    width_px=801,
    height_px=801,
    fx_px=230.0,
    fy_px=230.0,
    cx_px=400.0,
    cy_px=400.0,
    lens=LensModel.FISHEYE,
)
ENDING = replace(PLAIN, name="ending", fx_px=250.0, fy_px=260.0, distortion=(-0.25, 0.0, 0.0, 0.0))
"""A lens whose model ends within the image."""
CAMERAS = pytest.mark.parametrize("camera", [PLAIN, BROWN, FISHEYE], ids=lambda camera: camera.name)


def pose_of(tilt_deg, roll_deg=0.0, heading_deg=0.0, height_m=50.0):
    tilt, roll, heading = map(math.radians, (tilt_deg, roll_deg, heading_deg))
    return camera_pose(
        height_agl_m=height_m, tilt_rad=tilt, roll_rad=roll, heading_rad=heading, east_m=10.0, north_m=-20.0
    )


def area(corners):
    x, y = (corners - corners[0]).T
    return 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)


def on_border(camera, pixel):
    u, v = pixel
    beside = min(abs(u + 0.5), abs(u - camera.width_px + 0.5)), min(abs(v + 0.5), abs(v - camera.height_px + 0.5))
    return min(beside) < 1e-4


@settings(max_examples=50, deadline=None)
@given(tilt_deg=st.floats(70.0, 110.0), roll_deg=st.floats(-170.0, 170.0), heading_deg=st.floats(0.0, 360.0))
def test_a_plain_horizon_is_the_straight_line_of_the_closed_form(tilt_deg, roll_deg, heading_deg):
    tilt, roll = math.radians(tilt_deg), math.radians(roll_deg)

    def elevation(pixels):
        """Of rays above the horizon, times their length: -cos(tilt) z + sin(tilt) (up in the image)."""
        x, y = ((pixels - [330.0, 228.0]) / [500.0, 510.0]).T
        return -math.cos(tilt) - math.sin(tilt) * (x * math.sin(roll) + y * math.cos(roll))

    corners = np.array([[-0.5, -0.5], [639.5, -0.5], [639.5, 479.5], [-0.5, 479.5]])
    signs = elevation(corners)
    lines = horizon_line(PLAIN, pose_of(tilt_deg, roll_deg, heading_deg))
    if np.min(np.abs(signs)) < 1e-3:
        return
    assert len(lines) == (1 if np.min(signs) < 0 < np.max(signs) else 0)
    for line in lines:
        assert_allclose(elevation(line), 0.0, atol=1e-9)
        assert on_border(PLAIN, line[0])
        assert on_border(PLAIN, line[-1])
        if abs(roll_deg) < 80:
            assert line[0, 0] < line[-1, 0]


@CAMERAS
def test_a_bent_horizon_sees_level_rays_and_ends_at_the_border(camera):
    pose = pose_of(80.0, 12.0, 222.0)
    (line,) = horizon_line(camera, pose)
    rays = rays_from_pixels(camera, line) @ matrix(pose.wxyz).T
    assert_allclose(rays[:, 2] / np.linalg.norm(rays, axis=-1), 0.0, atol=1e-9)
    assert on_border(camera, line[0])
    assert on_border(camera, line[-1])
    chord = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    bow_px = np.max(np.abs((line - line[0]) @ [-chord[1], chord[0]]))
    assert bow_px < 1e-6 if camera is PLAIN else bow_px > 3.0


def test_a_horizon_all_round_is_closed_and_one_out_of_view_is_none():
    (circle,) = horizon_line(ALL_ROUND, pose_of(0.0))
    assert_allclose(np.linalg.norm(circle - 400.0, axis=-1), 230.0 * math.pi / 2, atol=1e-6)
    assert_allclose(circle[0], circle[-1], atol=1e-6)
    assert horizon_line(PLAIN, pose_of(20.0)) == ()
    assert len(horizon_line(replace(ALL_ROUND, width_px=701, cx_px=350.0), pose_of(0.0))) == 2


def test_the_footprint_at_nadir_is_a_rectangle():
    corners = footprint(PLAIN, pose_of(0.0), 1000.0)
    assert_allclose(corners.min(axis=0), [10 - 330.5 * 0.1, -20 - (479.5 - 228) * 50 / 510], atol=1e-9)
    assert_allclose(corners.max(axis=0), [10 + (639.5 - 330) * 0.1, -20 + 228.5 * 50 / 510], atol=1e-9)
    assert_allclose(area(corners), 64.0 * 480 * 50 / 510, rtol=1e-12)


@pytest.mark.parametrize("camera", [PLAIN, BROWN, FISHEYE, ENDING], ids=lambda camera: camera.name)
@settings(max_examples=8, deadline=None)
@given(
    tilt_deg=st.floats(0.0, 95.0),
    roll_deg=st.floats(-50.0, 50.0),
    heading_deg=st.floats(0.0, 360.0),
    max_range_m=st.floats(60.0, 2000.0),
)
def test_the_footprint_holds_what_the_pixels_see(camera, tilt_deg, roll_deg, heading_deg, max_range_m):
    """Its area is the sum of the pixels' areas, and every pixel's ground is inside."""
    pose = pose_of(tilt_deg, roll_deg, heading_deg)
    seen = depth_map(camera, pose, max_range_m=max_range_m)
    count = np.count_nonzero(~np.isnan(seen.range_m))
    corners = footprint(camera, pose, max_range_m)
    if count < 2000:
        assert count < 50 or corners is not None
        return
    rim = 4.0 * max_range_m * np.nanmax(seen.gsd_m)  # pixels that the limit cuts
    assert abs(area(corners) - np.nansum(seen.gsd_m.astype(float) ** 2)) < 0.01 * area(corners) + rim
    east, north = (plane[24:-24:24, 24:-24:24].ravel() for plane in seen.east_north_m())
    outline = corners.astype(np.float32).reshape(-1, 1, 2)
    for point in np.stack([east, north], axis=-1)[~np.isnan(east)].tolist():
        assert cv2.pointPolygonTest(outline, point, True) > -0.002 * max_range_m


def test_the_footprint_ends_where_the_lens_model_does():
    """Radius r (1 - r^2 / 4) grows up to r = sqrt(4/3), the tangent of the largest angle."""
    corners = footprint(ENDING, pose_of(0.0), 1000.0)
    away = np.hypot(*(corners - [10.0, -20.0]).T)
    assert_allclose(away.max(), 50 * math.sqrt(4 / 3), rtol=1e-3)
    assert np.isnan(rays_from_pixels(ENDING, np.array([0.0, 0.0]))).all()


def test_the_footprint_ends_at_the_longest_range():
    corners = footprint(BROWN, pose_of(85.0, 5.0, 30.0), 500.0)
    away = np.hypot(*(corners - [10.0, -20.0]).T)
    reach = math.sqrt(500.0**2 - 50.0**2)
    assert_allclose(away.max(), reach, rtol=1e-9)
    assert np.count_nonzero(away > reach * (1 - 1e-9)) > 20
    whole = footprint(ALL_ROUND, pose_of(0.0), 100.0)
    assert_allclose(np.hypot(*(whole - [10.0, -20.0]).T), math.sqrt(100.0**2 - 50.0**2), rtol=1e-12)
    assert area(whole) > 0


@pytest.mark.parametrize(
    ("tilt_deg", "max_range_m", "elevation_m"), [(130.0, 500.0, 0.0), (0.0, 40.0, 0.0), (0.0, 500.0, 60.0)]
)
def test_no_ground_no_footprint(tilt_deg, max_range_m, elevation_m):
    assert footprint(PLAIN, pose_of(tilt_deg), max_range_m, elevation_m) is None
