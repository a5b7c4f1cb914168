"""Photographs without a river: the shipped network takes no road for one, and a shore has one bank at most."""

import math
from pathlib import Path

import cv2
import pytest

from aerodft.dft import Setup
from aerodft.geometry import camera_pose
from aerodft.model import Camera
from aerodft.vision.river import NoRiver, River, RiverHints, RiverQuestion, RiverStatus, find_river

PICTURES = Path(__file__).parent / "pictures"


def found_in(name, **asked):
    """What is found in a picture from straight above, of a camera with 60 degrees across, 30 m up."""
    image = cv2.imread(str(PICTURES / name))
    height, width = image.shape[:2]
    focal_px = width / 2 / math.tan(math.radians(30.0))
    camera = Camera(
        name="drone", width_px=width, height_px=height, fx_px=focal_px, fy_px=focal_px, cx_px=(width - 1) / 2,
        cy_px=(height - 1) / 2,
    )  # fmt: skip
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.0)
    return find_river(image, Setup(camera=camera), pose, RiverQuestion(**asked))


@pytest.mark.parametrize("name", ["road_infrared.jpg", "park_road.jpg"])
def test_a_road_is_refused(name):
    found = found_in(name)
    assert isinstance(found, NoRiver)


def test_a_lake_shore_has_no_width():
    found = found_in("lake_shore.jpg")
    assert isinstance(found, NoRiver)
    assert found.status in (RiverStatus.ONE_BANK, RiverStatus.NO_CONTRAST)


def test_who_says_that_a_road_is_water_is_believed():
    found = found_in("road_infrared.jpg", hints=RiverHints([(377.0, 417.0)], [(400.0, 150.0), (150.0, 520.0)]))
    banks = found.banks_px
    assert sum(len(bank) for bank in banks) > 100
    if isinstance(found, River):
        assert found.water.water[417, 377]


@pytest.mark.parametrize(("name", "at"), [("road_infrared.jpg", (377.0, 417.0)), ("park_road.jpg", (600.0, 400.0))])
def test_who_points_at_a_road_gets_no_width_where_nobody_can_tell(name, at):
    found = found_in(name, hints=RiverHints([at], []))
    assert isinstance(found, NoRiver)
    assert found.status is RiverStatus.AMBIGUOUS
    assert "point at land too" in found.reason
