"""Measurements: values from closed forms, standard deviations from Monte-Carlo."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.dft import Request, Setup, project
from aerodft.geometry import camera_pose, from_rotation_vector, multiply
from aerodft.model import (
    Camera,
    CameraStd,
    GeoOrigin,
    HeightSource,
    Pose,
    PoseSample,
    PoseStd,
    Probe,
    ProbeKind,
    ProjectionModel,
    Status,
)
from tests.one_image import measure

CAMERA = Camera(
    name="c",
    width_px=1920,
    height_px=1080,
    fx_px=1600.0,
    fy_px=1600.0,
    cx_px=990.0,
    cy_px=500.0,
    distortion=(-0.1, 0.02, 1e-3, -1e-3),
    std=CameraStd(focal_px=8.0, principal_point_px=2.0),
)
STD = PoseStd(height_agl_m=0.5, horizontal_m=1.0, tilt_rad=0.005, pan_rad=0.006, roll_rad=0.004, heading_rad=0.03)
PIXELS = ((500.0, 700.0), (1500.0, 400.0))


def sample_of(pose, **rest):
    return PoseSample(stamp_ns=0, status=Status.OK, pose=pose, **rest)


def request_of(kind, pixels, std_px=1.0, **rest):
    return Request(probe=Probe(name="p", kind=kind, pixels=pixels, **rest), pixels=pixels, std_px=std_px)


def monte_carlo_points(pose, pixels, elevation_m, rng):
    """One draw of the ground points with every stated error drawn anew."""
    shift = np.linalg.cholesky(pose.cov) @ rng.normal(size=6)
    zoom, centre = 1 + rng.normal() * 8.0 / 1600.0, rng.normal(size=2) * 2.0
    drawn = replace(
        CAMERA,
        fx_px=CAMERA.fx_px * zoom,
        fy_px=CAMERA.fy_px * zoom,
        cx_px=CAMERA.cx_px + centre[0],
        cy_px=CAMERA.cy_px + centre[1],
    )
    turned = Pose(
        position_enu_m=pose.position_enu_m + shift[:3], wxyz=multiply(pose.wxyz, from_rotation_vector(shift[3:]))
    )
    noisy = np.array(pixels) + rng.normal(size=(len(pixels), 2))
    elevation = elevation_m + 0.2 * rng.normal()
    return project(drawn, turned, noisy, elevation, ProjectionModel.PINHOLE).points_enu_m, turned.position_enu_m


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 55.0])
def test_stds_are_monte_carlos(tilt_deg):
    pose = camera_pose(
        height_agl_m=50.0, tilt_rad=math.radians(tilt_deg), roll_rad=0.1, heading_rad=2.0, std=STD, east_m=3.0
    )
    kinds = (
        request_of(ProbeKind.DISTANCE, PIXELS, elevation_std_m=0.2),
        request_of(ProbeKind.RANGE, PIXELS[:1], elevation_std_m=0.2),
        request_of(ProbeKind.POSITION, PIXELS[:1], elevation_std_m=0.2),
    )
    distance, range_, position = measure(Setup(camera=CAMERA), sample_of(pose), kinds)
    rng = np.random.default_rng(5)
    draws = [monte_carlo_points(pose, PIXELS, 0.0, rng) for _ in range(2500)]
    distances = [math.hypot(*(points[1] - points[0])[:2]) for points, _ in draws]
    ranges = [np.linalg.norm(points[0] - eye) for points, eye in draws]
    first = np.array([points[0, :2] for points, _ in draws])
    assert_allclose(distance.std, np.std(distances), rtol=0.06)
    assert_allclose(range_.std, np.std(ranges), rtol=0.06)
    cov = np.array(position.cov_enu_m2)[:2, :2]
    assert_allclose(cov, np.cov(first.T), rtol=0.1, atol=0.05 * np.trace(cov))
    ellipse = position.ellipse95
    along = first @ [math.sin(ellipse.azimuth_rad), math.cos(ellipse.azimuth_rad)]
    assert_allclose(ellipse.semi_major_m, math.sqrt(5.991) * np.std(along), rtol=0.06)


@pytest.mark.parametrize(
    ("kind", "pixels"), [(ProbeKind.DISTANCE, PIXELS), (ProbeKind.RANGE, PIXELS[:1]), (ProbeKind.POSITION, PIXELS[:1])]
)
def test_a_stamp_that_is_off_moves_the_value_as_the_camera_moves(kind, pixels):
    velocity, rate, std_s, later_s = np.array([3.0, -2.0, 1.0]), np.array([0.1, 0.2, -0.05]), 0.005, 1e-5
    still = camera_pose(height_agl_m=50.0, tilt_rad=0.6, heading_rad=1.0)
    moving = replace(still, velocity_enu_mps=velocity, rate_cam_radps=rate, time_std_s=std_s)
    moved = replace(
        still,
        position_enu_m=still.position_enu_m + velocity * later_s,
        wxyz=multiply(still.wxyz, from_rotation_vector(rate * later_s)),
    )
    setup, request = Setup(camera=replace(CAMERA, std=CameraStd())), request_of(kind, pixels, 0.0)
    now, later = (measure(setup, sample_of(pose), (request,))[0] for pose in (moving, moved))
    if kind == ProbeKind.POSITION:
        step = (np.array(later.enu_m[0]) - now.enu_m[0]) / later_s * std_s
        assert_allclose(now.cov_enu_m2, np.outer(step, step), rtol=1e-3, atol=1e-9)
    else:
        assert_allclose(now.std, abs(later.value - now.value) / later_s * std_s, rtol=1e-3)


def test_straight_down_a_width_scales_with_height():
    plain = replace(CAMERA, distortion=(), std=CameraStd())
    pose = camera_pose(height_agl_m=40.0, tilt_rad=0.0, std=PoseStd(height_agl_m=0.4))
    (width,) = measure(
        Setup(camera=plain),
        sample_of(pose),
        (request_of(ProbeKind.DISTANCE, ((590.0, 500.0), (1390.0, 500.0)), std_px=0.0),),
    )
    assert_allclose([width.value, width.std], [800 / 1600 * 40, 0.01 * 800 / 1600 * 40])
    assert_allclose(width.ci95, [20 - 1.96 * 0.2, 20 + 1.96 * 0.2], atol=1e-4)


def test_distance_does_not_depend_on_heading_but_positions_do():
    heading_only = PoseStd(heading_rad=0.05)
    results = []
    for heading in (0.0, 1.0, 4.0):
        pose = camera_pose(height_agl_m=50.0, tilt_rad=0.9, heading_rad=heading, std=heading_only)
        requests = (request_of(ProbeKind.DISTANCE, PIXELS, 0.0), request_of(ProbeKind.POSITION, PIXELS[:1], 0.0))
        results.append(measure(Setup(camera=replace(CAMERA, std=CameraStd())), sample_of(pose), requests))
    for distance, position in results:
        assert_allclose(distance.value, results[0][0].value, rtol=1e-12)
        assert distance.std < 1e-6
        assert position.ellipse95.semi_major_m > 1.0
        assert_allclose(position.ground_m, results[0][1].ground_m, atol=1e-9)


def test_near_the_horizon_the_refusal_says_why():
    std = PoseStd(tilt_rad=math.radians(1.0))
    pose = camera_pose(height_agl_m=30.0, tilt_rad=math.radians(88.0), std=std)
    (answer,) = measure(
        Setup(camera=CAMERA), sample_of(pose, std=std), (request_of(ProbeKind.RANGE, ((990.0, 510.0),)),)
    )
    assert answer.status is Status.ILL_CONDITIONED
    assert answer.reasons[0].startswith("point 0 is 2.4 deg below the horizon, range 729 m")
    assert "of the variance is from tilt (std 1.0 deg); add a landmark, look more steeply down" in answer.reasons[0]
    assert (answer.value, answer.std, answer.ground_m, answer.cov_enu_m2) == (None, None, None, None)


@pytest.mark.parametrize(
    ("std", "cause"),
    [
        (PoseStd(tilt_rad=0.5, roll_rad=0.01), "tilt (std 28.6 deg); know the attitude better: wait until the gimbal"),
        (PoseStd(height_agl_m=12.0), "height of terrain (std 12.0 m); measure the height better"),
    ],
)
def test_what_is_seen_from_above_is_refused_for_what_it_is(std, cause):
    pose = camera_pose(height_agl_m=30.0, tilt_rad=math.radians(30.0), std=std)
    sample = replace(sample_of(pose, std=std), height_source=HeightSource.TERRAIN, reasons=("GPS has no 3D fix",))
    answers = measure(Setup(camera=CAMERA), sample, (request_of(ProbeKind.RANGE, ((990.0, 510.0),)),))
    assert answers[0].status is Status.ILL_CONDITIONED
    assert f"% of the variance is from {cause}" in answers[0].reasons[0]
    assert "horizon" not in answers[0].reasons[0]
    assert answers[0].reasons[1:] == ("GPS has no 3D fix",)


def test_beyond_the_configured_range():
    pose = camera_pose(height_agl_m=30.0, tilt_rad=1.0)
    setup = Setup(camera=CAMERA, max_range_m=20.0)
    (answer,) = measure(setup, sample_of(pose), (request_of(ProbeKind.RANGE, ((990.0, 500.0),)),))
    assert answer.status is Status.BEYOND_RANGE
    assert "the limit is 20 m" in answer.reasons[0]


def test_geodetic_output_is_where_enu_is():
    origin = GeoOrigin(lat_rad=-0.617, lon_rad=2.603, alt_msl_m=584.0)
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.0, east_m=100.0, north_m=50.0)
    (answer,) = measure(
        Setup(camera=replace(CAMERA, distortion=())),
        sample_of(pose, origin=origin),
        (request_of(ProbeKind.POSITION, ((990.0, 500.0),), elevation_m=2.0),),
    )
    assert_allclose(answer.enu_m, [[100.0, 50.0, 2.0]], atol=1e-9)
    assert_allclose(answer.geo[0].alt_msl_m, 586.0)
    metres_north = (answer.geo[0].lat_rad - origin.lat_rad) * 6.356e6
    assert_allclose(metres_north, 50.0, rtol=0.01)


def test_a_bad_pose_is_passed_on():
    sample = PoseSample(stamp_ns=5, status=Status.STALE_TELEMETRY, reasons=("gap",))
    (answer,) = measure(Setup(camera=CAMERA), sample, (request_of(ProbeKind.DISTANCE, PIXELS),))
    assert (answer.status, answer.reasons, answer.stamp_ns) == (Status.STALE_TELEMETRY, ("gap",), 5)


def test_one_bad_probe_does_not_spoil_the_others():
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.5)
    inside, outside = request_of(ProbeKind.RANGE, ((990.0, 500.0),)), request_of(ProbeKind.RANGE, ((-9.0, 5.0),))
    answers = measure(Setup(camera=CAMERA), sample_of(pose), (outside, inside))
    assert [answer.status for answer in answers] == [Status.OUT_OF_IMAGE, Status.OK]


@pytest.mark.parametrize("tilt_deg", [0.0, 50.0])
def test_two_points_in_one_are_not_known_to_be_at_no_distance(tilt_deg):
    """As the points come closer the std goes to what the clicks alone make of it, and it stays there."""
    std_px, at = 1.5, (700.0, 600.0)
    sample = sample_of(camera_pose(height_agl_m=40.0, tilt_rad=math.radians(tilt_deg), std=STD))
    distances = [request_of(ProbeKind.DISTANCE, (at, (at[0] + du, at[1] + dv)), std_px) for du, dv in _compass(1e-6)]
    same = request_of(ProbeKind.DISTANCE, (at, at), std_px)
    *near, zero = measure(Setup(camera=CAMERA), sample, (*distances, same))
    assert zero.value == 0.0
    assert_allclose(zero.std, max(each.std for each in near), rtol=1e-3)


def _compass(radius_px):
    turns = np.linspace(0, math.tau, 360, endpoint=False)
    return [(radius_px * math.cos(turn), radius_px * math.sin(turn)) for turn in turns]
