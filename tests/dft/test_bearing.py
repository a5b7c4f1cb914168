"""Bearings against the directions of built scenes, and their standard deviations against Monte-Carlo."""

import math
import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft import Request, Setup, explain
from aerodft.geometry import camera_pose, from_rotation_vector, matrix, multiply
from aerodft.model import Camera, PoseSample, PoseStd, Probe, ProbeKind, ProjectionModel, Status
from tests.one_image import measure

CAMERA = Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.7)
INVERSE = np.linalg.inv(
    [[CAMERA.fx_px, 0, CAMERA.cx_px], [0, CAMERA.fy_px, CAMERA.cy_px], [0, 0, 1]],
)


def answer(pose, *pixels, std_px=1.0, model=ProjectionModel.PINHOLE):
    request = Request(probe=Probe(name="b", kind=ProbeKind.BEARING, pixels=pixels), pixels=pixels, std_px=std_px)
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose)
    return measure(Setup(camera=CAMERA, model=model), sample, (request,))[0]


def azimuth_deg(away):
    return math.degrees(math.atan2(away[0], away[1])) % 360


def turned_deg(a, b):
    return (a - b + 180) % 360 - 180


@given(
    tilt=st.floats(0, 2.0),
    roll=st.floats(-1, 1),
    heading=st.floats(0, 6.28),
    u=st.floats(0, 1919),
    v=st.floats(0, 1079),
)
@settings(max_examples=200, deadline=None)
def test_a_rays_bearing_is_its_direction_above_and_below_the_horizon(tilt, roll, heading, u, v):
    pose = camera_pose(height_agl_m=30.0, tilt_rad=tilt, roll_rad=roll, heading_rad=heading)
    ray = matrix(pose.wxyz) @ INVERSE @ [u, v, 1.0]
    assume(math.hypot(ray[0], ray[1]) > 1e-3)
    found = answer(pose, (u, v), std_px=1e-3)
    assert (found.status, found.unit, found.enu_m) == (Status.OK, "deg", None)
    assert abs(turned_deg(found.value, azimuth_deg(ray))) < 1e-9
    assert 0 <= found.value < 360


@given(
    heading=st.floats(0, 6.28),
    pixels=st.lists(st.tuples(st.floats(0, 1919), st.floats(400, 1079)), min_size=2, max_size=2),
)
@settings(max_examples=100, deadline=None)
def test_two_points_have_the_bearing_from_the_first_to_the_second(heading, pixels):
    assume(math.dist(*pixels) > 5)
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.7, heading_rad=heading)
    rays = np.array([matrix(pose.wxyz) @ INVERSE @ [*pixel, 1.0] for pixel in pixels])
    first, second = rays * (-30.0 / rays[:, 2])[:, None]
    found = answer(pose, *pixels, std_px=1e-3)
    assert abs(turned_deg(found.value, azimuth_deg(second - first))) < 1e-7
    assert_allclose(np.array(found.enu_m)[:, :2], [first[:2], second[:2]], atol=1e-9)


STD = PoseStd(height_agl_m=0.5, horizontal_m=1.0, tilt_rad=0.01, pan_rad=0.01, roll_rad=0.02, heading_rad=0.02)


@pytest.mark.parametrize("pixels", [((300.0, 200.0),), ((300.0, 900.0), (500.0, 700.0))], ids=["ray", "pair"])
def test_its_standard_deviation_is_monte_carlos_also_across_north(pixels):
    pose = camera_pose(height_agl_m=30.0, tilt_rad=1.0, heading_rad=0.3, std=STD)
    found = answer(pose, *pixels, std_px=2.0)
    rng = np.random.default_rng(4)
    drawn = []
    for _ in range(4000):
        shift = np.linalg.cholesky(pose.cov) @ rng.normal(size=6)
        turn = matrix(multiply(pose.wxyz, from_rotation_vector(shift[3:])))
        noisy = np.array(pixels) + 2.0 * rng.normal(size=(len(pixels), 2))
        rays = np.column_stack([noisy, np.ones(len(pixels))]) @ INVERSE.T @ turn.T
        points = rays * (-(30.0 + shift[2]) / rays[:, 2])[:, None]
        drawn.append(turned_deg(azimuth_deg(rays[0] if len(pixels) == 1 else points[1] - points[0]), found.value))
    assert_allclose(found.std, np.std(drawn), rtol=0.05)
    assert_allclose((found.ci95[1] - found.ci95[0]) / 2, 1.96 * found.std, rtol=1e-3)


def test_straight_down_there_is_no_direction():
    found = answer(camera_pose(height_agl_m=30.0, tilt_rad=0.0), (959.5, 539.5))
    assert found.status is Status.ILL_CONDITIONED
    assert re.fullmatch(r"the direction is known to \+- 1[78]\d deg \(95 %\)", found.reasons[0])
    assert found.value is None


def test_its_interval_near_nadir_is_drawn_and_holds_what_it_says():
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.0)
    found = answer(pose, (969.5, 539.5), std_px=2.0)
    rng = np.random.default_rng(5)
    noisy = np.array([969.5, 539.5]) + 2.0 * rng.normal(size=(20000, 2))
    rays = (noisy - [959.5, 539.5]) / [CAMERA.fx_px, -CAMERA.fy_px]
    drawn = [turned_deg(azimuth_deg(ray), found.value) for ray in rays]
    low, high = np.quantile(drawn, [0.025, 0.975])
    assert_allclose([found.ci95[0] - found.value, found.ci95[1] - found.value], [low, high], rtol=0.08)


def test_the_papers_bearing_is_that_of_its_ground_point():
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.8, heading_rad=1.0)
    found = answer(pose, (1500.0, 700.0), model=ProjectionModel.DFT)
    phi = (1500.0 - 960.0) * CAMERA.hfov_rad / 1920
    assert_allclose(found.value, math.degrees(1.0 + phi), atol=1e-9)


def test_the_budget_is_in_degrees():
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.8, std=PoseStd(heading_rad=math.radians(2.0)))
    request = Request(
        probe=Probe(name="b", kind=ProbeKind.BEARING, pixels=((960.0, 500.0),)), pixels=((960.0, 500.0),), std_px=0.0
    )
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose, std=PoseStd(heading_rad=math.radians(2.0)))
    (share,) = explain(Setup(camera=CAMERA), sample, request)
    assert share.source == "heading"
    assert_allclose(share.std, 2.0, rtol=1e-9)
