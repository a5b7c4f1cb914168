"""Growth on the near bank hides water behind it, by similar triangles."""

import numpy as np
import pytest

from aerodft.geometry import camera_pose
from aerodft.vision.river import hidden_per_metre


def test_a_metre_of_reed_on_the_near_bank():
    """From 10 m up and 15 m off, a ray over a reed of h meets the water 15 m h / (10 m - h) behind its foot."""
    pose = camera_pose(height_agl_m=10.0, tilt_rad=1.0)
    near, far = [0.0, 15.0, 0.0], [0.0, 40.0, 0.0]
    ((left, right),) = hidden_per_metre(pose, np.array([[near, far]]))
    over = 10.0 - 1e-6
    behind = (15.0 * 10.0 / over - 15.0) / 1e-6
    assert left == pytest.approx(behind, rel=1e-5)
    assert right == 0.0


def test_from_above_and_along_the_river_nothing_is_hidden():
    pose = camera_pose(height_agl_m=10.0, tilt_rad=0.0)
    above = [[-5.0, 0.0, 0.0], [5.0, 0.0, 0.0]]
    along = [[-5.0, 30.0, 0.0], [5.0, 30.0, 0.0]]
    assert np.all(hidden_per_metre(pose, np.array([above, along])) == 0.0)
