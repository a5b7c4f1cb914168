"""What a calibration's picture draws is where OpenCV and the paper's equations put it."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.adapters.config.evidence import LocalFrame
from aerodft.dft import equations
from aerodft.model import (
    Camera,
    GroundLines,
    GroundPoint,
    Horizon,
    KnownHeight,
    KnownLength,
    Landmark,
    LensModel,
    ProjectionModel,
    SlantRange,
    Vertical,
)
from aerodft.reports.calibration.ground_grid import GAP, ground_grid, horizon_px, map_axes
from aerodft.reports.calibration.marks import from_foot, mark_of, pixels_of
from calibration.pose import State

MICRO_PX, MILLIMETRE = 1e-6, 1e-3
LENS = {
    "name": "c",
    "width_px": 1920,
    "height_px": 1080,
    "fx_px": 1500.0,
    "fy_px": 1480.0,
    "cx_px": 950.0,
    "cy_px": 545.0,
}
BROWN = Camera(**LENS, distortion=(-0.12, 0.03, 0.001, -0.002))
FISHEYE = Camera(**{**LENS, "fx_px": 900.0, "fy_px": 905.0}, lens=LensModel.FISHEYE, distortion=(0.02, -0.01, 0.0, 0.0))
PAPER = Camera.from_fov(name="p", width_px=3888, height_px=2592, hfov_rad=1.12, vfov_rad=0.79)
POSITION = (120.0, -40.0, 11.0)
LOCAL = LocalFrame("local", (0.0, 0.0, 0.0))


def state_of(camera=BROWN, tilt=66.0, roll=-3.0, heading=155.0, model=ProjectionModel.PINHOLE, elevation_m=0.0):
    angles = tuple(math.radians(each) for each in (tilt, roll, heading))
    return State.from_angles(camera, np.array(POSITION), angles, elevation_m, model)


def by_opencv(state, points):
    """Pixels of points in front of the camera."""
    camera, turn = state.camera, state.rotation.T
    matrix = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    rvec, tvec = cv2.Rodrigues(turn)[0], -turn @ state.position_m
    points = np.asarray(points, dtype=np.float64).reshape(-1, 1, 3)
    if camera.lens is LensModel.FISHEYE:
        found, _ = cv2.fisheye.projectPoints(points, rvec, tvec, matrix, np.array(camera.distortion))
    else:
        found, _ = cv2.projectPoints(points, rvec, tvec, matrix, np.array(camera.distortion))
    return found.reshape(-1, 2)


def ground_by_opencv(state, pixels, elevation_m):
    """Where pixels meet the ground, from OpenCV's rays."""
    camera = state.camera
    matrix = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    pixels, coefficients = pixels.reshape(-1, 1, 2), np.array(camera.distortion)
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    if camera.lens is LensModel.FISHEYE:
        flat = cv2.fisheye.undistortPoints(pixels, matrix, coefficients, criteria=stop).reshape(-1, 2)
    else:
        flat = cv2.undistortPoints(pixels, matrix, coefficients, criteria=stop).reshape(-1, 2)
    rays = np.column_stack([flat, np.ones(len(flat))]) @ state.rotation.T
    return state.position_m + rays * ((elevation_m - state.position_m[2]) / rays[:, 2])[:, None]


@pytest.mark.parametrize(
    "state",
    [
        state_of(),
        state_of(heading=10.0, tilt=30.0, roll=8.0),
        state_of(FISHEYE, tilt=35.0),
        state_of(tilt=88.0, roll=0.0),
    ],
    ids=["oblique", "steep", "fisheye", "horizon"],
)
@pytest.mark.parametrize("elevation_m", [0.0, 2.5])
def test_grid_lines_are_opencvs_pixels_of_round_metres(state, elevation_m):
    grid = ground_grid(state, map_axes(LOCAL, elevation_m))
    assert len({line.axis for line in grid.lines}) == 2
    assert len(grid.lines) > 5
    for line in grid.lines:
        assert math.isclose(line.value_m / line.spacing_m, round(line.value_m / line.spacing_m), abs_tol=1e-9)
        points = ground_by_opencv(state, line.pixels_px, elevation_m)
        away = np.linalg.norm(points - state.position_m, axis=-1)
        assert_allclose(points[:, line.axis], line.value_m, atol=MILLIMETRE * max(1.0, away.max()))
        points[:, line.axis] = line.value_m
        assert_allclose(by_opencv(state, points), line.pixels_px, atol=1e-2)


