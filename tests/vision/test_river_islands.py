"""Islands between the banks are counted and taken out of the wetted width."""

import numpy as np

from aerodft.dft.request import Setup
from aerodft.sim.scenario import default_camera
from aerodft.vision.river import River, RiverQuestion, find_river
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
    np.testing.assert_allclose(dry[wide], true_dry[wide], atol=HALF_PERCENT * 22.0)
