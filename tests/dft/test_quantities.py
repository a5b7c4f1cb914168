"""Scalars of points against closed forms, their gradients against finite differences, heights against a built scene."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft import PROBE_KINDS, RayGeometry, Request, Setup
from aerodft.dft.quantities import crosses_itself, lateral_offset
from aerodft.geometry import camera_pose, matrix, pixels_from_rays
from aerodft.model import Camera, PoseSample, PoseStd, Probe, ProbeKind, Status
from tests.one_image import measure

CAMERA = Camera(
    name="c", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1500.0, cx_px=970.0, cy_px=530.0,
    distortion=(-0.1, 0.02, 1e-3, -1e-3),
)  # fmt: skip
UNIT_SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def sight_of(points, camera=(0.0, -5.0, 10.0)):
    camera = np.array(camera)
    return RayGeometry(camera, np.asarray(points) - camera, np.asarray(points))


def pixels_of(pose, points):
    seen = (points - pose.position_enu_m) @ matrix(pose.wxyz)
    return tuple(map(tuple, pixels_from_rays(CAMERA, seen).tolist()))


def answer_of(kind, pixels, pose, *, std_px=1.0, setup=None, **probe):
    request = Request(probe=Probe(name="p", kind=kind, pixels=pixels, **probe), pixels=pixels, std_px=std_px)
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose)
    return measure(setup or Setup(camera=CAMERA), sample, (request,))[0]


def test_closed_forms():
    square = sight_of(UNIT_SQUARE)
    assert PROBE_KINDS[ProbeKind.AREA].scalar(square) == 1.0
    assert PROBE_KINDS[ProbeKind.AREA].scalar(sight_of(UNIT_SQUARE[::-1])) == 1.0
    assert PROBE_KINDS[ProbeKind.LENGTH].scalar(square) == 3.0
    assert PROBE_KINDS[ProbeKind.DISTANCE].scalar(square) == 1.0
    assert_allclose(PROBE_KINDS[ProbeKind.RANGE].scalar(square), math.sqrt(125))


@pytest.mark.parametrize("kind", [kind for kind, traits in PROBE_KINDS.items() if traits.scalar])
@given(data=st.data())
@settings(max_examples=40, deadline=None)
def test_gradients_are_finite_differences(kind, data):
    numbers = data.draw(st.lists(st.floats(-20, 20), min_size=15, max_size=15))
    camera = np.array([numbers[0], numbers[1] - 60.0, 30.0])
    count = {ProbeKind.AREA: 4, ProbeKind.LENGTH: 4, ProbeKind.RANGE: 1}.get(kind, 2)
    points = (np.array(numbers[2:14]).reshape(4, 3) * [1, 1, 0] + UNIT_SQUARE * 9)[:count]
    directions = (points - camera) * 0.1 + [0.0, 0.0, 0.4]
    geometry = RayGeometry(camera, directions, points)
    found = PROBE_KINDS[kind].gradient(geometry)
    value = PROBE_KINDS[kind].scalar
    assume(np.linalg.norm(np.diff(points, axis=0), axis=1).min(initial=1.0) > 1e-2)
    assume(kind != ProbeKind.AREA or value(geometry) > 1e-2)
    assert_is_derivative(found, value, geometry)


@given(st.lists(st.floats(-20, 20), min_size=8, max_size=8))
@settings(max_examples=40, deadline=None)
def test_how_far_a_top_is_beside_its_base_has_its_derivatives(numbers):
    camera = np.array([numbers[0], numbers[1] - 60.0, 30.0])
    points = np.array([[numbers[2], numbers[3], 0.0], [numbers[4], numbers[5], 0.0]])
    directions = (points - camera) * 0.1 + [numbers[6] / 10, numbers[7] / 10, 0.4]
    geometry = RayGeometry(camera, directions, points)
    off, found = lateral_offset(geometry)
    ray = directions[1, :2] / np.hypot(*directions[1, :2])
    foot = camera[:2] + ray * (ray @ (points[0] - camera)[:2])
    assert_allclose(abs(off), np.hypot(*(points[0, :2] - foot)), atol=1e-9)
    assert_is_derivative(found, lambda moved: lateral_offset(moved)[0], geometry)


def assert_is_derivative(found, value, geometry):
    step = 1e-6
    for part, by in (
        ("camera_enu_m", found.by_camera),
        ("directions_enu", found.by_directions),
        ("points_enu_m", found.by_points),
    ):
        base = getattr(geometry, part)
        for index in np.ndindex(base.shape):
            ends = []
            for sign in (1, -1):
                moved = base.copy()
                moved[index] += sign * step
                parts = {name: getattr(geometry, name) for name in ("camera_enu_m", "directions_enu", "points_enu_m")}
                ends.append(float(value(RayGeometry(**{**parts, part: moved}))))
            assert_allclose(by[index], (ends[0] - ends[1]) / (2 * step), atol=1e-4, rtol=1e-4, err_msg=f"{part}{index}")


@pytest.mark.parametrize("heading_deg", [0, 45, 133, 270])
@pytest.mark.parametrize("aside_m", [-8.0, 0.0, 5.0])
def test_an_upright_post_has_its_height_at_every_heading_and_column(heading_deg, aside_m):
    pose = camera_pose(height_agl_m=12.0, tilt_rad=1.0, roll_rad=0.1, heading_rad=math.radians(heading_deg))
    ahead = np.array([math.sin(math.radians(heading_deg)), math.cos(math.radians(heading_deg)), 0])
    base = pose.position_enu_m * [1, 1, 0] + 20 * ahead + aside_m * np.array([ahead[1], -ahead[0], 0])
    pixels = pixels_of(pose, np.array([base, base + [0, 0, 2.0]]))
    assert_allclose(answer_of(ProbeKind.HEIGHT, pixels, pose).value, 2.0, atol=1e-6)


def test_the_top_may_be_above_the_horizon():
    pose = camera_pose(height_agl_m=3.0, tilt_rad=math.radians(85))
    base = np.array([0.0, 15.0, 0.0])
    answer = answer_of(ProbeKind.HEIGHT, pixels_of(pose, np.array([base, base + [0, 0, 5.0]])), pose)
    assert answer.status is Status.OK
    assert_allclose(answer.value, 5.0, atol=1e-6)


def test_what_is_seen_beside_the_base_is_no_top_of_it():
    pose = camera_pose(height_agl_m=12.0, tilt_rad=1.0)
    base = np.array([0.0, 18.0, 0.0])
    leaning, elsewhere = (
        answer_of(ProbeKind.HEIGHT, pixels_of(pose, np.array([base, base + [aside, 0, 2.0]])), pose)
        for aside in (1.2, 6.0)
    )
    assert leaning.status is Status.OK
    assert elsewhere.status is Status.NOT_UPRIGHT
    assert "m beside the vertical through the base" in elsewhere.reasons[0]


@pytest.mark.parametrize(
    ("corners", "crosses"),
    [
        ([(0, 0), (4, 0), (4, 3), (0, 3)], False),
        ([(0, 0), (4, 0), (2, 1), (4, 3), (0, 3)], False),
        ([(0, 0), (4, 0), (4, 0), (4, 3), (0, 3), (0, 3)], False),
        ([(0, 0), (4, 3), (4, 0), (0, 3)], True),
        ([(0, 0), (4, 0), (2, 2), (0, 4), (4, 4), (2, 2)], True),
        ([(0, 0), (4, 0), (4, 3), (0, 3)] * 2, True),
        ([(0, 0), (4, 0), (4, 3), (0, 3), (4, 3), (4, 0)], True),
        ([(0, 0), (4, 0), (2, 0), (2, 3)], True),
        ([(0, 0), (4, 0), (4, 3), (2, 0), (0, 3)], True),
        ([(0, 0), (4, 0), (9, 0)], True),
        ([(0, 0), (4, 0), (0, 0)], True),
        ([(1, 1), (1, 1), (1, 1)], True),
    ],
    ids=[
        "square",
        "dent",
        "twice-clicked",
        "bow",
        "eight",
        "two-rounds",
        "back",
        "spur",
        "touch",
        "line",
        "two",
        "one",
    ],
)
def test_a_polygon_goes_round_one_piece_of_ground(corners, crosses):
    turned = np.array(corners, dtype=float) @ [[0.8, 0.6], [-0.6, 0.8]] + [1234.5, -987.6]
    assert bool(crosses_itself(np.column_stack([turned, np.zeros(len(turned))]))) is crosses


def test_no_length_is_negative():
    pose = camera_pose(height_agl_m=12.0, tilt_rad=1.0)
    nothing = answer_of(ProbeKind.DISTANCE, ((900.0, 500.0), (900.0, 500.0)), pose)
    assert (nothing.value, nothing.ci95[0]) == (0.0, 0.0)
    assert nothing.ci95[1] > 0


def test_swapped_base_and_top_are_named():
    pose = camera_pose(height_agl_m=12.0, tilt_rad=1.0)
    base = np.array([0.0, 18.0, 0.0])
    bottom, top = pixels_of(pose, np.array([base, base + [0, 0, 2.0]]))
    answer = answer_of(ProbeKind.HEIGHT, (top, bottom), pose)
    assert answer.status is Status.NOT_UPRIGHT
    assert "the base comes first" in answer.reasons[0]
    assert answer.value is None


def test_a_polygon_whose_sides_cross_has_no_area():
    bow_tie = UNIT_SQUARE[[0, 2, 1, 3]]
    assert crosses_itself(bow_tie)
    assert not crosses_itself(UNIT_SQUARE)
    pose = camera_pose(height_agl_m=12.0, tilt_rad=0.4)
    answer = answer_of(ProbeKind.AREA, pixels_of(pose, bow_tie + [0, 4, 0]), pose)
    assert answer.status is Status.SELF_CROSSING


def test_width_at_an_elevation():
    pose = camera_pose(height_agl_m=10.0, tilt_rad=0.0)
    low = answer_of(ProbeKind.WIDTH, ((470.0, 530.0), (1470.0, 530.0)), pose)
    high = answer_of(ProbeKind.WIDTH, ((470.0, 530.0), (1470.0, 530.0)), pose, elevation_m=5.0)
    assert_allclose(high.value, low.value / 2)


def test_near_the_horizon_the_interval_is_longer_on_the_far_side():
    std = PoseStd(tilt_rad=math.radians(0.3), pan_rad=0.0, roll_rad=0.0)
    pose = camera_pose(height_agl_m=50.0, tilt_rad=math.radians(87.0), std=std)
    answer = answer_of(ProbeKind.RANGE, ((970.0, 530.0),), pose)
    low, high = answer.ci95
    assert high - answer.value > 1.2 * (answer.value - low)
    angles = math.radians(3.0) + np.array([1.96, -1.96]) * math.hypot(math.radians(0.3), 1 / 1500)
    assert_allclose(answer.ci95, 50.0 / np.sin(angles), rtol=0.02)
