"""Footprints and horizons against closed forms, and against what a pixel sees one by one."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft.maps import depth_map
from aerodft.geometry import (
    ElevationGrid,
    Plane,
    Terrain,
    camera_pose,
    footprint,
    horizon_line,
    matrix,
    pixels_from_rays,
    rays_from_pixels,
    ring_area,
)
from aerodft.model import Camera, LensModel

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
    assert_allclose(ring_area(corners), 64.0 * 480 * 50 / 510, rtol=1e-12)


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
    assert abs(ring_area(corners) - np.nansum(seen.gsd_m.astype(float) ** 2)) < 0.01 * ring_area(corners) + rim
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
    assert ring_area(whole) > 0


@pytest.mark.parametrize(
    ("tilt_deg", "max_range_m", "elevation_m"), [(130.0, 500.0, 0.0), (0.0, 40.0, 0.0), (0.0, 500.0, 60.0)]
)
def test_no_ground_no_footprint(tilt_deg, max_range_m, elevation_m):
    assert footprint(PLAIN, pose_of(tilt_deg), max_range_m, elevation_m) is None


def test_the_area_of_a_ring_is_signed_and_stays_far_from_the_origin():
    triangle = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]) + 5e6
    assert ring_area(triangle) == pytest.approx(6.0)
    assert ring_area(triangle[::-1]) == pytest.approx(-6.0)


def terrain_of(height_of, *, half_m=800.0, cell_m=5.0):
    axis = np.arange(-half_m, half_m + cell_m / 2, cell_m)
    east, north = np.meshgrid(axis, axis)
    heights = np.broadcast_to(np.asarray(height_of(east, north), dtype=float), east.shape)
    grid = ElevationGrid(east_m=-half_m, north_m=-half_m, cell_m=cell_m, heights_m=heights)
    return Terrain(grid, refraction=1.0 - 1e-12)  # as on a flat earth


def rise(uphill_rad, slope_rad):
    return lambda e, n: math.tan(slope_rad) * (e * math.sin(uphill_rad) + n * math.cos(uphill_rad))


@CAMERAS
@settings(max_examples=15, deadline=None)
@given(
    tilt_deg=st.floats(0.0, 100.0),
    roll_deg=st.floats(-50.0, 50.0),
    slope_deg=st.floats(0.0, 35.0),
    uphill_deg=st.floats(0.0, 360.0),
)
def test_every_corner_on_a_slope_is_on_the_images_border_or_as_far_as_can_be(
    camera, tilt_deg, roll_deg, slope_deg, uphill_deg
):
    slope, uphill, pose = math.radians(slope_deg), math.radians(uphill_deg), pose_of(tilt_deg, roll_deg, 20.0, 90.0)
    corners = footprint(camera, pose, 400.0, 2.0, Plane.sloping([0.0, 0.0, 0.0], slope, uphill))
    if corners is None:
        return
    away = np.column_stack([corners, 2.0 + rise(uphill, slope)(*corners.T)]) - pose.position_enu_m
    range_m = np.linalg.norm(away, axis=-1)
    assert np.max(range_m) < 400.0 * (1 + 1e-9)
    pixels = pixels_from_rays(camera, away @ matrix(pose.wxyz))
    for pixel, reach_m in zip(pixels, range_m, strict=True):
        assert reach_m > 400.0 * (1 - 1e-9) or on_border(camera, pixel)
    assert ring_area(corners) > 0


@pytest.mark.parametrize(("tilt_deg", "max_range_m"), [(0.0, 500.0), (50.0, 500.0), (75.0, 300.0), (95.0, 300.0)])
def test_terrain_that_is_a_plane_has_its_outline(tilt_deg, max_range_m):
    pose, slope, uphill = pose_of(tilt_deg, 8.0, 300.0, 60.0), math.radians(9.0), 1.1
    terrain = terrain_of(rise(uphill, slope))
    got = footprint(BROWN, pose, max_range_m, 1.0, terrain)
    want = footprint(BROWN, pose, max_range_m, 1.0, Plane.sloping([0.0, 0.0, 0.0], slope, uphill))
    assert ring_area(got) == pytest.approx(ring_area(want), rel=0.003)
    outline = want.astype(np.float32).reshape(-1, 1, 2)
    off_m = np.abs([cv2.pointPolygonTest(outline, point, True) for point in got.tolist()])
    assert np.max(off_m) < 0.01 * max_range_m
    assert np.median(off_m) < 0.03  # the curved border between corners, and the polygon's single precision


def test_hills_end_at_the_skyline():
    """No pixel's ground lies outside; where a ring's corner is no border pixel, a little higher there is none."""
    hills = terrain_of(lambda e, n: 25 * np.sin(e / 70) * np.sin(n / 90))
    pose = pose_of(80.0, 10.0, 30.0, 90.0)
    corners = footprint(FISHEYE, pose, 600.0, 0.0, hills)
    seen = depth_map(FISHEYE, pose, max_range_m=600.0, ground=hills)
    places = np.stack(seen.east_north_m(), axis=-1)[::9, ::9].reshape(-1, 2)
    outline = corners.astype(np.float32).reshape(-1, 1, 2)
    shown = places[~np.isnan(places[:, 0])].tolist()
    inside_m = np.array([cv2.pointPolygonTest(outline, place, True) for place in shown])
    assert np.min(inside_m) > -12.0  # skylines between two of its pixels
    assert np.mean(inside_m > -0.5) > 0.99
    up = hills.height_at(corners)
    away = np.column_stack([corners, up]) - pose.position_enu_m
    pixels = pixels_from_rays(FISHEYE, away @ matrix(pose.wxyz))
    ends = [k for k, pixel in enumerate(pixels) if not on_border(FISHEYE, pixel)]
    assert len(ends) > 100
    side = np.linalg.norm(away[ends, :2], axis=-1)
    level = away[ends] / side[:, None]
    higher = hills.meet(pose.position_enu_m, level + [0.0, 0.0, math.radians(0.2)], 0.0)
    assert not np.any(higher.range_m < 600.0)


def test_where_terrain_ends_its_outline_ends():
    corners = footprint(PLAIN, pose_of(85.0, 0.0, 0.0), 5000.0, 0.0, terrain_of(lambda e, _: 0 * e, half_m=300.0))
    assert corners[:, 1].max() == pytest.approx(300.0, abs=1e-3)
    assert np.count_nonzero(corners[:, 1] > 299.99) > 20
    assert ring_area(corners) > 0


@pytest.mark.parametrize("tilt_deg", [40.0, 140.0])
def test_ground_out_of_view_has_no_outline(tilt_deg):
    beside = terrain_of(lambda e, _: 0 * e, half_m=5.0, cell_m=1.0)
    assert footprint(PLAIN, pose_of(tilt_deg), 500.0, 0.0, beside) is None
    assert footprint(PLAIN, pose_of(tilt_deg), 500.0, 0.0, Plane.sloping([0, 0, 70.0], 0.1, 1.0)) is None
    above = Plane.sloping([0, 0, 0.0], 0.1, 1.0)
    assert (footprint(PLAIN, pose_of(tilt_deg), 500.0, 0.0, above) is None) == (tilt_deg > 90)