def test_grid_lines_keep_their_distance_and_end_at_the_border_or_for_coarser_ones():
    state = state_of()
    grid = ground_grid(state, map_axes(LOCAL, 0.0))
    gap_px = GAP * 1920
    for line in grid.lines:
        assert np.all(line.pixels_px > -0.5 - MICRO_PX)
        assert np.all(line.pixels_px < [1919.5 + MICRO_PX, 1079.5 + MICRO_PX])
        points = ground_by_opencv(state, line.pixels_px, 0.0)
        beside = points.copy()
        beside[:, line.axis] += 1e-4
        along = points.copy()
        along[:, 1 - line.axis] += 1e-4
        here, across, on = (by_opencv(state, each) for each in (points, beside, along))
        tangent = (on - here) / np.linalg.norm(on - here, axis=-1, keepdims=True)
        off = (across - here) * line.spacing_m / 1e-4
        gaps = np.abs(off[:, 0] * tangent[:, 1] - off[:, 1] * tangent[:, 0])
        assert gaps.min() > 0.99 * gap_px
        for end, gap in ((here[0], gaps[0]), (here[-1], gaps[-1])):
            border = min(*(end + 0.5), *([1919.5, 1079.5] - end))
            assert abs(border) < 0.01 or gap < 1.01 * gap_px


def test_no_line_is_above_the_horizon_and_the_horizon_is_level():
    state = state_of(tilt=86.0)
    (horizon,) = horizon_px(state)
    azimuth = np.linspace(math.radians(130.0), math.radians(180.0), 50)
    far = state.position_m + 1e9 * np.column_stack([np.sin(azimuth), np.cos(azimuth), np.zeros(50)])
    level = by_opencv(state, far)
    at = np.interp(level[:, 0], horizon[:, 0], horizon[:, 1])
    assert_allclose(at, level[:, 1], atol=0.05)
    for line in ground_grid(state, map_axes(LOCAL, 0.0)).lines:
        inside = (line.pixels_px[:, 0] > horizon[0, 0]) & (line.pixels_px[:, 0] < horizon[-1, 0])
        top = np.interp(line.pixels_px[inside, 0], horizon[:, 0], horizon[:, 1])
        assert np.all(line.pixels_px[inside, 1] > top)


def test_a_camera_that_sees_no_ground_has_no_grid():
    grid = ground_grid(state_of(tilt=150.0, roll=0.0), map_axes(LOCAL, 0.0))
    assert (grid.lines, grid.base_m) == ((), (0.0, 0.0))


def test_large_coordinates_are_written_short():
    frame = LocalFrame("local", (192_100.0, 313_150.0, 138.0))
    grid = ground_grid(state_of(), map_axes(frame, 0.0))
    assert grid.base_m == (192_000.0, 313_000.0)
    line = next(each for each in grid.lines if each.axis == 0)
    assert grid.text(line) == f"E {line.value_m - 192_000:g}"
    points = ground_by_opencv(state_of(), line.pixels_px, 0.0)
    assert_allclose(points[:, 0] + 192_100, line.value_m, atol=0.01)
    assert grid.note.endswith("E counts from 192000; N counts from 313000")


def test_projected_coordinates_are_those_of_the_file_and_degrees_become_metres():
    rd = LocalFrame("EPSG:28992", (192_100.0, 313_150.0, 138.0))
    axes = map_axes(rd, 0.0)
    assert_allclose(axes.from_enu(axes.to_enu(np.array([[192_150.0, 313_180.0]]))), [[192_150.0, 313_180.0]], atol=1e-6)
    assert_allclose(axes.to_enu(np.array([192_150.0, 313_180.0])), [50.0, 30.0, 0.0], atol=0.02)
    degrees = map_axes(LocalFrame("geo", (48.0, 11.0, 500.0)), 1.0)
    assert_allclose(degrees.to_enu(np.array([3.0, 4.0])), [3.0, 4.0, 1.0])


