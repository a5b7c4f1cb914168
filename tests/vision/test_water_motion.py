"""A second look tells water from what does not move: mud along it, and roads."""

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from aerodft.dft import Setup
from aerodft.geometry import camera_pose, from_rotation_vector, multiply
from aerodft.sim import default_camera
from aerodft.sim.render import Renderer, SensorModel
from aerodft.vision.river import (
    LaterLook,
    NoRiver,
    River,
    RiverHints,
    RiverQuestion,
    RiverStatus,
    WaterNetwork,
    WaterPlane,
    find_river,
    motion_copy,
)
from tests.nights import at_night
from tests.vision.river_scenes import river_scene, true_crossing
from tests.waterside import Waterside, WatersideRenderer

CAMERA = default_camera(1920, 1080)
SETUP = Setup(camera=CAMERA)
MUDDY = {"water_bgr": (78.0, 104.0, 122.0), "waves": 0.12, "foam": 0.03, "growth": 1.6}
SPARSE = RiverQuestion(spacing_m=2.0)


def turned(pose, *angles_rad):
    return replace(pose, wxyz=multiply(pose.wxyz, from_rotation_vector(np.array(angles_rad))))


def looks(look, shape="straight", tilt_deg=0, after_s=1.0):
    """A scene, its image, and a later look from 1.5 m farther on whose pose is told 0.4 degrees wrong."""
    scene = river_scene(shape, tilt_deg, 1)
    there = replace(scene.pose, position_enu_m=scene.pose.position_enu_m + [1.2, 0.8, 0.1])
    there = turned(there, 0.01, 0.008, -0.006)
    image, later = (
        WatersideRenderer(CAMERA, scene.world, SensorModel(seed=seed), look).render(pose, 3.0 + after)
        for seed, pose, after in ((1, scene.pose, 0.0), (2, there, after_s))
    )
    told = turned(there, 0.004, -0.004, 0.005)
    return scene, image, LaterLook(WaterPlane(CAMERA, told), lambda: motion_copy(later), after_s)


def errors(scene, found):
    """Relative errors of the used widths, and how many of their stds they are."""
    used = np.array([found.status[row] is RiverStatus.OK for row in found.rows])
    rows = found.rows[used]
    crossing = true_crossing(scene.world.river, found.transects.centres_en_m[rows], found.transects.to_left[rows])
    true = crossing[:, 0] - crossing[:, 1]
    off = found.widths.width_m[used] - true
    return np.abs(off) / true, np.abs(off) / found.widths.std_m[used]


@pytest.mark.parametrize("shape", ["straight", *at_night("curved")])
def test_mud_of_the_waters_colour_is_taken_off_where_it_stays(shape):
    """1 m on both sides of 22 m, 10 % too wide where it counts as water, as in one image of the straight river."""
    scene, image, later = looks(Waterside(**MUDDY, mud_m=1.0), shape)
    alone, _ = errors(scene, find_river(image, SETUP, scene.pose, SPARSE))
    moved, stds = errors(scene, find_river(image, SETUP, scene.pose, SPARSE, later))
    print(f"\n{shape}: {100 * np.median(alone):.2f} % in one image, {100 * np.median(moved):.2f} % in two")
    assert np.median(alone) > (0.05 if shape == "straight" else np.median(moved))
    assert np.median(moved) < 0.02
    assert np.mean(stds < 2.6) > 0.7


@pytest.mark.parametrize("tilt_deg", [55, *at_night(0)])
def test_moving_water_is_measured_as_before(tilt_deg):
    scene, image, later = looks(Waterside(**MUDDY), "curved", tilt_deg)
    once, twice = (find_river(image, SETUP, scene.pose, SPARSE, each) for each in (None, later))
    assert isinstance(twice, River)
    np.testing.assert_allclose(twice.widths.width_m, once.widths.width_m, rtol=0.002)


class SeesTheBand:
    """In place of a network as OpenCV has it: it takes the cobbled band for water, also in the mirrored look."""

    def __init__(self, band):
        self.looks = [band, band[:, ::-1]]

    def setInput(self, blob):  # noqa: N802 - OpenCV's name
        self.size = blob.shape[3], blob.shape[2]

    def forward(self):
        self.looks = self.looks[::-1]
        return 8.0 * cv2.resize(self.looks[1].astype(np.float32), self.size)[None, None] - 4.0


def test_what_does_not_move_is_a_road_unless_somebody_says_so():
    """A cobbled road that winds, which a network takes for water."""
    random = np.random.default_rng(1)
    v, u = np.mgrid[:1080, :1920]
    band = np.clip(200 - np.abs(u - 960 - 150 * np.sin(v / 300)) + 0.5, 0, 1)[..., None]
    meadow = Renderer(CAMERA, river_scene("straight", 0, 1).world, SensorModel())
    grass = meadow.render(camera_pose(height_agl_m=30.0, tilt_rad=0.0, north_m=500.0), 0.0)
    stones = np.repeat(np.repeat(random.normal(0, 16, (90, 160, 1)), 12, axis=0), 12, axis=1)
    scene = grass * (1 - band) + (np.array([95, 97, 96]) + stones) * band
    image, after = (np.clip(scene + random.normal(0, 2, scene.shape), 0, 255).astype(np.uint8) for _ in range(2))
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.0)
    later = LaterLook(WaterPlane(CAMERA, pose), lambda: motion_copy(after), 1.0)
    asked = replace(SPARSE, network=WaterNetwork(SeesTheBand(band[..., 0]), Path("sees the band")))
    assert isinstance(find_river(image, SETUP, pose, asked), River)
    found = find_river(image, SETUP, pose, asked, later)
    assert isinstance(found, NoRiver)
    assert found.status is RiverStatus.NO_WATER
    assert "does not move" in found.reason
    assert isinstance(
        find_river(image, SETUP, pose, replace(asked, hints=RiverHints([(960.0, 810.0)], [])), later), River
    )


@pytest.mark.nightly
def test_a_later_look_at_another_place_says_nothing():
    scene, image, later = looks(Waterside(**MUDDY, mud_m=1.0))
    _, elsewhere, _ = looks(Waterside(**MUDDY), "curved", 40)
    strange = replace(later, copy=lambda: motion_copy(elsewhere))
    once, twice = (find_river(image, SETUP, scene.pose, SPARSE, each) for each in (None, strange))
    np.testing.assert_array_equal(twice.widths.width_m, once.widths.width_m)


@pytest.mark.nightly
def test_far_away_slow_water_would_not_be_seen_moving():
    """Two looks 0.01 s apart: nothing has moved far enough, so nothing is said."""
    scene, image, later = looks(Waterside(**MUDDY), "straight", 40, after_s=0.01)
    once, twice = (find_river(image, SETUP, scene.pose, SPARSE, each) for each in (None, later))
    assert math.isclose(np.median(twice.widths.width_m), np.median(once.widths.width_m), rel_tol=1e-12)
