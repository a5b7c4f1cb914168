"""A shore is told from a river by its shape alone: by masks of known regions, as a level camera 30 m up sees them."""

import math

import numpy as np
import pytest

from aerodft.dft import Setup
from aerodft.geometry import camera_pose
from aerodft.sim import default_camera
from aerodft.vision.river import WaterMask, WaterPlane
from aerodft.vision.river.centreline import WaterMap, centreline, middle_line
from aerodft.vision.river.water import SmallCopy, ground_of
from tests.nights import at_night

CAMERA = default_camera(960, 540)

SHORES = {
    "straight": lambda e, _: e > 3.0,
    "bay": lambda e, n: (e > 6.0) | (np.hypot(e - 6.0, n) < 8.0),
    "round bay": lambda e, n: (e > 6.0) | (np.hypot(e - 3.0, n) < 7.0),
    "inlet": lambda e, n: (e > 0.0) | ((e > -9.0) & (np.abs(n) < 1.2)),
    "cove behind a breakwater": lambda e, n: (e > -4.0) & ~((np.abs(e + 0.5) < 0.7) & (n < 6.0) & (n > -20.0)),
    "wavy": lambda e, n: e > 4.0 + 2.0 * np.sin(n / 2.0),
    "pond": lambda e, n: np.hypot(e / 1.2, n - 2.0) < 7.0,
}
RIVERS = {
    "straight": lambda e, _: np.abs(e) < 8.0,
    "winding": lambda e, n: np.abs(e - 5.0 * np.sin(n / 9.0)) < 4.0,
    "seen to its end": lambda e, n: (np.abs(e) < 4.0) & (n < 9.0),
    "wider than the image is high": lambda e, n: np.abs(n - 0.3 * e) < 7.0,
    "with an island": lambda e, n: (np.abs(e) < 8.0) & (np.hypot(e, n / 2.0) > 3.0),
}


def line_along(region, tilt_deg):
    """The centreline of a region, whose middle is where the optical axis meets the water; None where it has none."""
    pose = camera_pose(height_agl_m=30.0, tilt_rad=math.radians(tilt_deg))
    plane = WaterPlane.from_setup(Setup(camera=CAMERA), pose)
    copy = SmallCopy.of_image(np.full((540, 960, 3), 90, dtype=np.uint8))
    ground = ground_of(plane, copy)
    rows, columns = copy.shape
    pixels = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).astype(np.float64)
    east, north = np.moveaxis(plane.places_en_m(copy.to_image(pixels)), -1, 0)
    with np.errstate(invalid="ignore"):
        water = region(east, north - 30.0 * math.tan(math.radians(tilt_deg))) & ground
    logit = np.where(water, 9.0, -9.0).astype(np.float32)
    return centreline(plane, copy, WaterMask(water, ground, logit, (water, water), 1.0))


@pytest.mark.parametrize("tilt_deg", [0.0, *at_night(40.0), 66.0])
@pytest.mark.parametrize("shape", SHORES)
def test_a_shore_has_no_centreline(shape, tilt_deg):
    """Open water ends where the image does, or where it is too far away to be looked at: neither is a bank."""
    assert line_along(SHORES[shape], tilt_deg) is None


@pytest.mark.parametrize("tilt_deg", [*at_night(0.0, 40.0), 60.0])
@pytest.mark.parametrize("shape", RIVERS)
def test_a_river_has_one(shape, tilt_deg):
    line = line_along(RIVERS[shape], tilt_deg)
    assert line is not None
    width_m = {"winding": 8.0, "seen to its end": 8.0, "wider than the image is high": 13.4}.get(shape, 16.0)
    assert line.width_m == pytest.approx(width_m, rel=0.2)


def test_of_two_pieces_of_water_the_line_is_the_longer_one_s():
    """The banks of the one are no banks of the other: its middle would be as far from them as the gap is wide."""
    water = np.zeros((60, 200), dtype=bool)
    water[20:40, :70], water[20:40, 100:] = True, True
    line = middle_line(WaterMap(0.0, 0.0, 0.5, water, np.ones_like(water)))
    assert line is not None
    assert line.width_m == pytest.approx(10.0, abs=1.0)
    assert line.places_en_m[:, 0].min() > 50.0 - line.width_m
