"""How uncertain slant ranges and bearings may be: as if drawn, and a refusal stays when any error grows."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from aerodft.dft import MAX_RELATIVE_RANGE_STD, Request, Setup
from aerodft.dft.covariance import Z95, relative_range_halves
from aerodft.geometry import ElevationGrid, Terrain, camera_pose
from aerodft.model import Camera, CameraStd, PoseSample, PoseStd, Probe, ProbeKind, ProjectionModel, Status
from tests.one_image import measure

CAMERA = Camera(name="c", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1500.0, cx_px=950.0, cy_px=530.0)
LIMIT = Z95 * MAX_RELATIVE_RANGE_STD
PROBES = (
    (ProbeKind.RANGE, ((960.0, 500.0),)),
    (ProbeKind.POSITION, ((300.0, 800.0),)),
    (ProbeKind.DISTANCE, ((700.0, 450.0), (1500.0, 600.0))),
    (ProbeKind.BEARING, ((940.0, 560.0),)),
    (ProbeKind.BEARING, ((700.0, 450.0), (720.0, 440.0))),
    (ProbeKind.AREA, ((200.0, 700.0), (900.0, 500.0), (1400.0, 900.0))),
)


@pytest.mark.parametrize(("height", "slope", "correlation"), [(0.25, 0.1, 0), (0.0, 0.23, 0), (0.3, 0.2, -0.8)])
def test_without_tilt_it_is_the_drawn_interval_of_height_over_slope(height, slope, correlation):
    cov = np.array([[height**2, correlation * height * slope], [correlation * height * slope, slope**2]])
    errors = np.random.default_rng(1).multivariate_normal(np.zeros(2), cov, 1_000_000)
    low, high = np.quantile((1 + errors[:, 0]) / (1 - errors[:, 1]), [0.025, 0.975])
    assert relative_range_halves(cov, np.zeros((3, 3))) == pytest.approx((high - low) / 2, rel=0.01)


@pytest.mark.parametrize(("std_deg", "axes"), [(28.2, 1), (23.1, 2)])
def test_straight_down_tilts_are_refused_that_are_a_tenth_less_uncertain_than_drawn_ones(std_deg, axes):
    """Where first order is 0: the drawn interval of ``1 / cos(tilt)`` is as wide as is acceptable, +-0.588."""
    std = math.radians(std_deg)
    tilt = np.hypot(*(std * np.random.default_rng(1).standard_normal((1_000_000, 2)) * [1, axes - 1]).T)
    low, high = np.quantile(1 / np.cos(tilt), [0.025, 0.975])
    assert (high - low) / 2 == pytest.approx(LIMIT, rel=0.02)
    cov = std**2 * np.diag([1.0, axes - 1.0, 0.0])
    less, same = (relative_range_halves(np.zeros((2, 2)), share**2 * cov) for share in (0.9, 1.0))
    assert less < LIMIT < same


def rough_ground():
    """Hills and bumps of all sizes over 600 m, 10 m high by standard deviation, and 0 below the camera."""
    rate = np.hypot(*np.meshgrid(*[np.fft.fftfreq(121)] * 2))
    rate[0, 0] = 1.0
    heights = np.fft.ifft2(np.fft.fft2(np.random.default_rng(1).standard_normal(rate.shape)) / rate**1.7).real
    heights_m = (heights - heights[60, 60]) * 10 / np.std(heights)
    return Terrain(ElevationGrid(east_m=-300.0, north_m=-300.0, cell_m=5.0, heights_m=heights_m))


LEVEL = [(model, None) for model in ProjectionModel]


def statuses(surface, stated, pose_cov, focal_px, std_px, elevation_std_m):
    pose = camera_pose(height_agl_m=stated[0], tilt_rad=stated[1], roll_rad=stated[2], heading_rad=1.0)
    requests = tuple(
        Request(
            probe=Probe(name=kind, kind=kind, pixels=pixels, elevation_std_m=elevation_std_m),
            pixels=pixels,
            std_px=std_px,
        )
        for kind, pixels in PROBES
    )
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=replace(pose, cov=pose_cov), std=PoseStd())
    model, ground = surface
    setup = Setup(camera=replace(CAMERA, std=CameraStd(focal_px=focal_px)), model=model, ground=ground)
    return [each.status for each in measure(setup, sample, requests)]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(LEVEL))
@example(2341, (ProjectionModel.PINHOLE, rough_ground()))
def test_a_refusal_does_not_disappear_when_any_error_grows(seed, surface):
    rng = np.random.default_rng(seed)
    height_m = math.exp(rng.uniform(0, 5))
    stated = height_m, rng.uniform(0, 1.4), rng.uniform(-0.3, 0.3) * (surface[0] is ProjectionModel.PINHOLE)
    scale = np.diag([height_m] * 3 + [1.0] * 3)

    def some(sizes):
        """A covariance of correlated errors of the pose, and stds of focal length, pixels and elevation."""
        parts = rng.normal(size=(6, 3)) * np.exp(rng.uniform(*sizes, 3))
        stds = np.exp(rng.uniform(*sizes, 3)) * [0.3 * CAMERA.fx_px, 30.0, height_m]
        return scale @ parts @ parts.T @ scale, np.square(stds)

    (cov, variances), (more, more_vars) = some([-4, -1]), some([-8, -1])
    before = statuses(surface, stated, cov, *np.sqrt(variances))
    after = statuses(surface, stated, cov + more, *np.sqrt(variances + more_vars))
    refused = [one is Status.ILL_CONDITIONED for one in before]
    assert all(now is Status.ILL_CONDITIONED for now, was in zip(after, refused, strict=True) if was)
