"""Views from above of rendered scenes: banks and markers lie where the simulated world has them."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from aerodft.dft.maps import Sampling, depth_map, top_view
from aerodft.dft.maps.orthophoto import MAX_GSD_RATIO
from aerodft.geometry import ElevationGrid, Plane, Terrain, camera_pose, matrix
from aerodft.model import Camera
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.world import DEFAULT_ORIGIN, Appearance, Marker, River, World

STEPS = 2.0
CAMERA = Camera(
    name="brown",
    width_px=640,
    height_px=480,
    fx_px=520.0,
    fy_px=530.0,
    cx_px=330.0,
    cy_px=228.0,
    distortion=(-0.15, 0.05, 0.002, -0.001, 0.0),
)
RIVER = River(origin_en_m=(3.0, 5.0), azimuth_rad=0.7, width_m=22.0, width_swing_m=0.0, meander_m=0.0)
MARKERS = tuple(
    Marker(id=i, east_m=x, north_m=y, side_m=2.5, heading_rad=0.5 * i)
    for i, (x, y) in enumerate([(-12.0, 9.0), (20.0, 3.0), (-6.0, 22.0)])
)


def scene(tilt_deg, roll_deg=0.0):
    pose = camera_pose(
        height_agl_m=40.0,
        tilt_rad=math.radians(tilt_deg),
        roll_rad=math.radians(roll_deg),
        heading_rad=0.2,
        east_m=2.0,
        north_m=-6.0,
    )
    flat = Appearance(ground_contrast=0.0, water_contrast=0.0)
    world = World(origin=DEFAULT_ORIGIN, river=RIVER, look=flat, markers=MARKERS)
    return Renderer(CAMERA, world, SensorModel(noise_std=0.0)).render(pose, 0.0), pose


def at_en_m(view, columns_rows):
    """East and north of columns and rows, integers at the pixels' middles."""
    return [view.west_m, view.north_m] + (np.asarray(columns_rows) + 0.5) * [view.step_m, -view.step_m]


def sampled_m(pose, view, columns_rows):
    """How finely image and view sample the ground there: whichever is coarser."""
    seen = depth_map(CAMERA, pose)
    order = np.argsort(seen.range_m, axis=None)
    range_m = np.hypot(np.hypot(*(at_en_m(view, columns_rows) - pose.position_enu_m[:2]).T), 40.0)
    return np.maximum(view.step_m, np.interp(range_m, seen.range_m.ravel()[order], seen.gsd_m.ravel()[order]))


@pytest.mark.parametrize(("tilt_deg", "roll_deg"), [(0, 0), (30, 6), (55, -8)])
def test_straight_banks_lie_where_they_are(tilt_deg, roll_deg):
    image, pose = scene(tilt_deg, roll_deg)
    view = top_view(image, CAMERA, pose)
    blue, _, red, seen = (view.pixels[..., band].astype(int) for band in range(4))
    water = (blue > red + 20) & (seen > 0)
    inside = cv2.erode((seen > 0).astype(np.uint8), np.ones((7, 7)), borderValue=0) > 0
    rows, columns = np.nonzero(water & ~(cv2.erode(water.astype(np.uint8), np.ones((3, 3))) > 0) & inside)
    _, across = RIVER.along_across(at_en_m(view, np.stack([columns, rows], axis=-1)))
    from_bank = np.abs(np.abs(across) - 11.0)
    clear = np.ones(len(rows), dtype=bool)
    for marker in MARKERS:  # a marker's dark squares may look like water
        clear &= np.hypot(*(at_en_m(view, np.stack([columns, rows], -1)) - marker.centre_enu_m[:2]).T) > 4.0
    assert np.count_nonzero(clear) > 200
    assert np.median(from_bank[clear]) < view.step_m
    assert np.all(from_bank[clear] < STEPS * sampled_m(pose, view, np.stack([columns, rows], axis=-1)[clear]))


@pytest.mark.parametrize("tilt_deg", [0, 35])
def test_markers_are_found_at_their_surveyed_places(tilt_deg):
    image, pose = scene(tilt_deg)
    view = top_view(image, CAMERA, pose)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    corners, ids, _ = detector.detectMarkers(cv2.cvtColor(view.pixels[..., :3], cv2.COLOR_BGR2GRAY))
    assert len(ids) >= 2
    for marker_id, found in zip(np.ravel(ids), corners, strict=True):
        off = at_en_m(view, found[0]) - MARKERS[marker_id].corners_enu_m()[:, :2]
        assert np.max(np.hypot(*off.T)) < STEPS * view.step_m


def test_the_step_is_the_images_own_unless_given():
    image, pose = scene(30)
    own = float(np.median(depth_map(CAMERA, pose).gsd_m))
    assert top_view(image, CAMERA, pose).step_m == pytest.approx(own)
    fine, coarse = (top_view(image, CAMERA, pose, Sampling(step_m=step_m)) for step_m in (0.05, 0.5))
    assert (fine.step_m, coarse.step_m) == (0.05, 0.5)
    areas = [np.count_nonzero(view.pixels[..., 3]) * view.step_m**2 for view in (fine, coarse)]
    assert areas[0] == pytest.approx(float(np.sum(depth_map(CAMERA, pose).gsd_m.astype(float) ** 2)), rel=0.01)
    assert areas[1] == pytest.approx(areas[0], rel=0.02)
    tiny = top_view(image, CAMERA, pose, Sampling(step_m=0.001, max_pixels=100_000))
    assert 90_000 < tiny.pixels[..., 0].size < 103_000


