import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from aerodft.geometry import camera_pose, inverse, matrix
from aerodft.model import Camera, FloatArray, ImageArray, LensModel, Pose
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.world import DEFAULT_ORIGIN, Appearance, Island, Marker, Post, River, Walker, World

EDGE_PX = 0.3
CORNER_PX = 0.5
SHARP = SensorModel(noise_std=0.0)
FLAT = Appearance(ground_contrast=0.0, water_contrast=0.0)
RIVER = River(azimuth_rad=0.3)
BROWN = Camera(
    name="brown",
    width_px=640,
    height_px=480,
    fx_px=520.0,
    fy_px=530.0,
    cx_px=330.0,
    cy_px=228.0,
    distortion=(-0.15, 0.05, 0.002, -0.001, 0.0),
)
FISHEYE = replace(BROWN, name="fisheye", lens=LensModel.FISHEYE, distortion=(0.03, -0.01, 0.002, 0.0))


def world(**things: object) -> World:
    return World(**{"origin": DEFAULT_ORIGIN, "river": RIVER, "look": FLAT, **things})  # type: ignore[arg-type]


def opencv_pixels(camera: Camera, pose: Pose, points_enu_m: FloatArray) -> FloatArray:
    cam_from_enu = matrix(inverse(pose.wxyz))
    k = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    rotation, translation = cv2.Rodrigues(cam_from_enu)[0], -cam_from_enu @ pose.position_enu_m
    points = np.ascontiguousarray(points_enu_m, dtype=np.float64).reshape(-1, 1, 3)
    project = cv2.fisheye.projectPoints if camera.lens is LensModel.FISHEYE else cv2.projectPoints
    if camera.lens is LensModel.FISHEYE:
        pixels = project(points, rotation, translation, k, np.array(camera.distortion))[0]
    else:
        pixels = project(points, rotation, translation, k, np.array(camera.distortion))[0]
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def crossing_on_line(image: ImageArray, near: FloatArray, direction: FloatArray) -> float:
    """Where along ``direction`` through ``near`` the brightness is halfway between the two sides, in pixels."""
    offsets = np.arange(-6, 6.01, 0.1)
    at = near + offsets[:, None] * direction
    profile = cv2.remap(image[..., 2].astype(np.float32), at[None].astype(np.float32), None, cv2.INTER_LINEAR)[0]
    half = (profile[:10].mean() + profile[-10:].mean()) / 2
    assert abs(profile[:10].mean() - profile[-10:].mean()) > 20
    after = int(np.argmax((profile > half) != (profile[0] > half)))
    slope = profile[after] - profile[after - 1]
    return float(offsets[after - 1] + 0.1 * (half - profile[after - 1]) / slope)


@pytest.mark.parametrize("camera", [BROWN, FISHEYE], ids=lambda camera: camera.name)
@pytest.mark.parametrize(("tilt_deg", "roll_deg"), [(0, 0), (30, 8), (60, -12)])
def test_banks_are_where_opencv_says(camera: Camera, tilt_deg: float, roll_deg: float) -> None:
    pose = camera_pose(
        height_agl_m=35.0,
        tilt_rad=math.radians(tilt_deg),
        roll_rad=math.radians(roll_deg),
        heading_rad=0.35,
        east_m=1.0,
        north_m=-2.0,
    )
    image = Renderer(camera, world(), SHARP).render(pose, 0.0)
    stations = np.arange(-60.0, 140.0, 5.0)
    banks = RIVER.crossing(stations).reshape(-1, 3)
    along = RIVER.crossing(stations + 0.5).reshape(-1, 3)
    tested = 0
    for pixel, ahead in zip(opencv_pixels(camera, pose, banks), opencv_pixels(camera, pose, along), strict=True):
        if not (np.all(pixel > 15) and np.all(pixel < [camera.width_px - 16, camera.height_px - 16])):
            continue
        tangent = (ahead - pixel) / np.linalg.norm(ahead - pixel)
        assert abs(crossing_on_line(image, pixel, np.array([-tangent[1], tangent[0]]))) < EDGE_PX
        tested += 1
    assert tested >= 6


