"""What shows no river between two banks gets a status and a reason, and no width."""

import math

import numpy as np
import pytest

from aerodft.dft import Setup
from aerodft.geometry import camera_pose
from aerodft.sim import default_camera
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.world import DEFAULT_ORIGIN, Appearance, World
from aerodft.sim.world import River as SimulatedRiver
from aerodft.vision.river import (
    NoRiver,
    River,
    RiverHints,
    RiverQuestion,
    RiverStatus,
    find_river,
)

CAMERA = default_camera(960, 540)
MIDDLE = (480.0, 270.0)


def seen(north_m, tilt_deg, height_m, *, width_m=22.0, look=None, seed_px=None, dim=1.0):
    """What is found from ``north_m`` of the river's axis, the camera looking north across it."""
    river = SimulatedRiver(width_m=width_m, width_swing_m=0.0, meander_m=0.0)
    world = World(origin=DEFAULT_ORIGIN, river=river, look=look or Appearance())
    pose = camera_pose(height_agl_m=height_m, tilt_rad=math.radians(tilt_deg), north_m=north_m)
    image = Renderer(CAMERA, world, SensorModel()).render(pose, 1.0)
    image = (image * dim).astype(np.uint8)
    return find_river(
        image, Setup(camera=CAMERA), pose, RiverQuestion(hints=RiverHints([] if seed_px is None else [seed_px], []))
    )


def test_a_river_across_the_image_is_measured_from_its_middle():
    found = seen(0.0, 0.0, 60.0, seed_px=MIDDLE)
    assert isinstance(found, River)
    assert np.median(found.widths.width_m) == pytest.approx(22.0, rel=0.005)


@pytest.mark.parametrize(
    ("given", "status", "says"),
    [
        ({"north_m": 500.0, "tilt_deg": 0.0, "height_m": 30.0}, RiverStatus.NO_WATER, "no water is seen"),
        ({"north_m": 24.0, "tilt_deg": 0.0, "height_m": 60.0}, RiverStatus.ONE_BANK, "only one bank"),
        ({"north_m": 0.0, "tilt_deg": 0.0, "height_m": 8.0}, RiverStatus.ALL_WATER, "no bank"),
        ({"north_m": 9.0, "tilt_deg": 0.0, "height_m": 14.0}, RiverStatus.ONE_BANK, "only one bank"),
        ({"north_m": 0.0, "tilt_deg": 120.0, "height_m": 30.0}, RiverStatus.ABOVE_HORIZON, "too far up"),
        ({"north_m": 0.0, "tilt_deg": 0.0, "height_m": 60.0, "dim": 0.05}, RiverStatus.TOO_DARK, "night"),
        (
            {"north_m": 0.0, "tilt_deg": 0.0, "height_m": 60.0, "seed_px": (480.0, 900.0)},
            RiverStatus.SEED_OFF_GROUND,
            "pointed at",
        ),
        (
            {"north_m": 0.0, "tilt_deg": 75.0, "height_m": 30.0, "seed_px": (480.0, 2.0)},
            RiverStatus.SEED_OFF_GROUND,
            "near enough",
        ),
    ],
)
def test_no_river_for_a_reason(given, status, says):
    found = seen(**given)
    assert isinstance(found, NoRiver)
    assert found.status is status
    assert says in found.reason


def test_a_white_image_shows_nothing():
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.2)
    found = find_river(np.full((540, 960, 3), 255, dtype=np.uint8), Setup(camera=CAMERA), pose, RiverQuestion())
    assert isinstance(found, NoRiver)
    assert found.status is RiverStatus.TOO_BRIGHT


def _meadow():
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.0, north_m=500.0)
    return Renderer(
        CAMERA, World(origin=DEFAULT_ORIGIN, river=SimulatedRiver(), look=Appearance()), SensorModel()
    ).render(pose, 1.0)


def _even(bgr, spread, seed):
    noise = np.random.default_rng(seed).normal(0, spread, (540, 960, 1))
    return np.clip(np.array(bgr) + noise, 0, 255)


def _band(half_px, swing_px):
    """Share ``(540, 960, 1)`` that a band down the image covers, soft at its edges."""
    v, u = np.mgrid[:540, :960]
    return np.clip(half_px - np.abs(u - 480 - swing_px * np.sin(v / 150)) + 0.5, 0, 1)[..., None]


@pytest.mark.parametrize("bgr", [(95, 97, 96), (110, 150, 175)], ids=["asphalt", "dirt"])
def test_a_road_is_no_river_unless_somebody_says_so(bgr):
    band = _band(100, 0)
    image = (_meadow() * (1 - band) + _even(bgr, 4, 1) * band).astype(np.uint8)
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.0)
    found = find_river(image, Setup(camera=CAMERA), pose, RiverQuestion())
    assert isinstance(found, NoRiver)
    assert found.status in (RiverStatus.NO_WATER, RiverStatus.NO_CONTRAST)
    told = find_river(image, Setup(camera=CAMERA), pose, RiverQuestion(hints=RiverHints([MIDDLE], [])))
    assert isinstance(told, River)
    assert np.median(told.widths.width_m) == pytest.approx(200 * 30.0 / CAMERA.fx_px, rel=0.01)


@pytest.mark.parametrize("swing_px", [0, 75])
def test_a_shadow_on_bare_ground_is_no_river(swing_px):
    ground = _even((120, 135, 150), 5, 2)
    image = (ground * (1 - 0.55 * _band(100, swing_px))).astype(np.uint8)
    found = find_river(image, Setup(camera=CAMERA), camera_pose(height_agl_m=30.0, tilt_rad=0.0), RiverQuestion())
    assert isinstance(found, NoRiver)
