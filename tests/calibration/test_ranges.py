"""Slant ranges all at once are what each of them says by itself, also where one misses the ground."""

import math

import numpy as np
import pytest

from aerodft.geometry.rotation import camera_attitude
from aerodft.model.camera import Camera
from aerodft.model.evidence import SlantRange
from aerodft.model.measurement import ProjectionModel
from calibration.conditions import condition_of
from calibration.ranges import Ranges
from calibration.state import State

PIXELS = ((200.0, 500.0), (640.5, 700.25), (1100.0, 610.0), (900.0, 20.0))
CAMERA = Camera.from_fov(name="c", width_px=1280, height_px=720, hfov_rad=math.radians(60), vfov_rad=math.radians(36))


def seen(tilt_deg: float) -> tuple[State, dict[int, SlantRange]]:
    state = State(
        camera=CAMERA,
        position_m=np.array([3.0, -2.0, 11.0]),
        wxyz=camera_attitude(math.radians(tilt_deg), 0.02, 0.7),
        elevation_m=0.4,
        model=ProjectionModel.PINHOLE,
    )
    return state, {
        3 * k + 1: SlantRange(name=f"r{k}", pixel=pixel, range_m=20.0 + k, std_px=0.5 + k, std_m=0.05 * k)
        for k, pixel in enumerate(PIXELS)
    }


@pytest.mark.parametrize(("tilt_deg", "hits"), [(50.0, 4), (78.0, 3), (115.0, 0)])
def test_each_is_what_its_condition_says(tilt_deg: float, hits: int) -> None:
    state, evidence = seen(tilt_deg)
    ranges = Ranges(evidence)
    values, by_shared = ranges.found(state)
    assert ranges.owner.tolist() == list(evidence)
    assert np.count_nonzero(np.isfinite(values)) == hits
    for row, each in enumerate(evidence.values()):
        alone = condition_of(each)(state)
        std_m = math.sqrt(alone.cov[0, 0])
        np.testing.assert_allclose(values[row], alone.off[0] / std_m, rtol=1e-11)
        if np.isfinite(values[row]):
            np.testing.assert_allclose(by_shared[row], alone.by_shared[0] / std_m, rtol=1e-10, atol=1e-12)
