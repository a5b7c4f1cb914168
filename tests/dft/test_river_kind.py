"""The kind ``river``: the median of its pairs' widths, with the errors that they share."""

import math

import numpy as np
import pytest

from aerodft.dft import Request, Setup
from aerodft.geometry import camera_pose
from aerodft.model import Camera, PoseSample, PoseStd, Probe, ProbeKind, Status
from tests.one_image import measure

CAMERA = Camera(name="c", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1500.0, cx_px=959.5, cy_px=539.5)
PAIRS = np.array([[[400.0 - 30 * k, 300.0 + 90 * k], [1400.0 + 35 * k, 320.0 + 80 * k]] for k in range(7)])


def sample(height_m=40.0, tilt_deg=35.0, **more):
    pose = camera_pose(height_agl_m=height_m, tilt_rad=math.radians(tilt_deg), **more)
    return PoseSample(stamp_ns=0, status=Status.OK, pose=pose)


def asked(kind, pixels, std_px=1.0):
    pixels = tuple(map(tuple, np.asarray(pixels).reshape(-1, 2).tolist()))
    return Request(probe=Probe(name="p", kind=kind, pixels=pixels), pixels=pixels, std_px=std_px)


def uncertain():
    return sample(std=PoseStd(height_agl_m=0.5, tilt_rad=0.007, pan_rad=0.005, roll_rad=0.005))


def test_of_an_odd_number_it_is_the_middle_width_with_its_uncertainty():
    river, *widths = measure(
        Setup(camera=CAMERA), uncertain(), [asked(ProbeKind.RIVER, PAIRS), *(asked(ProbeKind.WIDTH, p) for p in PAIRS)]
    )
    middle = sorted(widths, key=lambda each: each.value)[len(widths) // 2]
    assert river.value == pytest.approx(middle.value, abs=1e-12)
    assert river.std == pytest.approx(middle.std, rel=1e-9)
    assert len(river.enu_m) == 2 * len(PAIRS)


def test_of_an_even_number_its_std_is_that_of_drawn_poses_and_pixels():
    pairs, rng = PAIRS[:4], np.random.default_rng(1)
    (river,) = measure(Setup(camera=CAMERA), uncertain(), [asked(ProbeKind.RIVER, pairs, std_px=2.0)])
    drawn = []
    for _ in range(3000):
        moved = uncertain().pose
        errors = rng.multivariate_normal(np.zeros(6), moved.cov)
        one = sample(40.0 + errors[2], 35.0 + math.degrees(errors[3]))  # the width hardly depends on pan and roll
        seen = pairs + 2.0 * rng.standard_normal(pairs.shape)
        (answer,) = measure(Setup(camera=CAMERA), one, [asked(ProbeKind.RIVER, seen)])
        drawn.append(answer.value)
    assert river.std == pytest.approx(np.std(drawn), rel=0.12)


@pytest.mark.parametrize("count", [1, 3, 65])
def test_banks_come_in_pairs(count):
    with pytest.raises(ValueError, match="an even number"):
        measure(Setup(camera=CAMERA), sample(), [asked(ProbeKind.RIVER, ((1.0, 2.0),) * count)])