@given(st.floats(0, 3888), st.floats(0, 2592), st.floats(0, 85), st.floats(0, 360))
def test_pixels_of_the_papers_model_are_its_equations_the_other_way_round(i, j, tilt, heading):
    state = state_of(PAPER, tilt, 0.0, heading, ProjectionModel.DFT)
    psi = equations.vertical_angle(j, math.radians(tilt), 2592, PAPER.vfov_rad)
    phi = equations.rotation_angle(i, 3888, PAPER.hfov_rad)
    xy = equations.ground_point(POSITION[2], psi, phi)
    if np.all(np.isfinite(xy)) and 1e-6 < abs(xy[1]) < 1e6:
        assert_allclose(pixels_of(state, from_foot(state, xy, 0.0)), [i, j], atol=1e-4)


def test_the_papers_horizon_is_a_row():
    state = state_of(PAPER, 80.0, 0.0, 20.0, ProjectionModel.DFT)
    (line,) = horizon_px(state)
    row = 2592 / 2 - math.radians(10.0) * 2592 / PAPER.vfov_rad
    assert_allclose(line, [[-0.5, row], [3887.5, row]])
    assert horizon_px(state_of(PAPER, 20.0, 0.0, 20.0, ProjectionModel.DFT)) == ()


def scene(state):
    """Observations that a camera makes without any error, by OpenCV; the first pixel of each may be moved."""
    foot, heading = state.position_m * [1, 1, 0], state.value("heading")
    ahead = np.array([math.sin(heading), math.cos(heading), 0.0])
    right = np.array([math.cos(heading), -math.sin(heading), 0.0])

    def at(x, y, up=0.0):
        return foot + x * right + y * ahead + [0.0, 0.0, up]

    def px(*points):
        return tuple(tuple(pixel) for pixel in by_opencv(state, points).tolist())

    mark = at(3.0, 20.0, 1.5)
    level = [state.position_m + 1e9 * (ahead + share * right) for share in (-0.3, 0.1, 0.4)]
    length_px, upright = px(at(-4, 14, 0.5), at(1, 19, 0.5)), px(at(2, 17), at(2, 17, 3))
    first, second, across = px(at(-3, 14), at(3, 16)), px(at(0, 24, 1), at(-6, 22, 1)), px(at(0, 24), at(1, 21))
    return {
        "landmark": Landmark(name="l", pixel=px(mark)[0], position_m=tuple(mark.tolist())),
        "no height": Landmark(name="l", pixel=px(mark)[0], position_m=(mark[0], mark[1], None)),
        "no east": Landmark(name="l", pixel=px(mark)[0], position_m=(None, mark[1], mark[2])),
        "range": SlantRange(name="r", pixel=px(at(-2, 15))[0], range_m=math.hypot(2, 15, POSITION[2])),
        "ground": GroundPoint(name="g", pixel=px(at(4, 25))[0], xy_m=(4.0, 25.0)),
        "length": KnownLength(name="d", pixels=length_px, length_m=math.hypot(5, 5), elevation_m=0.5),
        "height": KnownHeight(name="h", base=upright[0], top=upright[1], height_m=3.0),
        "vertical": Vertical(name="v", pixels=px(at(5, 22), at(5, 22, 4))),
        "parallel": GroundLines(name="p", first=first, second=second, at_right_angle=False),
        "right_angle": GroundLines(name="p", first=first, second=across, at_right_angle=True),
        "horizon": Horizon(name="s", pixels=px(*level)),
    }


@pytest.mark.parametrize("kind", list(scene(state_of())))
@pytest.mark.parametrize("camera", [BROWN, FISHEYE], ids=["brown", "fisheye"])
def test_without_errors_everything_is_expected_where_it_is_seen(kind, camera):
    state = state_of(camera)
    mark = mark_of(state, scene(state)[kind])
    expected = np.isfinite(mark.expected_px)
    assert np.any(expected)
    assert_allclose(mark.expected_px[expected], mark.seen_px[expected], atol=1e-3)


