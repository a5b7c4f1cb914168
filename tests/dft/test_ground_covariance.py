"""Covariances of many points against the engine's own Jacobians, and one against draws."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft.ground_covariance import GroundCovariance
from aerodft.dft.ground_map import GroundMap
from aerodft.dft.projection import project
from aerodft.dft.uncertainty import point_spread, shared_covariance
from aerodft.geometry.poses import camera_pose
from aerodft.geometry.rotation import from_rotation_vector, multiply
from aerodft.model.camera import Camera, CameraStd, LensModel
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import Pose, PoseStd

INTRINSICS = CameraStd(focal_px=3.0, principal_point_px=2.0)
STRAIGHT = Camera(
    name="straight", width_px=960, height_px=640, fx_px=800.0, fy_px=700.0, cx_px=400.0, cy_px=350.0, std=INTRINSICS
)
BARREL, RATIONAL = (-0.2, 0.05, 2e-3, -1e-3), (-0.2, 0.05, 2e-3, -1e-3, 0.01, 0.1, 0.02, 0.01)
BENT = replace(STRAIGHT, name="bent", distortion=BARREL)
FISHEYE = replace(STRAIGHT, name="fisheye", lens=LensModel.FISHEYE, distortion=(0.03, -0.01, 0.002, 0.0))
LENSES = [
    STRAIGHT,
    replace(STRAIGHT, name="straight within", distortion=(0.0,) * 5, std=replace(INTRINSICS, distortion=(1e-3,) * 5)),
    BENT,
    replace(BENT, name="bent, uncertain", std=replace(INTRINSICS, distortion=(1e-3, 2e-3, 1e-4, 2e-4))),
    replace(BENT, name="five", distortion=(*BARREL, 0.01), std=replace(INTRINSICS, distortion=(1e-3,) * 5)),
    replace(BENT, name="rational", distortion=RATIONAL, std=replace(INTRINSICS, distortion=(1e-3,) * 8)),
    FISHEYE,
    replace(FISHEYE, name="fisheye, uncertain", std=replace(INTRINSICS, distortion=(1e-3, 2e-3, 1e-4, 2e-4))),
]
PIXELS = np.concatenate([[[400.0, 350.0]], np.random.default_rng(2).uniform(0, [959, 639], (150, 2))])


@st.composite
def poses(draw):
    """Any attitude, and any covariance of the pose, also a singular one; at times one that moves."""
    tilt, roll, heading = (math.radians(draw(st.floats(*range_))) for range_ in ((0, 100), (-60, 60), (0, 360)))
    place = camera_pose(height_agl_m=draw(st.floats(2.0, 500.0)), tilt_rad=tilt, roll_rad=roll, heading_rad=heading)
    seed, rank = draw(st.integers(0, 10**6)), draw(st.integers(0, 6))
    rng = np.random.default_rng(seed)
    factor = np.array([1.0, 1.0, 0.5, 0.01, 0.01, 0.02])[:, None] * rng.normal(size=(6, rank))
    return Pose(
        position_enu_m=place.position_enu_m + [120.0, -40.0, 0.0],
        wxyz=place.wxyz,
        cov=factor @ factor.T,
        velocity_enu_mps=rng.normal(size=3) * 5,
        rate_cam_radps=rng.normal(size=3) * 0.1,
        time_std_s=draw(st.sampled_from([0.0, 0.05])),
    )


@pytest.mark.parametrize("camera", LENSES, ids=lambda camera: camera.name)
@settings(max_examples=40, deadline=None)
@given(
    pose=poses(),
    elevation_m=st.floats(-1.0, 1.0),
    stds=st.tuples(st.floats(0.0, 0.5), st.floats(0.1, 3.0)),
)
def test_they_are_what_the_jacobians_give(camera, pose, elevation_m, stds):
    elevation_std_m, std_px = stds
    exact = project(camera, pose, PIXELS, elevation_m, ProjectionModel.PINHOLE)
    shared = shared_covariance(camera, pose, np.zeros(1))
    stds = np.full(len(PIXELS), elevation_std_m), np.full(len(PIXELS), std_px)
    with np.errstate(all="ignore"):  # above the horizon
        wanted = point_spread(exact[None], pose.position_enu_m[None], shared, *stds).cov_enu_m2[0, :, :2, :2]
    ground = GroundCovariance.at(camera, pose, std_px=std_px, elevation_m=elevation_m, elevation_std_m=elevation_std_m)
    points, covs = ground.points_and_covariances(PIXELS)
    clear = np.abs(exact.depression_rad) > 1e-3
    good = clear & (exact.status == 0)
    assert np.array_equal(np.isnan(points[clear, 0]), exact.status[clear] != 0)
    assert np.array_equal(np.isnan(covs).all(axis=(-2, -1)), np.isnan(points[:, 0]))
    assert_allclose(points[good], exact.points_enu_m[good, :2], rtol=1e-9, atol=1e-6)
    size = np.trace(wanted[good], axis1=-2, axis2=-1)[:, None, None]
    assert_allclose(covs[good] / size, wanted[good] / size, rtol=0, atol=1e-9)
    assert np.array_equal(covs[good], covs[good].swapaxes(-1, -2))


@pytest.mark.parametrize("camera", LENSES, ids=lambda camera: camera.name)
def test_the_points_are_the_ground_maps_and_leading_axes_are_batch(camera):
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.5, heading_rad=2.0)
    ground = GroundCovariance.at(camera, pose, std_px=1.0)
    many = np.tile(PIXELS, (40, 1))  # more than are taken at once
    points, covs = ground.points_and_covariances(many)
    assert_allclose(points, GroundMap.at(camera, pose).points_en_m(many), rtol=0, atol=1e-10)
    for shape in ((), (1,), (5,), (2, 3)):
        some = many[: max(1, math.prod(shape))].reshape(*shape, 2)
        got_points, got_covs = ground.points_and_covariances(some)
        assert got_points.shape == (*shape, 2)
        assert got_covs.shape == (*shape, 2, 2)
        assert_allclose(got_points.reshape(-1, 2), points[: some.size // 2], rtol=0, atol=1e-10)
        assert_allclose(got_covs.reshape(-1, 2, 2), covs[: some.size // 2], rtol=1e-10, atol=1e-12)


def test_from_below_nothing_is_seen():
    pose = camera_pose(height_agl_m=3.0, tilt_rad=0.5)
    for camera in LENSES:
        ground = GroundCovariance.at(camera, pose, std_px=1.0, elevation_m=3.0)
        for found in ground.points_and_covariances(PIXELS):
            assert np.all(np.isnan(found))


@pytest.mark.parametrize("camera", [STRAIGHT, BENT, FISHEYE], ids=lambda camera: camera.name)
def test_draws_scatter_as_it_says(camera):
    rng, count, std_px = np.random.default_rng(8), 4000, 0.7
    std = PoseStd(height_agl_m=0.2, horizontal_m=0.1, tilt_rad=3e-3, pan_rad=2e-3, roll_rad=4e-3)
    pose = camera_pose(height_agl_m=40.0, tilt_rad=0.9, roll_rad=0.1, heading_rad=1.0, std=std)
    pixel = np.array([620.0, 410.0])
    _, cov = GroundCovariance.at(camera, pose, std_px=std_px).points_and_covariances(pixel)
    errors = rng.multivariate_normal(np.zeros(6), pose.cov, count)
    drawn = []
    for error, own, bend in zip(errors, rng.normal(size=(count, 2)), rng.normal(size=(count, 3)), strict=True):
        moved = replace(
            pose,
            position_enu_m=pose.position_enu_m + error[:3],
            wxyz=multiply(pose.wxyz, from_rotation_vector(error[3:])),
        )
        zoom = 1 + bend[0] * INTRINSICS.focal_px / camera.fx_px
        lens = replace(
            camera,
            fx_px=camera.fx_px * zoom,
            fy_px=camera.fy_px * zoom,
            cx_px=camera.cx_px + bend[1] * INTRINSICS.principal_point_px,
            cy_px=camera.cy_px + bend[2] * INTRINSICS.principal_point_px,
        )
        drawn.append(GroundMap.at(lens, moved).points_en_m(pixel + own * std_px))
    assert_allclose(np.cov(np.array(drawn).T), cov, rtol=0, atol=0.06 * np.trace(cov))
