"""Dense maps against the engine's own exact projection, and areas against derivatives."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft import project, to_ground_frame
from aerodft.dft.maps import GroundMap, depth_map
from aerodft.geometry import ElevationGrid, Plane, Terrain, camera_pose, matrix
from aerodft.model import Camera, LensModel, ProjectionModel

PLAIN = Camera(name="plain", width_px=96, height_px=64, fx_px=80.0, fy_px=70.0, cx_px=40.0, cy_px=35.0)
BROWN = replace(PLAIN, name="brown", distortion=(-0.2, 0.05, 0.002, -0.001, 0.0))
FISHEYE = replace(PLAIN, name="fisheye", lens=LensModel.FISHEYE, distortion=(0.03, -0.01, 0.002, 0.0))
SINGLE = 4e-7  # of single precision: an angle, in rad
FLAT_EARTH = 1.0 - 1e-12
"""A refraction that makes up for the earth's curvature."""
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
    slope, with_z = Plane.sloping([0, 0, 0], 0.1, 1.0), np.empty((5, 64, 96), dtype=np.float32)
    assert depth_map(PLAIN, pose, ground=slope, out=with_z).planes is with_z
    with pytest.raises(ValueError, match="expected C-ordered float32"):
        depth_map(PLAIN, pose, ground=slope, out=out)
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
    got = GroundMap.at(camera, pose, elevation_m).points_enu_m(PIXELS)
    assert_allclose(got[clear], exact.points_enu_m[clear], rtol=1e-7, atol=1e-6)
    one = GroundMap.at(camera, pose, elevation_m).points_enu_m(PIXELS[60, 50])
    assert one.shape == (3,)
    assert_allclose(one, got[60, 50], rtol=1e-9, atol=1e-9)


def terrain_of(height_of, *, half_m=1500.0, cell_m=10.0, refraction=FLAT_EARTH):
    axis = np.arange(-half_m, half_m + cell_m / 2, cell_m)
    east, north = np.meshgrid(axis, axis)
    heights = np.broadcast_to(np.asarray(height_of(east, north), dtype=float), east.shape)
    return Terrain(ElevationGrid(east_m=-half_m, north_m=-half_m, cell_m=cell_m, heights_m=heights), refraction)


def points_of(seen):
    """East, north and up of all pixels that see ground, ``(n, 3)``, and these pixels."""
    points = np.stack([*seen.east_north_m(), seen.z_m], axis=-1)
    good = ~np.isnan(seen.range_m)
    assert np.array_equal(good, np.all(np.isfinite(points), axis=-1))
    return points[good].astype(float), PIXELS[good]


def opencv_pixels(camera, pose, points_enu_m):
    rotation = matrix(pose.wxyz).T
    intrinsics = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]])
    # Turned here: cv2.Rodrigues finds the vector of nearly half a turn, a camera that looks down, to 3e-5 only.
    points, nothing = (points_enu_m - pose.position_enu_m) @ rotation.T, np.zeros(3)
    distortion = np.array(camera.distortion)
    if camera.lens is LensModel.FISHEYE:
        found = cv2.fisheye.projectPoints(points[:, None], nothing, nothing, intrinsics, distortion)
    else:
        found = cv2.projectPoints(points, nothing, nothing, intrinsics, distortion)
    return found[0].reshape(-1, 2)


@pytest.mark.parametrize("camera", [PLAIN, BROWN, FISHEYE], ids=lambda camera: camera.name)
@settings(max_examples=25, deadline=None)
@given(
    angles_deg=angles,
    slope_deg=st.floats(0.0, 40.0),
    uphill_deg=st.floats(0.0, 360.0),
    elevation_m=st.floats(-2.0, 2.0),
)
def test_points_on_a_slope_are_seen_by_opencv_in_their_own_pixels(
    camera, angles_deg, slope_deg, uphill_deg, elevation_m
):
    """Through (100, 0, 5); the height of a slope is its rise along the way uphill."""
    pose, uphill = pose_of(angles_deg, 120.0), math.radians(uphill_deg)
    ground = Plane.sloping([100.0, 0.0, 5.0], math.radians(slope_deg), uphill)
    seen = depth_map(camera, pose, elevation_m, 1000.0, ground)
    points, pixels = points_of(seen)
    if not len(points):
        return
    along = (points[:, 0] - 100.0) * math.sin(uphill) + points[:, 1] * math.cos(uphill)
    assert_allclose(points[:, 2], 5.0 + elevation_m + along * math.tan(math.radians(slope_deg)), atol=2e-3)
    range_m = np.linalg.norm(points - pose.position_enu_m, axis=-1)
    assert_allclose(seen.range_m[~np.isnan(seen.range_m)], range_m, atol=2e-3)
    assert_allclose(opencv_pixels(camera, pose, points), pixels, atol=2e-3)


