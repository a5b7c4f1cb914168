"""Ranges and lengths all at once are what each of them says by itself, also where one misses the ground."""

import math
from itertools import combinations

import numpy as np
import pytest

from aerodft.geometry.rotation import camera_attitude
from aerodft.model.camera import Camera
from aerodft.model.evidence import KnownLength, SlantRange
from aerodft.model.measurement import ProjectionModel
from calibration.conditions import condition_of
from calibration.ranges import Lengths, Ranges
from calibration.state import State

PIXELS = ((200.0, 500.0), (640.5, 700.25), (1100.0, 610.0), (900.0, 20.0))
CAMERA = Camera.from_fov(name="c", width_px=1280, height_px=720, hfov_rad=math.radians(60), vfov_rad=math.radians(36))


def guess(tilt_deg: float) -> State:
    return State(
        camera=CAMERA,
        position_m=np.array([3.0, -2.0, 11.0]),
        wxyz=camera_attitude(math.radians(tilt_deg), 0.02, 0.7),
        elevation_m=0.4,
        model=ProjectionModel.PINHOLE,
    )


RANGES = Ranges(
    ranges := {
        3 * k + 1: SlantRange(name=f"r{k}", pixel=pixel, range_m=20.0 + k, std_px=0.5 + k, std_m=0.05 * k)
        for k, pixel in enumerate(PIXELS)
    }
)
LENGTHS = Lengths(
    lengths := {
        5 * k: KnownLength(name=f"l{k}", pixels=ends, length_m=9.0 + k, std_px=0.7, std_m=0.02 * k, elevation_m=0.3 * k)
        for k, ends in enumerate(combinations(PIXELS, 2))
    }
)


@pytest.mark.parametrize(
    ("many", "evidence", "tilt_deg", "hits"),
    [
        (RANGES, ranges, 50.0, 4),
        (RANGES, ranges, 78.0, 3),
        (RANGES, ranges, 115.0, 0),
        (LENGTHS, lengths, 50.0, 6),
        (LENGTHS, lengths, 78.0, 3),
        (LENGTHS, lengths, 115.0, 0),
    ],
)
def test_each_is_what_its_condition_says(many, evidence, tilt_deg: float, hits: int) -> None:
    state = guess(tilt_deg)
    values, by_shared = many.found(state)
    assert many.owner.tolist() == list(evidence)
    assert np.count_nonzero(np.isfinite(values)) == hits
    for row, each in enumerate(evidence.values()):
        alone = condition_of(each)(state)
        std_m = math.sqrt(alone.cov[0, 0])
        np.testing.assert_allclose(values[row], alone.off[0] / std_m, rtol=1e-11)
        if np.isfinite(values[row]):
            np.testing.assert_allclose(by_shared[row], alone.by_shared[0] / std_m, rtol=1e-10, atol=1e-12)
