"""Planes against closed forms, and derivatives against differences."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from aerodft.geometry import ElevationGrid, GroundHits, Plane, Terrain, jacobians, meet_level
from aerodft.model import CODE_OF, CODES, Status

OK = CODE_OF[Status.OK]
NANOMETRE = 1e-9


def _ray(depression_deg, azimuth_deg=0.0):
    down, azimuth = math.radians(depression_deg), math.radians(azimuth_deg)
    return np.array([math.cos(down) * math.sin(azimuth), math.cos(down) * math.cos(azimuth), -math.sin(down)])


def test_a_level_plane_is_met_where_the_tangent_says():
    depressions = np.array([90.0, 60.0, 30.0, 3.0])
    rays = np.array([_ray(each, 90.0) for each in depressions])
    hits = meet_level(np.array([10.0, 20.0, 50.0]), rays, 2.0)
    reach = 48.0 / np.tan(np.radians(depressions))
    assert_allclose(hits.points_enu_m, np.stack([10 + reach, np.full(4, 20.0), np.full(4, 2.0)], -1), atol=NANOMETRE)
    assert_allclose(hits.range_m, 48.0 / np.sin(np.radians(depressions)), atol=NANOMETRE)
    assert_array_equal(hits.points_enu_m[:, 2], 2.0)
    assert_array_equal(hits.normal_enu, np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert_array_equal(hits.status, OK)


def test_a_slope_that_rises_ahead_is_met_earlier_and_one_that_falls_later():
    """Depression a, slope b, height h above the foot: h / (tan a + tan b) ahead."""
    for slope_deg, azimuth_deg in ((11.3099, 0.0), (11.3099, 180.0), (11.3099, 90.0), (0.0, 45.0)):
        plane = Plane.sloping([3.0, 4.0, 7.0], math.radians(slope_deg), math.radians(azimuth_deg))
        hits = plane.meet(np.array([3.0, 4.0, 107.0]), _ray(20.0), 0.0)
        rise = math.tan(math.radians(slope_deg)) * math.cos(math.radians(azimuth_deg))
        ahead = 100.0 / (math.tan(math.radians(20.0)) + rise)
        assert_allclose(hits.points_enu_m, [3.0, 4.0 + ahead, 7.0 + ahead * rise], atol=1e-9)
        assert_allclose(hits.range_m, ahead / math.cos(math.radians(20.0)), atol=1e-9)


def test_a_level_slope_is_the_level_plane():
    rays = np.random.default_rng(1).normal(size=(50, 3))
    camera = np.array([1.0, 2.0, 30.0])
    slope, level = Plane.sloping([0, 0, 4.0], 0.0, 1.0).meet(camera, rays, 0.0), meet_level(camera, rays, 4.0)
    assert_array_equal(slope.status, level.status)
    assert_allclose(slope.points_enu_m, level.points_enu_m, rtol=1e-12, atol=1e-9)


def test_a_raised_plane_is_higher_along_the_vertical():
    plane = Plane.sloping([0.0, 0.0, 0.0], 0.5, 1.0)
    low, high = (plane.meet(np.array([0.0, 0.0, 50.0]), _ray(90.0), each) for each in (0.0, 3.0))
    assert_allclose(high.points_enu_m - low.points_enu_m, [0.0, 0.0, 3.0], atol=NANOMETRE)


@pytest.mark.parametrize(
    ("camera_up_m", "ray", "status"),
    [
        (50.0, _ray(10.0), Status.OK),
        (50.0, _ray(0.0), Status.ABOVE_HORIZON),
        (50.0, _ray(-10.0), Status.ABOVE_HORIZON),
        (50.0, np.array([0.0, 1.0, -1e-320]), Status.ABOVE_HORIZON),
        (5.0, _ray(10.0), Status.BELOW_SURFACE),
        (2.0, _ray(-10.0), Status.BELOW_SURFACE),
        (50.0, np.full(3, np.nan), Status.BEYOND_LENS_MODEL),
        (50.0, np.zeros(3), Status.BEYOND_LENS_MODEL),
    ],
)
def test_misses_have_a_status_and_no_number(camera_up_m, ray, status):
    camera = np.array([0.0, 0.0, camera_up_m])
    for hits in (meet_level(camera, ray, 5.0), Plane(np.array([0.0, 0.0, 1.0]), 5.0).meet(camera, ray, 0.0)):
        assert CODES[int(hits.status)] is status
        for values in (hits.points_enu_m, hits.range_m, hits.normal_enu):
            assert_array_equal(np.isfinite(values), status is Status.OK)


def test_a_slope_has_a_horizon_of_its_own():
    plane = Plane.sloping([0.0, 0.0, 0.0], math.radians(20.0), 0.0)
    up = plane.meet(np.array([0.0, 0.0, 50.0]), np.array([_ray(-19.0), _ray(-21.0)]), 0.0)
    assert [CODES[code] for code in up.status] == [Status.OK, Status.ABOVE_HORIZON]
    down = plane.meet(np.array([0.0, 0.0, 50.0]), np.array([_ray(21.0, 180.0), _ray(19.0, 180.0)]), 0.0)
    assert [CODES[code] for code in down.status] == [Status.OK, Status.ABOVE_HORIZON]


@pytest.mark.parametrize("shape", [(), (1,), (5, 3)])
def test_all_inputs_broadcast(shape):
    rng = np.random.default_rng(2)
    camera, rays = rng.uniform(20, 30, (*shape, 3)), np.append(rng.normal(size=(*shape, 2)), -np.ones((*shape, 1)), -1)
    elevation = rng.uniform(0, 5, shape)
    each_own = meet_level(camera, rays, elevation)
    assert each_own.points_enu_m.shape == (*shape, 3)
    assert each_own.range_m.shape == each_own.status.shape == shape
    for index in np.ndindex(shape):
        single = meet_level(camera[index], rays[index], elevation[index])
        assert_allclose(each_own.points_enu_m[index], single.points_enu_m, rtol=1e-14)
    assert meet_level(np.array([0, 0, 9.0]), rays, 1.0).points_enu_m.shape == (*shape, 3)
    assert meet_level(camera, np.array([0, 0, -1.0]), 1.0).points_enu_m.shape == (*shape, 3)
    plane = Plane.sloping([0, 0, 1.0], 0.1, 0.2)
    assert plane.meet(camera, np.array([0, 0, -1.0]), 0.0).points_enu_m.shape == (*shape, 3)


@pytest.mark.parametrize(
    ("normal", "offset"),
    [([0, 0, 2.0], 0.0), ([1.0, 0, 0], 0.0), ([0, 0, -1.0], 0.0), ([0, 0, 1.0], math.inf), ([0, 0, math.nan], 0.0)],
)
def test_a_plane_has_a_unit_normal_that_points_up(normal, offset):
    with pytest.raises(ValueError, match="expected a unit normal that points up"):
        Plane(np.array(normal), offset)


def test_a_wall_is_no_ground():
    with pytest.raises(ValueError, match="points up"):
        Plane.sloping([0, 0, 0], math.radians(91.0), 0.0)


def test_what_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="camera position of nan"):
        meet_level(np.array([0.0, np.nan, 1.0]), _ray(10.0), 0.0)
    with pytest.raises(ValueError, match="elevation of inf"):
        meet_level(np.array([0.0, 0.0, 1.0]), _ray(10.0), np.inf)


DIRECTIONS = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-2, -0.2)).map(np.array)
CAMERAS = st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(30, 80)).map(np.array)
PLANE = Plane.sloping([5.0, -3.0, 2.0], 0.15, 2.0)
EAST, NORTH = np.meshgrid(np.arange(-900.0, 901.0, 30.0), np.arange(-900.0, 901.0, 30.0))
GRID = ElevationGrid(
    east_m=-900.0, north_m=-900.0, cell_m=30.0, heights_m=4 * np.sin(EAST / 90.0) + 3 * np.cos(NORTH / 70.0)
)
SMALL_EARTH_M = 60_000.0  # a hundredth of the real one, so that its derivatives stand out


def _level(camera, direction, by_m):
    return meet_level(camera, direction, 2.0 + by_m)


def _sloping(camera, direction, by_m):
    return PLANE.meet(camera, direction, by_m)


def _terrain(camera, direction, by_m):
    return Terrain(GRID, 0.0, SMALL_EARTH_M).meet(camera, direction, by_m)


@pytest.mark.parametrize("meet", [_level, _sloping, _terrain])
@settings(max_examples=40, deadline=None)
@given(camera=CAMERAS, direction=DIRECTIONS)
def test_jacobians_are_the_differences(meet, camera, direction):
    hits: GroundHits = meet(camera, direction, 0.0)
    assert hits.status == OK
    jac = jacobians(camera, direction, hits)
    step = 1e-5
    moves = [
        *((jac.jac_direction[:, axis], np.zeros(3), np.eye(3)[axis], 0.0) for axis in range(3)),
        *((jac.jac_position[:, axis], np.eye(3)[axis], np.zeros(3), 0.0) for axis in range(3)),
        (jac.jac_elevation, np.zeros(3), np.zeros(3), 1.0),
    ]
    for got, shift, turn, rise in moves:
        before, after = (
            meet(camera + sign * step * shift, direction + sign * step * turn, sign * step * rise) for sign in (-1, 1)
        )
        if meet is _terrain and not _same_patch(before, after):
            continue  # the slope of the ground is another beyond the border
        numeric = (after.points_enu_m - before.points_enu_m) / (2 * step)
        assert_allclose(got, numeric, rtol=2e-5, atol=2e-5 * (1 + float(hits.range_m)))


def _same_patch(before, after):
    cells = [np.floor((each.points_enu_m[:2] + 900.0) / 30.0) for each in (before, after)]
    return np.array_equal(*cells)


def test_a_miss_has_no_derivative():
    camera, rays = np.array([0.0, 0.0, 50.0]), np.array([_ray(10.0), _ray(-10.0)])
    jac = jacobians(camera, rays, meet_level(camera, rays, 0.0))
    for values in (jac.jac_direction, jac.jac_position, jac.jac_elevation):
        assert np.all(np.isfinite(values[0]))
        assert np.all(np.isnan(values[1]))
