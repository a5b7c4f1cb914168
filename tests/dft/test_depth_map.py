"""Dense maps against the engine's own exact projection, and areas against derivatives."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft.depth_map import depth_map
from aerodft.dft.ground_map import GroundMap
from aerodft.dft.points import to_ground_frame
from aerodft.dft.projection import project
from aerodft.geometry.poses import camera_pose
from aerodft.model.camera import Camera, LensModel
from aerodft.model.measurement import ProjectionModel

PLAIN = Camera(name="plain", width_px=96, height_px=64, fx_px=80.0, fy_px=70.0, cx_px=40.0, cy_px=35.0)
BROWN = replace(PLAIN, name="brown", distortion=(-0.2, 0.05, 0.002, -0.001, 0.0))
FISHEYE = replace(PLAIN, name="fisheye", lens=LensModel.FISHEYE, distortion=(0.03, -0.01, 0.002, 0.0))
SINGLE = 4e-7  # of single precision: an angle, in rad
PIXELS = np.stack(np.meshgrid(np.arange(96.0), np.arange(64.0)), axis=-1)

angles = st.tuples(st.floats(0.0, 100.0), st.floats(-60.0, 60.0), st.floats(0.0, 360.0))


def pose_of(angles_deg, height_m=50.0):
    tilt, roll, heading = map(math.radians, angles_deg)
    return camera_pose(
        height_agl_m=height_m, tilt_rad=tilt, roll_rad=roll, heading_rad=heading, east_m=120.0, north_m=-40.0
    )


@pytest.mark.parametrize("camera", [PLAIN, BROWN, FISHEYE], ids=lambda camera: camera.name)
@settings(max_examples=25, deadline=None)
@given(angles_deg=angles, height_m=st.floats(2.0, 500.0), elevation_m=st.floats(-1.0, 1.0))
def test_every_pixel_is_where_the_exact_projection_has_it(camera, angles_deg, height_m, elevation_m):
    pose = pose_of(angles_deg, height_m)
    seen = depth_map(camera, pose, elevation_m)
    exact = project(camera, pose, PIXELS, elevation_m, ProjectionModel.PINHOLE)
    clear = np.abs(exact.depression_rad) > 1e-4
    good = clear & (exact.status == 0)
    assert np.array_equal(np.isnan(seen.range_m)[clear], (exact.status != 0)[clear])
    range_m = np.linalg.norm(exact.points_enu_m - pose.position_enu_m, axis=-1)[good]
    off_m = range_m * SINGLE / np.tan(exact.depression_rad[good]) + SINGLE * (range_m + 200.0)
    east, north = seen.east_north_m()
    ground = to_ground_frame(pose, exact.points_enu_m)[good]
    assert np.all(np.abs(seen.range_m[good] - range_m) <= off_m)
    for got, want in ((seen.x_m, ground[:, 0]), (seen.y_m, ground[:, 1])):
        assert np.all(np.abs(got[good] - want) <= off_m)
    for got, axis in ((east, 0), (north, 1)):
        assert np.all(np.abs(got[good] - exact.points_enu_m[good][:, axis]) <= off_m)
    area_m2 = np.abs(np.linalg.det(exact.jac_px[good][:, :2]))
    steep = exact.depression_rad[good] > 0.01
    assert_allclose(seen.gsd_m[good][steep], np.sqrt(area_m2)[steep], rtol=1e-4)


@settings(max_examples=30, deadline=None)
@given(angles_deg=angles)
def test_pixels_are_square_in_angle_in_the_middle(angles_deg):
    """The documented split of the sampling distance into along and across the line of sight."""
    camera = replace(PLAIN, fy_px=80.0)
    pose = pose_of(angles_deg)
    exact = project(camera, pose, np.array([40.0, 35.0]), 0.0, ProjectionModel.PINHOLE)
    if exact.depression_rad < 0.02:
        return
    across, along = sorted(np.linalg.svd(exact.jac_px[:2])[1])
    root, gsd = math.sqrt(math.sin(exact.depression_rad)), depth_map(camera, pose).gsd_m[35, 40]
    assert_allclose([across, along], [gsd * root, gsd / root], rtol=1e-4)


def test_nadir_is_a_plain_grid():
    seen = depth_map(PLAIN, pose_of((0, 0, 0)))
    assert_allclose(seen.x_m, (PIXELS[..., 0] - 40) * 50 / 80, atol=1e-4)
    assert_allclose(seen.y_m, (35 - PIXELS[..., 1]) * 50 / 70, atol=1e-4)
    assert_allclose(seen.gsd_m, 50 / math.sqrt(80 * 70), rtol=1e-6)


def test_what_is_too_far_or_above_the_camera_is_missing():
    pose = pose_of((75, 0, 30))
    free, limited = depth_map(PLAIN, pose), depth_map(PLAIN, pose, max_range_m=300.0)
    assert np.array_equal(~np.isnan(limited.planes[0]), free.range_m <= 300.0)
    assert_allclose(limited.planes[:, free.range_m <= 300.0], free.planes[:, free.range_m <= 300.0])
    assert np.all(np.isnan(limited.planes[:, ~(free.range_m <= 300.0)]))
    assert np.all(np.isnan(depth_map(PLAIN, pose, elevation_m=50.0).planes))


def test_memory_is_reused_and_must_fit():
    pose, out = pose_of((30, 0, 0)), np.empty((4, 64, 96), dtype=np.float32)
    assert depth_map(PLAIN, pose, out=out).planes is out
    assert np.array_equal(out, depth_map(PLAIN, pose).planes)
    for wrong in (out[:, :-1], out.astype(np.float64), out[:, :, ::-1]):
        with pytest.raises(ValueError, match="expected C-ordered float32"):
            depth_map(PLAIN, pose, out=wrong)


@pytest.mark.parametrize("camera", [PLAIN, BROWN, FISHEYE], ids=lambda camera: camera.name)
@settings(max_examples=25, deadline=None)
@given(angles_deg=angles, elevation_m=st.floats(-5.0, 60.0))
def test_a_ground_map_is_the_projection_without_derivatives(camera, angles_deg, elevation_m):
    pose = pose_of(angles_deg)
    exact = project(camera, pose, PIXELS, elevation_m, ProjectionModel.PINHOLE)
    clear = np.abs(exact.depression_rad) > 1e-6
    got = GroundMap.at(camera, pose, elevation_m).points_en_m(PIXELS)
    assert_allclose(got[clear], exact.points_enu_m[clear][:, :2], rtol=1e-7, atol=1e-6)
    one = GroundMap.at(camera, pose, elevation_m).points_en_m(PIXELS[60, 50])
    assert one.shape == (2,)
    assert_allclose(one, got[60, 50], rtol=1e-9, atol=1e-9)