def test_an_island_splits_the_water() -> None:
    island = Island(station_m=0.0, length_m=60.0, width_m=8.0)
    river = replace(RIVER, islands=(island,))
    pose = camera_pose(height_agl_m=35.0, tilt_rad=0.0, heading_rad=0.3)
    image = Renderer(BROWN, world(river=river), SHARP).render(pose, 0.0)
    for pixel in opencv_pixels(BROWN, pose, river.island_crossing([0.0])[0]):
        assert abs(crossing_on_line(image, pixel, np.array([1.0, 0.0]))) < EDGE_PX


def test_markers_are_found_where_opencv_projects_them() -> None:
    markers = tuple(
        Marker(id=i, east_m=x, north_m=y, side_m=2.0, heading_rad=0.5 * i)
        for i, (x, y) in enumerate([(-14.0, -2.0), (15.0, 3.0), (-13.0, 8.0)])
    )
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.2, roll_rad=0.1)
    image = Renderer(BROWN, world(markers=markers), SHARP).render(pose, 0.0)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    corners, ids, _ = detector.detectMarkers(image)
    assert sorted(np.ravel(ids).tolist()) == [0, 1, 2]
    for marker_id, found in zip(np.ravel(ids), corners, strict=True):
        refined = cv2.cornerSubPix(
            cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), found.reshape(-1, 1, 2), (3, 3), (-1, -1), (3, 50, 1e-3)
        )
        truth = opencv_pixels(BROWN, pose, markers[marker_id].corners_enu_m())
        np.testing.assert_allclose(refined.reshape(-1, 2), truth, atol=CORNER_PX)


def test_a_post_stands_from_its_base_to_its_top() -> None:
    post = Post(name="post", east_m=16.0, north_m=10.0, height_m=4.0, width_m=0.6)
    pose = camera_pose(height_agl_m=20.0, tilt_rad=0.7, heading_rad=0.8)
    bare = Renderer(BROWN, world(), SHARP).render(pose, 0.0)
    image = Renderer(BROWN, world(posts=(post,)), SHARP).render(pose, 0.0)
    rows, columns = np.nonzero(np.any(image != bare, axis=-1))
    base, top = opencv_pixels(BROWN, pose, post.ends_enu_m())
    assert rows.max() == pytest.approx(base[1], abs=1.5)
    assert rows.min() == pytest.approx(top[1], abs=1.5)
    near_base = rows > rows.max() - 3
    assert columns[near_base].mean() == pytest.approx(base[0], abs=1.5)


def test_a_near_post_hides_a_far_one_however_they_are_listed() -> None:
    pose = camera_pose(height_agl_m=6.0, tilt_rad=1.2)
    near = Post(name="near", east_m=0.0, north_m=15.0, height_m=3.0, width_m=1.0)
    far = Post(name="far", east_m=0.0, north_m=20.0, height_m=3.0, width_m=1.0)
    one = Renderer(BROWN, world(posts=(near, far)), SHARP).render(pose, 0.0)
    other = Renderer(BROWN, world(posts=(far, near)), SHARP).render(pose, 0.0)
    alone = Renderer(BROWN, world(posts=(near,)), SHARP).render(pose, 0.0)
    np.testing.assert_array_equal(one, other)
    u, v = np.rint(opencv_pixels(BROWN, pose, near.ends_enu_m()).mean(axis=0)).astype(int)
    np.testing.assert_array_equal(one[v, u], alone[v, u])


def test_a_walker_moves_and_casts_a_shadow() -> None:
    walker = Walker(start_en_m=(14.0, 0.0), end_en_m=(14.0, 10.0), speed_mps=1.0)
    pose = camera_pose(height_agl_m=20.0, tilt_rad=0.5, heading_rad=0.5)
    renderer = Renderer(BROWN, world(walkers=(walker,), river=replace(RIVER, flow_mps=0.0)), SHARP)
    bare = Renderer(BROWN, world(), SHARP).render(pose, 0.0)
    for time_s, north in ((0.0, 0.0), (4.0, 4.0), (12.0, 8.0)):
        np.testing.assert_allclose(walker.foot_enu_m(time_s), [14.0, north, 0.0], atol=1e-9)
        changed = np.any(renderer.render(pose, time_s) != bare, axis=-1)
        u, v = np.rint(opencv_pixels(BROWN, pose, walker.foot_enu_m(time_s))[0]).astype(int)
        assert changed[v - 3 : v + 1, u - 2 : u + 3].any()