def test_the_sampling_distance_is_that_of_the_surface_itself():
    """From straight above, a slope has 1 / cos(slope) of the map's area; elsewhere, what its neighbours enclose."""
    pose = pose_of((0, 0, 0))
    slope = Plane.sloping([120.0, -40.0, 0.0], math.radians(35.0), 1.0)
    seen = depth_map(PLAIN, pose, ground=slope)
    assert_allclose(seen.gsd_m[35, 40], 50 / math.sqrt(80 * 70 * math.cos(math.radians(35.0))), rtol=1e-6)
    hills = terrain_of(lambda e, n: 8 * np.sin(e / 60) * np.cos(n / 70), cell_m=2.0, half_m=400.0)
    oblique = replace(PLAIN, fx_px=800.0, fy_px=700.0)
    for ground in (slope, hills):
        near = depth_map(oblique, pose_of((50, 10, 30)), ground=ground)
        x, y = (np.stack(np.gradient(plane), axis=-1) for plane in (near.x_m.astype(float), near.y_m.astype(float)))
        map_m2 = np.abs(x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0])
        normal = ground.meet(
            np.array([0, 0, 1e3]), np.stack([*near.east_north_m(), near.z_m - 1e3], axis=-1).astype(float), 0.0
        ).normal_enu
        surface_m2 = map_m2 / normal[..., 2]
        off = np.abs(np.log(near.gsd_m[2:-2, 2:-2].astype(float) ** 2 / surface_m2[2:-2, 2:-2]))
        assert np.median(off) < 0.005
        assert np.quantile(off, 0.9) < 0.03  # neighbours may lie on other patches


@settings(max_examples=15, deadline=None)
@given(
    angles_deg=st.tuples(st.floats(0.0, 85.0), st.floats(-30.0, 30.0), st.floats(0.0, 360.0)),
    slope_deg=st.floats(0.0, 30.0),
    elevation_m=st.floats(-1.0, 3.0),
)
def test_terrain_that_is_a_plane_is_that_plane(angles_deg, slope_deg, elevation_m):
    pose, slope, cell_m = pose_of(angles_deg, 120.0), math.radians(slope_deg), 10.0
    plane = Plane.sloping([0.0, 0.0, 0.0], slope, 0.6)
    terrain = terrain_of(lambda e, n: math.tan(slope) * (e * math.sin(0.6) + n * math.cos(0.6)), cell_m=cell_m)
    got, want = (depth_map(BROWN, pose, elevation_m, 800.0, ground) for ground in (terrain, plane))
    clear = ~(np.abs(want.range_m - 800.0) < 0.01) & ~(np.abs(got.range_m - 800.0) < 0.01)
    good = clear & ~np.isnan(want.range_m)
    assert np.array_equal(np.isnan(got.range_m)[clear], np.isnan(want.range_m)[clear])
    for index in range(4):
        assert_allclose(got.planes[index][good], want.planes[index][good], atol=1e-3 * cell_m)
    assert_allclose(got.z_m[good], want.z_m[good], atol=1e-3 * cell_m)


