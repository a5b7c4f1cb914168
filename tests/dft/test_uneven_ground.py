"""Probes on slopes and elevation models: values from built scenes, standard deviations and ridges from Monte-Carlo."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from aerodft.dft import Request, Setup
from aerodft.geometry import ElevationGrid, Plane, Terrain, camera_pose, from_rotation_vector, matrix, multiply
from aerodft.model import Camera, PoseSample, PoseStd, Probe, ProbeKind, Status
from tests.one_image import measure

CAMERA = Camera(
    name="c", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1520.0, cx_px=970.0, cy_px=530.0,
    distortion=(-0.1, 0.02, 1e-3, -1e-3),
)  # fmt: skip
SLOPE = Plane.sloping([0.0, 0.0, 0.0], math.atan(0.2), 0.4)
STD = PoseStd(height_agl_m=0.3, horizontal_m=0.5, tilt_rad=0.004, pan_rad=0.004, roll_rad=0.004)


def grid_of(height_of, cell_m=1.0, half_m=600.0):
    along = np.arange(-half_m, half_m + cell_m / 2, cell_m)
    heights = height_of(*np.meshgrid(along, along)).astype(float)
    return ElevationGrid(east_m=-half_m, north_m=-half_m, cell_m=cell_m, heights_m=heights)


def pixels_of(pose, points):
    cam_r_enu = matrix(pose.wxyz).T
    intrinsics = np.array([[CAMERA.fx_px, 0, CAMERA.cx_px], [0, CAMERA.fy_px, CAMERA.cy_px], [0, 0, 1.0]])
    rotation, away = Rotation.from_matrix(cam_r_enu).as_rotvec(), -cam_r_enu @ pose.position_enu_m
    return cv2.projectPoints(points, rotation, away, intrinsics, np.array(CAMERA.distortion))[0].reshape(-1, 2)


def answers(ground, pose, requests, std=None, **setup):
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose, std=std or PoseStd())
    return measure(Setup(camera=CAMERA, ground=ground, **setup), sample, requests)


def request(kind, pixels, std_px=1.0, **rest):
    pixels = tuple(map(tuple, np.asarray(pixels).tolist()))
    return Request(probe=Probe(name=str(kind), kind=kind, pixels=pixels, **rest), pixels=pixels, std_px=std_px)


@given(
    heading=st.floats(0, 6.28),
    roll=st.floats(-0.5, 0.5),
    slope=st.floats(0, 0.5),
    uphill=st.floats(0, 6.28),
    elevation=st.floats(-1, 5),
    corners=st.lists(st.tuples(st.floats(-12, 12), st.floats(25, 60)), min_size=3, max_size=3, unique=True),
)
@settings(max_examples=150, deadline=None)
def test_every_kind_on_a_slope_is_what_was_built_there(heading, roll, slope, uphill, elevation, corners):
    ground = Plane.sloping([2.0, -1.0, 0.5], slope, uphill)
    pose = camera_pose(height_agl_m=50.0, tilt_rad=0.8, roll_rad=roll, heading_rad=heading, east_m=5.0)
    ahead = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
    east_north = np.array(corners) @ ahead.T + [5.0, 0.0]
    points = np.column_stack([east_north, ground.height_at(east_north) + elevation])
    pixels = pixels_of(pose, points)
    assume(np.all((pixels > 0) & (pixels < [1919, 1079])))
    x, y = points[:, 0], points[:, 1]
    area = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    assume(area > 1)
    top = pixels_of(pose, points[:1] + [0, 0, 2.0])
    requests = (
        request(ProbeKind.POSITION, pixels[:1], elevation_m=elevation),
        request(ProbeKind.RANGE, pixels[:1], elevation_m=elevation),
        request(ProbeKind.WIDTH, pixels[:2], elevation_m=elevation),
        request(ProbeKind.AREA, pixels, elevation_m=elevation),
        request(ProbeKind.HEIGHT, np.concatenate([pixels[:1], np.clip(top, 0, [1919, 1079])]), elevation_m=elevation),
    )
    place, range_, width, surface, height = answers(ground, pose, requests)
    assert_allclose(place.enu_m[0], points[0], atol=1e-6)
    assert_allclose(range_.value, np.linalg.norm(points[0] - pose.position_enu_m), atol=1e-6)
    assert_allclose(width.value, np.hypot(*(points[1] - points[0])[:2]), atol=1e-6)
    assert_allclose(surface.value, area, atol=1e-5)
    if np.all((top > 0) & (top < [1919, 1079])):
        assert_allclose(height.value, 2.0, atol=1e-6)


def drawn_points(pose, pixels, ground, rng):
    shift = np.linalg.cholesky(pose.cov) @ rng.normal(size=6)
    eye, turn = pose.position_enu_m + shift[:3], matrix(multiply(pose.wxyz, from_rotation_vector(shift[3:])))
    seen = (pixels + rng.normal(size=pixels.shape))[:, None]
    intrinsics = np.array([[CAMERA.fx_px, 0, CAMERA.cx_px], [0, CAMERA.fy_px, CAMERA.cy_px], [0, 0, 1.0]])
    xy = cv2.undistortPoints(seen, intrinsics, np.array(CAMERA.distortion))
    rays = np.column_stack([xy[:, 0], np.ones(len(xy))]) @ turn.T
    reach = (ground.offset_m - eye @ ground.normal_enu) / (rays @ ground.normal_enu)
    return eye + rays * reach[:, None]


@pytest.mark.parametrize("is_grid", [False, True], ids=["plane", "grid"])
def test_standard_deviations_on_a_slope_are_monte_carlos(is_grid):
    pose = camera_pose(height_agl_m=40.0, tilt_rad=0.9, roll_rad=0.1, heading_rad=1.0, std=STD)
    pixels = np.array([[500.0, 700.0], [1500.0, 500.0]])
    ground = Terrain(grid_of(lambda e, n: SLOPE.height_at(np.stack([e, n], axis=-1)), 2.0)) if is_grid else SLOPE
    place, width = answers(ground, pose, (request(ProbeKind.POSITION, pixels[:1]), request(ProbeKind.WIDTH, pixels)))
    rng = np.random.default_rng(7)
    draws = np.array([drawn_points(pose, pixels, SLOPE, rng) for _ in range(4000)])
    widths = np.hypot(*(draws[:, 1] - draws[:, 0])[:, :2].T)
    assert_allclose(width.std, np.std(widths), rtol=0.05)
    cov = np.cov(draws[:, 0].T)
    assert_allclose(place.cov_enu_m2, cov, atol=0.07 * np.trace(cov))


def wall(_, north_m):
    return np.where((north_m >= 150) & (north_m <= 260), 80.0, 0.0)


class TestRidge:
    """A ridge with vertical faces, 80 m high, 150 to 260 m north; the camera 100 m up looks north."""

    ground = Terrain(grid_of(wall))

    def seen(self, below_deg, std=None, kind=ProbeKind.RANGE, **setup):
        pose = camera_pose(height_agl_m=100.0, tilt_rad=math.radians(90 - below_deg), std=std)
        return answers(self.ground, pose, (request(kind, [[CAMERA.cx_px, CAMERA.cy_px]]),), **setup)[0]

    def test_its_face_is_hit_and_not_what_lies_behind(self):
        found = self.seen(10.0, kind=ProbeKind.POSITION)
        assert found.enu_m[0][1] == pytest.approx(150, abs=1.0)
        assert found.range_m[0] == pytest.approx(150 / math.cos(math.radians(10)), abs=1.0)

    def test_what_may_pass_over_it_is_refused_although_its_derivatives_are_small(self):
        """The crest is 20 m below at 260 m: a ray just below it meets the top, one just above the plain at 1300 m."""
        crest_deg = math.degrees(math.atan2(20, 260))
        sure = self.seen(crest_deg + 0.5, PoseStd(tilt_rad=math.radians(0.05)))
        assert sure.status is Status.OK
        unsure = self.seen(crest_deg + 0.05, PoseStd(tilt_rad=math.radians(0.05)))
        assert unsure.status is Status.ILL_CONDITIONED
        assert unsure.value is None

    def test_limits_and_borders_have_their_own_words(self):
        far = self.seen(10.0, max_range_m=100.0)
        assert (far.status, far.reasons) == (Status.BEYOND_RANGE, ("point 0 is 152.2 m away, the limit is 100 m",))
        out = self.seen(4.0)
        assert out.status is Status.BEYOND_TERRAIN
        assert out.reasons == ("pixel 0 (970, 530) looks past the border of the elevation model",)


def post(east_m, north_m):
    return np.where((np.abs(east_m) < 3) & (np.abs(north_m - 60) < 3), 60.0, 0.0)


@pytest.mark.parametrize("heading_deg", [2, 5, 20, 60, 180])
def test_a_post_stays_refused_however_little_is_known_of_the_heading(heading_deg):
    """The ground beside it is four times as far; the less the heading is known, the more draws agree on that."""
    ground, asked = Terrain(grid_of(post)), (request(ProbeKind.RANGE, [[CAMERA.cx_px, CAMERA.cy_px]]),)
    known, unknown = (
        answers(ground, camera_pose(height_agl_m=60.0, tilt_rad=1.33, std=std), asked, std)[0]
        for std in (PoseStd(heading_rad=math.radians(deg)) for deg in (0.5, heading_deg))
    )
    assert known.value == pytest.approx(57 / math.sin(1.33), abs=1.0)
    assert unknown.status is Status.ILL_CONDITIONED


def test_a_camera_in_the_ground_is_told_how_far():
    ground = Terrain(grid_of(lambda e, _: 5.0 + 0 * e))
    pose = camera_pose(height_agl_m=3.0, tilt_rad=0.5)
    (found,) = answers(ground, pose, (request(ProbeKind.RANGE, [[900.0, 500.0]]),))
    assert found.status is Status.BELOW_SURFACE
    assert found.reasons[0].endswith("is seen from -2.00 m above the ground, measured is 0.00 m above it")


def test_level_ground_of_all_three_kinds_is_the_same_ground():
    pose = camera_pose(height_agl_m=40.0, tilt_rad=0.9, roll_rad=0.1, heading_rad=1.0, std=STD)
    asked = (request(ProbeKind.WIDTH, [[500.0, 700.0], [1500.0, 500.0]], elevation_m=1.0),)
    level, plane, grid = (
        answers(ground, pose, asked)[0]
        for ground in (None, Plane.sloping([0, 0, 0], 0.0, 0.0), Terrain(grid_of(lambda e, _: 0 * e), refraction=0.0))
    )
    assert_allclose([plane.value, plane.std], [level.value, level.std], rtol=1e-9)
    assert_allclose([grid.value, grid.std], [level.value, level.std], rtol=1e-4)
    assert replace(plane, pose=level.pose).range_m == pytest.approx(level.range_m)
