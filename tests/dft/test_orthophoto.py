"""Views from above of rendered scenes: banks and markers lie where the simulated world has them."""

import math

import cv2
import numpy as np
import pytest

from aerodft.dft.depth_map import depth_map
from aerodft.dft.orthophoto import COARSEST, Sampling, top_view
from aerodft.geometry.poses import camera_pose
from aerodft.model.camera import Camera
from aerodft.sim.render import Imaging, Renderer
from aerodft.sim.river import River
from aerodft.sim.world import DEFAULT_ORIGIN, Look, Marker, World

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
    flat = Look(ground_contrast=0.0, water_contrast=0.0)
    world = World(origin=DEFAULT_ORIGIN, river=RIVER, look=flat, markers=MARKERS)
    return Renderer(CAMERA, world, Imaging(noise_std=0.0)).render(pose, 0.0), pose


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
    tiny = top_view(image, CAMERA, pose, Sampling(step_m=0.001, most_pixels=100_000))
    assert 90_000 < tiny.pixels[..., 0].size < 103_000


def test_ground_near_the_horizon_is_left_out():
    image, pose = scene(80)
    view = top_view(image, CAMERA, pose)
    gsd = depth_map(CAMERA, pose).gsd_m
    reach = np.nanmax(np.where(gsd <= COARSEST * np.nanmedian(gsd), depth_map(CAMERA, pose).range_m, np.nan))
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