def test_a_ridge_hides_what_is_behind_it():
    """80 m high from 150 to 260 m, seen from 100 m: its far edge hides the ground up to 260 * 100 / 20 = 1300 m."""
    terrain = terrain_of(lambda _, n: np.where((n >= 150) & (n <= 260), 80.0, 0.0), half_m=2500.0)
    pose = camera_pose(height_agl_m=100.0, tilt_rad=math.radians(80.0))
    points, pixels = points_of(depth_map(PLAIN, pose, ground=terrain))
    north, up = points[:, 1], points[:, 2]
    assert not np.any((north > 270.0) & (north < 1290.0))
    assert np.any(north > 1300.0)
    assert np.any((north > 150.0) & (north < 260.0) & (up == 80.0))
    face = (up > 1.0) & (up < 79.0)
    assert np.all((north[face] > 140.0) & (north[face] < 150.0) | (north[face] > 260.0))
    straight = pixels[:, 0] == 40.0  # the camera looks north: the middle column's rays stay in one plane
    assert np.all(np.diff(north[straight & (north < 1000)]) <= 1e-3)


def test_the_earth_curves_away_from_the_camera():
    """A ray at the depression a comes down to level ground at x with h + k x^2 = x tan(a)."""
    flat = terrain_of(lambda e, _: 0 * e, half_m=8000.0, cell_m=200.0, refraction=0.13)
    k, h = 0.87 / (2 * 6_371_009.0), 50.0
    camera = Camera(name="tele", width_px=3, height_px=3, fx_px=9000.0, fy_px=9000.0, cx_px=1.0, cy_px=1.0)
    for depression_deg in (0.5, 1.0, 10.0):
        tangent = math.tan(math.radians(depression_deg))
        pose = camera_pose(height_agl_m=h, tilt_rad=math.radians(90.0 - depression_deg))
        seen = depth_map(camera, pose, ground=flat)
        x_m = 2 * h / (tangent + math.sqrt(tangent**2 - 4 * k * h))
        assert_allclose(seen.y_m[1, 1], x_m, rtol=2e-4)
        assert_allclose(seen.z_m[1, 1], 0.0, atol=1e-6)
        assert seen.curvature_per_m == pytest.approx(k)
        incidence = math.radians(90.0 - depression_deg) + 2 * k * x_m
        angle = 1 / 9000.0
        assert_allclose(seen.gsd_m[1, 1], angle * seen.range_m[1, 1] / math.sqrt(math.cos(incidence)), rtol=1e-3)


class LevelInBlocks:
    """Level ground that is met like terrain, and counts the rays that it is asked for at once."""

    has_edges = False

    def __init__(self):
        self.at_once = []
        self.plane = Plane(np.array([0.0, 0.0, 1.0]), 0.0)

    def meet(self, camera_enu_m, directions_enu, elevation_m):
        self.at_once.append(len(directions_enu))
        return self.plane.meet(camera_enu_m, directions_enu, elevation_m)

    def height_at(self, east_north_m):
        return self.plane.height_at(east_north_m)


def test_ground_of_any_kind_is_met_by_the_block():
    large = replace(PLAIN, width_px=1200, height_px=900, fx_px=900.0, fy_px=900.0, cx_px=600.0, cy_px=450.0)
    ground, pose = LevelInBlocks(), pose_of((70, 3, 40))
    got, want = depth_map(large, pose, 1.0, 400.0, ground), depth_map(large, pose, 1.0, 400.0)
    assert sum(ground.at_once) == 1200 * 900
    assert max(ground.at_once) <= 300_000
    clear = ~(np.abs(want.range_m - 400.0) < 0.01)
    for name in ("range_m", "x_m", "y_m", "z_m", "gsd_m"):
        assert_allclose(getattr(got, name)[clear], getattr(want, name)[clear], atol=2e-3)
    assert (got.elevation_m, got.curvature_per_m) == (1.0, 0.0)


def test_from_below_or_beside_the_ground_nothing_is_seen():
    pose = pose_of((40, 0, 0))
    for ground in (Plane.sloping([0, 0, 60.0], 0.1, 0.0), terrain_of(lambda e, _: 60 + 0 * e)):
        assert np.all(np.isnan(depth_map(PLAIN, pose, ground=ground).planes))
        assert np.all(np.isnan(depth_map(PLAIN, pose, ground=ground).z_m))
    assert np.all(np.isnan(depth_map(PLAIN, pose, ground=terrain_of(lambda e, _: 0 * e, half_m=50.0)).planes))
