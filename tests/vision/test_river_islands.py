"""Islands between the banks are counted and taken out of the wetted width."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np

from aerodft.dft import Setup
from aerodft.model import PoseSample, Status
from aerodft.sim import default_camera
from aerodft.vision.river import Islands, Reach, River, RiverQuestion, RiverView, find_river, measure_reach
from aerodft.vision.river.reach import common_islands
from tests.vision.river_scenes import picture, river_scene

HALF_PERCENT = 0.005


def test_wetted_width_leaves_the_island_out():
    """Truth is the closed form of banks and shores on the normal through each transect's centre."""
    scene = river_scene("braided", 40, 2)
    camera, image = picture(scene)
    assert camera == default_camera(1920, 1080)
    found = find_river(image, Setup(camera=camera), scene.pose, RiverQuestion(spacing_m=1.0))
    assert isinstance(found, River)
    river = scene.world.river
    stations, _ = river.along_across(found.transects.centres_en_m[found.rows])
    points = river.island_crossing(stations)
    true_dry = np.nan_to_num(np.linalg.norm(points[:, 0] - points[:, 1], axis=-1))
    wide = true_dry > 2.0  # the tips are thinner than the transects' directions tell
    dry, count = found.islands.dry_m[found.rows], found.islands.count[found.rows]
    assert np.count_nonzero(wide) >= 8
    assert np.all(count[wide] == 1)
    assert np.all(count[true_dry == 0.0] == 0)
    off, std = np.abs(dry - true_dry)[wide], found.islands.std_m[found.rows][wide]
    assert np.median(off) < HALF_PERCENT * 22.0
    assert np.all(off < np.maximum(HALF_PERCENT * 22.0, 3 * std))


def test_a_reach_leaves_its_islands_out_of_the_wetted_width():
    """Three images of a small camera, from poses along the river; truth on the normals of the reach's own line."""
    scene = river_scene("braided", 40, 2)
    river, views = scene.world.river, []
    for seed, along_m in enumerate((-3.0, 0.0, 3.0)):
        shift = along_m * np.array([np.sin(river.azimuth_rad), np.cos(river.azimuth_rad), 0.0])
        moved = replace(scene, pose=replace(scene.pose, position_enu_m=scene.pose.position_enu_m + shift))
        camera, image = picture(moved, width_px=960, height_px=540, seed=seed)
        sample = PoseSample(stamp_ns=0, status=Status.OK, pose=moved.pose)
        views.append(RiverView(seed, Setup(camera=camera), sample, partial(np.asarray, image)))
    found = measure_reach(views, RiverQuestion(spacing_m=1.0))
    assert isinstance(found, Reach)
    seen = found.found.images > 0
    centres, _ = found.line.at(found.stations_m)
    points = river.island_crossing(river.along_across(centres)[0])
    true_dry = np.nan_to_num(np.linalg.norm(points[:, 0] - points[:, 1], axis=-1))
    wide = seen & (true_dry > 3.0)
    assert np.count_nonzero(wide) >= 8
    assert np.all(found.islands.count[wide] == 1)
    assert np.all(found.islands.count[seen & (true_dry == 0.0)] == 0)
    off = np.abs(found.islands.dry_m - true_dry)[wide]
    assert np.median(off) < HALF_PERCENT * 22.0
    assert np.all(off < np.maximum(2 * HALF_PERCENT * 22.0, 3 * found.islands.std_m[wide]))


def look(dry_m, std_m=0.1):
    """What is dry across one transect, as one image shows it; the other parts of a look play no role."""
    islands = Islands(np.array([int(dry_m > 0)]), np.array([dry_m]), np.array([std_m]))
    return SimpleNamespace(islands=islands, rows=np.array([0]), used=np.array([True]))


def test_images_that_agree_on_an_island_average_and_those_that_do_not_stay_in_doubt():
    rng = np.random.default_rng(5)
    errors = []
    for _ in range(300):
        common = common_islands([look(6.0 + each) for each in 0.1 * rng.standard_normal(9)], 1)
        errors.append((common.dry_m[0] - 6.0) / common.std_m[0])
    assert 0.8 < np.std(errors) < 1.05  # of the larger of what is stated and what is seen
    torn = common_islands([look(6.0)] * 6 + [look(0.0)] * 3, 1)
    assert (torn.count[0], torn.dry_m[0]) == (1, 6.0)
    assert torn.std_m[0] > 3.0  # a third of the images says that all of it is water
