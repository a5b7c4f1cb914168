"""A pose and a lens that one calibration found: what they share counts in every interval."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.dft import Request, Setup
from aerodft.geometry import camera_pose, from_rotation_vector, multiply
from aerodft.model import Camera, PoseSample, Probe, ProbeKind, Status
from tests.nights import at_night
from tests.one_image import measure

PIXELS = ((300.0, 500.0), (1600.0, 800.0))


def width(camera, pose):
    request = Request(probe=Probe(name="w", kind=ProbeKind.WIDTH, pixels=PIXELS), pixels=PIXELS, std_px=0.0)
    return measure(Setup(camera=camera), PoseSample(stamp_ns=0, status=Status.OK, pose=pose), (request,))[0]


@pytest.mark.parametrize(("count", "within"), [(500, 0.1), *at_night((3000, 0.05))])
def test_the_joint_covariance_is_monte_carlos(count, within):
    rng = np.random.default_rng(2)
    root = 0.3 * rng.normal(size=(10, 10)) * np.array([1, 1, 1, 0.01, 0.01, 0.01, 20, 20, 8, 8])[:, None] / 3
    cov = root @ root.T
    lens_rows = tuple(map(tuple, cov[6:, 6:].tolist()))
    camera = Camera(
        name="c", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1490.0, cx_px=960.0, cy_px=540.0,
        covariance=lens_rows,
    )  # fmt: skip
    pose = replace(camera_pose(height_agl_m=40.0, tilt_rad=0.8), cov=cov[:6, :6], lens_cov=cov[:6, 6:])
    found = width(camera, pose)
    exact = replace(camera, covariance=())
    draws = []
    for _ in range(count):
        error = root @ rng.normal(size=10)
        fx, fy, cx, cy = np.array([1500.0, 1490.0, 960.0, 540.0]) + error[6:]
        turned = replace(
            pose,
            position_enu_m=pose.position_enu_m + error[:3],
            wxyz=multiply(pose.wxyz, from_rotation_vector(error[3:6])),
            cov=np.zeros((6, 6)),
            lens_cov=np.zeros((6, 0)),
        )
        draws.append(width(replace(exact, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy), turned).value)
    assert_allclose(found.std, np.std(draws), rtol=within)
    apart = width(camera, replace(pose, lens_cov=np.zeros((6, 0))))
    assert not math.isclose(apart.std, found.std, rel_tol=0.05)