def test_there_is_sky_above_the_horizon_and_black_beyond_the_lens() -> None:
    pose = camera_pose(height_agl_m=20.0, tilt_rad=math.radians(95))
    image = Renderer(replace(BROWN, distortion=()), world(), SHARP).render(pose, 0.0)
    horizon_v = 228.0 + 530.0 * math.tan(math.radians(5))
    assert np.all(image[: int(horizon_v) - 3] == image[0, 0])
    assert not np.all(image[int(horizon_v) + 60] == image[0, 0])
    strong = replace(BROWN, distortion=(-0.9, 0.0, 0.0, 0.0))
    assert np.all(Renderer(strong, world(), SHARP).render(pose, 0.0)[0, 0] == 0)


def test_water_flows_and_land_does_not() -> None:
    pose = camera_pose(height_agl_m=25.0, tilt_rad=0.0, heading_rad=0.3)
    renderer = Renderer(BROWN, world(look=Appearance()), SHARP)
    changed = np.any(renderer.render(pose, 0.0) != renderer.render(pose, 1.0), axis=-1)
    middle = opencv_pixels(BROWN, pose, RIVER.enu([0.0], RIVER.centre_m([0.0])))[0].astype(int)
    land = opencv_pixels(BROWN, pose, RIVER.enu([0.0], [14.0]))[0].astype(int)
    assert changed[middle[1] - 20 : middle[1] + 20, middle[0] - 20 : middle[0] + 20].mean() > 0.5
    assert not changed[land[1] - 5 : land[1] + 5, land[0] - 5 : land[0] + 5].any()


@pytest.mark.parametrize("height_m", [5.0, 40.0, 120.0])
def test_the_ground_can_be_tracked_at_every_height(height_m: float) -> None:
    pose = camera_pose(height_agl_m=height_m, tilt_rad=0.0, east_m=300.0)
    image = Renderer(BROWN, world(look=Appearance()), SHARP).render(pose, 0.0)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    corners = cv2.goodFeaturesToTrack(grey, 500, 0.01, 10)
    assert len(corners) > 200
    assert grey.std() > 5


def test_the_same_arguments_give_the_same_bytes_and_noise_has_its_std() -> None:
    pose = camera_pose(height_agl_m=25.0, tilt_rad=0.3, east_m=300.0)
    noisy = SensorModel(noise_std=3.0, seed=4)
    one, again = (Renderer(BROWN, world(), noisy).render(pose, 0.5) for _ in range(2))
    np.testing.assert_array_equal(one, again)
    clean = Renderer(BROWN, world(), SHARP).render(pose, 0.5)
    assert (one.astype(float) - clean).std() == pytest.approx(3.0, rel=0.03)


@pytest.mark.parametrize("tilt_deg", [0.0, 80.0])
@pytest.mark.parametrize("north_m", [0.0, 400.0])  # over the water, and where there is none in view
def test_a_camera_that_stands_still_sees_what_it_would_see_anew(north_m: float, tilt_deg: float) -> None:
    walker = Walker(start_en_m=(-9.0, north_m + 12.0), end_en_m=(9.0, north_m + 12.0))
    scene = world(look=Appearance(), walkers=(walker,))
    here, there = (
        camera_pose(height_agl_m=20.0, tilt_rad=math.radians(tilt_deg), north_m=north_m, east_m=east_m)
        for east_m in (0.0, 0.5)
    )
    standing = Renderer(BROWN, scene, SHARP)
    for time_s, pose in enumerate((here, here, here, there, here, here, here)):
        anew = Renderer(BROWN, scene, SHARP).render(pose, time_s)
        np.testing.assert_array_equal(standing.render(pose, time_s), anew)


def test_motion_blur_is_the_mean_of_the_exposure() -> None:
    poses = [camera_pose(height_agl_m=25.0, tilt_rad=0.3, north_m=north) for north in (0.0, 0.5, 1.0)]
    renderer = Renderer(BROWN, world(look=Appearance()), SHARP)
    blurred = renderer.render_exposure(poses, [0.0, 0.0, 0.0])
    mean = np.mean([renderer.render(pose, 0.0) for pose in poses], axis=0)
    np.testing.assert_allclose(blurred, mean, atol=0.51)


def test_a_camera_on_the_ground_gives_an_image() -> None:
    pose = camera_pose(height_agl_m=0.0, tilt_rad=1.0)
    assert Renderer(BROWN, world(), SHARP).render(pose, 0.0).shape == (480, 640, 3)