def test_ground_near_the_horizon_is_left_out():
    image, pose = scene(80)
    view = top_view(image, CAMERA, pose)
    gsd = depth_map(CAMERA, pose).gsd_m
    reach = np.nanmax(np.where(gsd <= MAX_GSD_RATIO * np.nanmedian(gsd), depth_map(CAMERA, pose).range_m, np.nan))
    rows, columns = np.nonzero(view.pixels[..., 3])
    away = np.hypot(*(at_en_m(view, np.stack([columns, rows], axis=-1)) - pose.position_enu_m[:2]).T)
    assert np.hypot(away.max(), 40.0) <= reach
    assert np.hypot(away.max(), 40.0) > 0.97 * reach
    limited = top_view(image, CAMERA, pose, Sampling(max_range_m=150.0))
    rows, columns = np.nonzero(limited.pixels[..., 3])
    away = np.hypot(*(at_en_m(limited, np.stack([columns, rows], axis=-1)) - pose.position_enu_m[:2]).T)
    assert np.hypot(away.max(), 40.0) <= 150.0
    assert top_view(image, CAMERA, scene(150)[1]) is None


def test_a_broken_contract_is_a_value_error():
    image, pose = scene(0)
    with pytest.raises(ValueError, match="expected uint8"):
        top_view(image[:-1], CAMERA, pose)
    with pytest.raises(ValueError, match="expected one above 0"):
        Sampling(step_m=0.0)


PLAIN = replace(CAMERA, name="plain", distortion=())
SQUARE_M = 4.0
SLOPE, UPHILL = math.radians(25.0), math.radians(70.0)
HALF_A_STEP = 0.5


def slope_up_m(east, north):
    return 3.0 + math.tan(SLOPE) * (east * math.sin(UPHILL) + north * math.cos(UPHILL))


def opencv_pixels(camera, pose, points_enu_m):
    rotation = matrix(pose.wxyz).T
    intrinsics = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]])
    shift, turn = -rotation @ pose.position_enu_m, cv2.Rodrigues(rotation)[0]
    return cv2.projectPoints(points_enu_m, turn, shift, intrinsics, np.array(camera.distortion))[0][:, 0]


def checkerboard(camera, pose, up_m, squares=range(-8, 9)):
    """An image of squares on the map, their corners raised to the ground, drawn where OpenCV projects them."""
    larger, image = 4, np.full((4 * camera.height_px, 4 * camera.width_px, 3), 90, dtype=np.uint8)
    for i in squares:
        for j in squares:
            if (i + j) % 2:
                continue
            corners = SQUARE_M * (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) + [i, j])
            pixels = opencv_pixels(camera, pose, np.column_stack([corners, up_m(*corners.T)]))
            at = np.rint(((pixels + 0.5) * larger - 0.5) * 16).astype(np.int32)
            cv2.fillConvexPoly(image, at, (230, 230, 230), cv2.LINE_AA, 4)
    return cv2.resize(image, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA)


def inner_corners(squares=range(-5, 6)):
    return SQUARE_M * np.array([[i, j] for i in squares for j in squares], dtype=float)


def found_corners_m(view, corners_en_m):
    """Those that lie well within the view, and where the saddle point of its brightness next to them is."""
    at = (corners_en_m - [view.west_m, view.north_m]) / [view.step_m, -view.step_m] - 0.5
    opaque = cv2.erode(view.pixels[..., 3], np.ones((25, 25)), borderValue=0)
    height, width = opaque.shape
    inside = np.all((at > 0) & (at < [width - 1, height - 1]), axis=-1)
    whole = np.rint(np.where(inside[:, None], at, 0)).astype(int)
    inside &= opaque[whole[:, 1], whole[:, 0]] > 0
    grey = cv2.cvtColor(view.pixels[..., :3], cv2.COLOR_BGR2GRAY)
    rule = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    found = cv2.cornerSubPix(grey, at[inside].astype(np.float32).reshape(-1, 1, 2), (7, 7), (-1, -1), rule)[:, 0]
    return corners_en_m[inside], at_en_m(view, found)


@pytest.mark.parametrize(("tilt_deg", "roll_deg"), [(0, 0), (35, 8), (50, -5)])
def test_a_checkerboard_on_a_slope_comes_out_square(tilt_deg, roll_deg):
    pose = camera_pose(
        height_agl_m=45.0,
        tilt_rad=math.radians(tilt_deg),
        roll_rad=math.radians(roll_deg),
        heading_rad=0.3,
        north_m=-12.0 if tilt_deg < 40 else -30.0,
    )
    ground = Plane.sloping([0.0, 0.0, 3.0], SLOPE, UPHILL)
    image = checkerboard(PLAIN, pose, slope_up_m)
    view = top_view(image, PLAIN, pose, Sampling(step_m=0.15), ground=ground)
    there, found = found_corners_m(view, inner_corners())
    assert len(there) > 40
    assert np.max(np.hypot(*(found - there).T)) < HALF_A_STEP * view.step_m
    level = top_view(image, PLAIN, pose, Sampling(step_m=0.15), elevation_m=3.0)
    crooked = np.hypot(*np.subtract(*found_corners_m(level, inner_corners())).T)
    assert np.max(crooked) > 2 * view.step_m  # the test would see it