@pytest.mark.parametrize(
    ("kind", "moved", "pixel"),
    [("landmark", "pixel", 0), ("ground", "pixel", 0), ("height", "top", 1)],
)
def test_what_has_one_place_is_expected_there_wherever_it_is_seen(kind, moved, pixel):
    state = state_of()
    truth = scene(state)[kind]
    u, v = getattr(truth, moved)
    mark = mark_of(state, replace(truth, **{moved: (u + 30.0, v - 20.0)}))
    assert_allclose(mark.expected_px[pixel], [u, v], atol=1e-3)
    assert_allclose(mark.off_px, [-30.0, 20.0], atol=1e-3)


def test_a_mast_of_unknown_height_is_expected_on_its_plumb_line():
    state = state_of()
    truth = scene(state)["no height"]
    east, north, _ = truth.position_m
    mark = mark_of(state, replace(truth, pixel=(truth.pixel[0] + 15.0, truth.pixel[1] + 5.0)))
    line = by_opencv(state, [(east, north, up) for up in np.linspace(-3, 6, 20001)])
    assert np.min(np.linalg.norm(line - mark.expected_px[0], axis=-1)) < 0.1
    nearest = np.min(np.linalg.norm(line - mark.seen_px[0], axis=-1))
    assert np.linalg.norm(mark.off_px) < 1.05 * nearest


def test_lengths_ranges_and_angles_are_right_where_they_are_expected():
    state = state_of()
    known = scene(state)
    length = mark_of(state, replace(known["length"], length_m=8.0))
    a, b = ground_by_opencv(state, length.expected_px, 0.5)
    assert math.isclose(np.linalg.norm(b - a), 8.0, abs_tol=1e-3)
    range_ = mark_of(state, replace(known["range"], range_m=25.0))
    (far,) = ground_by_opencv(state, range_.expected_px, 0.0)
    assert math.isclose(math.dist(far, POSITION), 25.0, abs_tol=1e-3)
    for kind, wanted in (("parallel", 0.0), ("right_angle", math.pi / 2)):
        (u, v), end = known[kind].second
        mark = mark_of(state, replace(known[kind], second=((u, v + 25.0), end)))
        a, b, c, d = ground_by_opencv(state, mark.expected_px, 0.0)[:, :2]
        angle = abs(math.remainder(math.atan2(*(b - a)) - math.atan2(*(d - c)), math.pi))
        assert math.isclose(angle, wanted, abs_tol=1e-5)
        assert np.linalg.norm(mark.off_px) > 1.0


def test_the_seas_horizon_is_as_far_below_level_as_the_earth_curves():
    state = state_of(tilt=80.0, roll=0.0)
    pixels = ((300.0, 280.0), (1500.0, 290.0))
    level, sea = (mark_of(state, Horizon(name="s", pixels=pixels, is_sea=is_sea)) for is_sea in (False, True))
    dip = math.acos(1 / (1 + POSITION[2] / (6_371_000 / (1 - 0.13))))  # seen over a sphere, with refraction of 0.13
    middle = state_of(BROWN, tilt=80.0, roll=0.0)
    assert middle.value("tilt") == state.value("tilt")
    below = sea.expected_px[:, 1] - level.expected_px[:, 1]
    assert np.all(below > 0)
    assert_allclose(below, 1480.0 * dip, rtol=0.15)  # 10 degrees off axis


def test_what_cannot_be_seen_is_expected_nowhere():
    state = state_of()
    behind = Landmark(name="b", pixel=(10.0, 10.0), position_m=(POSITION[0] - 30.0, POSITION[1] + 30.0, 20.0))
    near = SlantRange(name="r", pixel=(900.0, 900.0), range_m=POSITION[2] / 2)
    down, level = ((900.0, -400.0), (900.0, 900.0)), ((0.0, 900.0), (9.0, 800.0))
    crossing = GroundLines(name="p", first=down, second=level, at_right_angle=False)
    for evidence in (behind, near, crossing):
        mark = mark_of(state_of(tilt=80.0) if evidence is crossing else state, evidence)
        assert np.all(np.isnan(mark.expected_px))
        assert np.all(np.isnan(mark.off_px))
