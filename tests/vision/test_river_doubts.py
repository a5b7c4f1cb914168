"""What else the river may be: other outlines, other arms, ground along it; and images too bright to tell."""

import numpy as np
import pytest

from aerodft.dft import Setup
from aerodft.geometry import camera_pose
from aerodft.reports.river.document import doubts
from aerodft.sim import default_camera
from aerodft.sim.render import Imaging, Renderer
from aerodft.sim.world import Island, furnished_world
from aerodft.sim.world import River as SimulatedRiver
from aerodft.vision.river import NoRiver, River, RiverQuestion, RiverStatus, WaterMask, WaterPlane, find_river
from aerodft.vision.river.centreline import Centreline
from aerodft.vision.river.checks import alternative_width_delta_m
from aerodft.vision.river.water_features import WaterFeatures
from tests.vision.painted_rivers import CAMERA, PaintedRiver


def mask(*columns):
    """A band of the copy of half the size, rows throughout."""
    water = np.zeros((100, 200), dtype=bool)
    water[:, slice(*columns)] = True
    return water


def copy(scale, height, width):
    """A small copy of which only the size is looked at."""
    nothing = np.empty((height, width, 0), np.float32), np.empty((height, width, 0), np.uint8)
    return WaterFeatures(scale, *nothing, np.empty((0, 0), np.float32), np.zeros((height, width), dtype=bool))


def test_another_outline_is_so_much_wider_at_each_transect():
    """From 50 m above; the other outline is wider by 20 columns of 0.35 m in the upper half of the image alone."""
    camera = default_camera(800, 400)
    plane = WaterPlane(camera, camera_pose(height_agl_m=50.0, tilt_rad=0.0))
    metre_px = camera.fx_px / 50.0
    features = copy(0.5, 200, 400)
    other = mask(80, 120)
    other[:50, 120:140] = True
    found = WaterMask(mask(0), mask(0), np.empty(0), regions=(mask(80, 120), other))
    line = Centreline(np.array([[0.0, -10.0], [0.0, 0.0], [0.0, 10.0]]), 40 * 4 / metre_px)
    wider = alternative_width_delta_m(plane, features, found, line, np.array([2.0, 5.0, 15.0, 18.0]))
    np.testing.assert_allclose(wider, [0.0, 0.0, 80 / metre_px, 80 / metre_px], atol=6 / metre_px)


def test_ground_that_may_be_bare_reaches_into_the_interval():
    camera = default_camera(800, 400)
    plane = WaterPlane(camera, camera_pose(height_agl_m=50.0, tilt_rad=0.0))
    features = copy(0.25, 100, 200)
    found = WaterMask(mask(80, 120), mask(0), np.empty(0), less=mask(80, 110))
    line = Centreline(np.array([[0.0, -10.0], [0.0, 0.0], [0.0, 10.0]]), 160 * 50.0 / camera.fx_px)
    wider = alternative_width_delta_m(plane, features, found, line, np.array([5.0, 15.0]))
    np.testing.assert_allclose(wider, -40 * 50.0 / camera.fx_px, atol=6 * 50.0 / camera.fx_px)


def test_an_arm_behind_a_long_island_is_said():
    """The island leaves the image at both ends: nothing tells that the arms are one river."""
    river = SimulatedRiver(
        width_m=40.0, width_swing_m=0.0, meander_m=0.0, islands=(Island(station_m=0.0, length_m=400.0, width_m=8.0),)
    )
    camera = default_camera(960, 540)
    pose = camera_pose(height_agl_m=100.0, tilt_rad=0.0)
    image = Renderer(camera, furnished_world(river), Imaging()).render(pose, 1.0)
    found = find_river(image, Setup(camera=camera), pose, RiverQuestion(seed_px=(480.0, 375.0)))
    assert isinstance(found, River)
    assert found.water.apart > 0.5
    assert any("another arm" in said for said in doubts([found.water]))


@pytest.mark.parametrize(("water", "land"), [("blue", "sand"), ("teal", "sand"), ("brown", "rock")])
def test_burnt_out_banks_are_no_banks(water, land):
    scene = PaintedRiver(seed=3, water=water, land=land, tilt_deg=20.0)
    image = np.clip(2.0 * scene.picture() + 120.0, 0, 255).astype(np.uint8)
    found = find_river(image, Setup(camera=CAMERA), scene.pose, RiverQuestion())
    assert isinstance(found, NoRiver)
    assert found.status is RiverStatus.TOO_BRIGHT


def test_black_borders_are_no_banks():
    """A picture in a black frame that leans, as after undistortion; it hides a part of the left bank."""
    scene = PaintedRiver(seed=2, water="blue", land="grass", tilt_deg=20.0, width_m=30.0)
    image = scene.picture()
    u, v = np.meshgrid(np.arange(960), np.arange(540))
    framed = np.where(((u > 260 + 0.1 * v) & (u < 800 + 0.1 * v))[..., None], image, 0).astype(np.uint8)
    whole, part = (find_river(each, Setup(camera=CAMERA), scene.pose, RiverQuestion()) for each in (image, framed))
    assert isinstance(whole, River)
    assert isinstance(part, River)
    assert len(part.rows) < len(whole.rows)
    np.testing.assert_allclose(np.median(part.widths.width_m), np.median(whole.widths.width_m), rtol=0.006)
    edge = np.stack([part.edges.pixels_px[..., 0] - 260 - 0.1 * part.edges.pixels_px[..., 1]], axis=-1)
    assert np.nanmin(edge) > 8.0
    assert np.nanmax(edge) < 540.0 - 8.0