def test_terrain_and_an_elevation_above_it_make_the_same_view_as_the_plane():
    pose = camera_pose(height_agl_m=45.0, tilt_rad=0.6, heading_rad=0.3, north_m=-12.0)
    axis = np.arange(-200.0, 201.0, 4.0)
    grid = ElevationGrid(east_m=-200.0, north_m=-200.0, cell_m=4.0, heights_m=slope_up_m(*np.meshgrid(axis, axis)) - 1)
    image = checkerboard(PLAIN, pose, slope_up_m)
    sampling = Sampling(step_m=0.15)
    want = top_view(image, PLAIN, pose, sampling, ground=Plane.sloping([0.0, 0.0, 3.0], SLOPE, UPHILL))
    got = top_view(image, PLAIN, pose, sampling, elevation_m=1.0, ground=Terrain(grid))
    assert (got.west_m, got.north_m, got.step_m) == pytest.approx((want.west_m, want.north_m, want.step_m), abs=0.16)
    there, found = found_corners_m(got, inner_corners())
    assert len(there) > 60
    assert np.max(np.hypot(*(found - there).T)) < HALF_A_STEP * got.step_m
    opaque = [np.count_nonzero(view.pixels[..., 3]) for view in (got, want)]
    assert opaque[0] == pytest.approx(opaque[1], rel=0.002)


def test_what_a_ridge_hides_is_transparent():
    """A wall 10 m high at 20 m north, one cell thick, seen from 30 m: it hides the ground from 21 to 31.5 m."""
    axis = np.arange(-100.0, 101.0, 1.0)
    _, north = np.meshgrid(axis, axis)
    heights = np.where((north >= 20.0) & (north <= 21.0), 10.0, 0.0)
    ground = Terrain(ElevationGrid(east_m=-100.0, north_m=-100.0, cell_m=1.0, heights_m=heights), 1.0 - 1e-12)
    pose = camera_pose(height_agl_m=30.0, tilt_rad=math.radians(35.0))
    image = np.full((480, 640, 3), 200, dtype=np.uint8)
    view = top_view(image, PLAIN, pose, Sampling(step_m=0.1), ground=ground)
    rows, columns = np.indices(view.pixels.shape[:2])
    east, north = np.moveaxis(at_en_m(view, np.stack([columns, rows], axis=-1)), -1, 0)
    opaque = view.pixels[..., 3] > 0
    middle = np.abs(east) < 5.0
    assert not np.any(opaque & (north > 22.2) & (north < 31.3))  # its back falls to the ground within a cell
    for low, high in ((0.0, 18.8), (20.1, 20.9), (31.7, 45.0)):
        assert np.all(opaque[middle & (north > low) & (north < high)])
    assert not np.any(view.pixels[~opaque])


def test_ground_without_a_height_is_transparent_and_hides():
    """Over a hole nobody knows what stands in the way: not even the height of what is behind it counts."""
    heights = np.zeros((201, 201))
    heights[110:116, 95:106] = np.nan  # 10 to 15 m north, 5 m to both sides
    heights[0, 0] = 40.0  # a summit: rays below its height could meet something in the hole
    ground = Terrain(ElevationGrid(east_m=-100.0, north_m=-100.0, cell_m=1.0, heights_m=heights))
    pose = camera_pose(height_agl_m=30.0, tilt_rad=math.radians(30.0))
    image = np.full((480, 640, 3), 200, dtype=np.uint8)
    view = top_view(image, PLAIN, pose, Sampling(step_m=0.1), ground=ground)
    rows, columns = np.indices(view.pixels.shape[:2])
    east, north = np.moveaxis(at_en_m(view, np.stack([columns, rows], axis=-1)), -1, 0)
    opaque = view.pixels[..., 3] > 0
    assert not np.any(opaque & (np.abs(east) < 4.0) & (north > 9.1))
    assert np.all(opaque[(np.abs(east) < 4.0) & (north > 0.0) & (north < 8.9)])
    assert np.all(opaque[(np.abs(east - 15.0) < 1.0) & (north > 0.0) & (north < 20.0)])


def test_a_depth_map_that_is_there_is_taken():
    image, pose = scene(30)
    ground = Plane.sloping([0.0, 0.0, 0.0], 0.1, 1.0)
    seen = depth_map(CAMERA, pose, 0.0, 60.0, ground)
    fresh, given = (
        top_view(image, CAMERA, pose, Sampling(max_range_m=60.0), ground=ground, seen=s) for s in (None, seen)
    )
    assert np.array_equal(fresh.pixels, given.pixels)
