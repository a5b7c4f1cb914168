"""Elevation models against closed forms and against a marcher that takes small steps."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import RegularGridInterpolator

from aerodft.geometry import EARTH_RADIUS_M, STANDARD_REFRACTION, ElevationGrid, Plane, Terrain
from aerodft.geometry.terrain import elevation_at
from aerodft.model import CODES, Status

FLAT_EARTH_M = math.inf
CENTIMETRE = 0.01
MILLIMETRE = 0.001


def meet_terrain(camera, directions, grid, *, elevation_m=0.0, refraction=0.0, earth_radius_m=EARTH_RADIUS_M):
    """Rays on a grid's ground, without refraction unless it is stated."""
    return Terrain(grid, refraction, earth_radius_m).meet(camera, directions, elevation_m)


def _grid(height_of, *, half_m=400.0, cell_m=1.0, centre=(0.0, 0.0)):
    axis = np.arange(-half_m, half_m + cell_m / 2, cell_m)
    east, north = np.meshgrid(axis + centre[0], axis + centre[1])
    heights = np.broadcast_to(np.asarray(height_of(east, north), dtype=float), east.shape)
    return ElevationGrid(east_m=centre[0] - half_m, north_m=centre[1] - half_m, cell_m=cell_m, heights_m=heights)


def _ray(depression_deg, azimuth_deg=0.0):
    down, azimuth = np.radians(depression_deg), np.radians(azimuth_deg)
    return np.stack([np.cos(down) * np.sin(azimuth), np.cos(down) * np.cos(azimuth), -np.sin(down)], axis=-1)


def _status(hits):
    return [CODES[code] for code in np.atleast_1d(hits.status)]


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, 180.0, 270.0, 37.0])
@pytest.mark.parametrize("cell_m", [1.0, 5.0])
def test_a_ridge_is_hit_on_its_near_face_and_not_behind(azimuth_deg, cell_m):
    """80 m high with a flat top and vertical faces at 150 and 260 m; the camera 100 m up, 10 degrees downwards.

    At 150 m the ray is 73.6 m high, below the top; without the ridge it would reach the ground at 567 m.
    """
    azimuth = math.radians(azimuth_deg)

    def ridge(east, north):
        ahead = east * math.sin(azimuth) + north * math.cos(azimuth)
        return np.where((ahead >= 150.0) & (ahead <= 260.0), 80.0, 0.0)

    grid = _grid(ridge, half_m=700.0, cell_m=cell_m)
    hits = meet_terrain(np.array([0.0, 0.0, 100.0]), _ray(10.0, azimuth_deg), grid)
    away = float(np.hypot(*hits.points_enu_m[:2]))
    assert abs(away - 150.0) <= cell_m
    assert abs(hits.points_enu_m[2] - (100.0 - away * math.tan(math.radians(10.0)))) < CENTIMETRE
    without = _grid(lambda e, _: 0 * e, half_m=700.0, cell_m=cell_m)
    behind = meet_terrain(np.array([0.0, 0.0, 100.0]), _ray(10.0, azimuth_deg), without, earth_radius_m=FLAT_EARTH_M)
    assert_allclose(np.hypot(*behind.points_enu_m[:2]), 567.1, atol=0.05)


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, 225.0])
def test_an_upslope_of_20_percent_is_hit_at_265_7_m(azimuth_deg):
    """The slope begins at the camera's foot, 100 m below it; 10 degrees downwards: 100 / (0.2 + tan 10) = 265.7 m."""
    azimuth = math.radians(azimuth_deg)
    grid = _grid(lambda e, n: 0.2 * (e * math.sin(azimuth) + n * math.cos(azimuth)), cell_m=10.0)
    hits = meet_terrain(np.array([0.0, 0.0, 100.0]), _ray(10.0, azimuth_deg), grid)
    assert_allclose(np.hypot(*hits.points_enu_m[:2]), 265.7, atol=0.05)
    assert_allclose(hits.range_m, 269.8, atol=0.05)
    plane = Plane.sloping([0, 0, 0], math.atan(0.2), azimuth)
    assert_allclose(hits.normal_enu, plane.normal_enu, atol=1e-12)
    flat_earth = meet_terrain(np.array([0, 0, 100.0]), _ray(10.0, azimuth_deg), grid, earth_radius_m=FLAT_EARTH_M)
    exact = plane.meet(np.array([0.0, 0.0, 100.0]), _ray(10.0, azimuth_deg), 0.0)
    assert_allclose(flat_earth.points_enu_m, exact.points_enu_m, atol=1e-9)


def test_a_single_patch_is_hit_where_its_parabola_says():
    """Over the diagonal of the patch ``h = 40 x y`` the ground is ``20 d^2``; a level ray at 10 m meets it at 0.707."""
    grid = ElevationGrid(east_m=0.0, north_m=0.0, cell_m=1.0, heights_m=np.array([[0.0, 0.0], [0.0, 40.0]]))
    hits = meet_terrain(np.array([0.0, 0.0, 10.0]), np.array([1.0, 1.0, 0.0]), grid, earth_radius_m=FLAT_EARTH_M)
    assert_allclose(hits.points_enu_m, [0.5, 0.5, 10.0], atol=1e-12)
    assert_allclose(hits.range_m, math.sqrt(0.5), atol=1e-12)
    assert_allclose(hits.normal_enu, np.array([-20.0, -20.0, 1.0]) / math.sqrt(801.0), atol=1e-12)


def _random_grid(rng):
    rows, columns = rng.integers(2, 60, 2)
    cell_m = rng.uniform(0.5, 20.0)
    rough = rng.normal(size=(rows, columns)).cumsum(axis=0).cumsum(axis=1) / math.sqrt(rows * columns)
    heights = (rough + rng.normal(size=(rows, columns))) * cell_m * rng.choice([0.1, 0.5, 2.0])
    return ElevationGrid(east_m=rng.uniform(-1e5, 1e5), north_m=-3.0, cell_m=cell_m, heights_m=heights)


def _height_above_ground(camera, ray, grid, earth_radius_m, ranges_m):
    """Of the points of the ray, by scipy's interpolation; NaN outside the grid."""
    rows, columns = grid.heights_m.shape
    axes = [grid.north_m + np.arange(rows) * grid.cell_m, grid.east_m + np.arange(columns) * grid.cell_m]
    ground = RegularGridInterpolator(axes, grid.heights_m, bounds_error=False, fill_value=np.nan)
    places = camera + np.asarray(ranges_m)[..., None] * ray
    drop = np.sum((places - camera)[..., :2] ** 2, axis=-1) / (2 * earth_radius_m)
    return places[..., 2] + drop - ground(places[..., 1::-1])


@pytest.mark.parametrize("earth_radius_m", [FLAT_EARTH_M, 20_000.0])
def test_random_terrain_agrees_with_small_steps(earth_radius_m):
    """The point is on the ground, and no step before it is; where no step meets the ground, at most a crest is."""
    rng = np.random.default_rng(7)
    seen = {True: 0, False: 0}
    for _ in range(200):
        grid = _random_grid(rng)
        low, high = _corners(grid)
        foot = low + rng.uniform(0.1, 0.9, 2) * (high - low)
        up = float(elevation_at(grid, foot)) + rng.uniform(0.2, 3.0) * grid.cell_m * rng.choice([1.0, 5.0])
        camera, ray = (
            np.array([*foot, up]),
            _ray(rng.choice([rng.uniform(-10, 90), rng.uniform(-5, 15)]), rng.uniform(0, 360)),
        )
        longest_m = 2 * np.hypot(*(high - low)) + up - np.min(grid.heights_m)
        steps_m = np.arange(0.0, longest_m, grid.cell_m / 100)
        above_m = _height_above_ground(camera, ray, grid, earth_radius_m, steps_m)
        ended = np.isnan(above_m) | (above_m <= 0.0)
        met = bool(np.any(ended)) and bool(above_m[np.argmax(ended)] <= 0.0)
        hits = meet_terrain(camera, ray, grid, earth_radius_m=earth_radius_m)
        if met:
            assert hits.range_m <= steps_m[np.argmax(ended)] + 1e-6
        if met or np.isfinite(hits.range_m):
            edge_m = hits.range_m * (1 - 1e-12)  # still inside the grid for scipy
            assert_allclose(_height_above_ground(camera, ray, grid, earth_radius_m, edge_m), 0.0, atol=1e-6)
        else:
            assert _status(hits)[0] in {Status.BEYOND_TERRAIN, Status.ABOVE_HORIZON}
        seen[met] += 1
    assert min(seen.values()) > 30


@settings(max_examples=200, deadline=None)
@given(
    seed=st.integers(0, 2**32), depression_deg=st.floats(-20, 90), azimuth_deg=st.sampled_from([0, 45, 90, 200, 313])
)
def test_what_is_hit_is_on_the_ground_on_the_ray_and_the_first(seed, depression_deg, azimuth_deg):
    rng = np.random.default_rng(seed)
    grid = _random_grid(rng)
    rows, columns = grid.heights_m.shape
    node = np.array([rng.integers(0, columns), rng.integers(0, rows)])  # a camera over a node looks along borders
    foot = node * grid.cell_m + [grid.east_m, grid.north_m]
    camera = np.array([*foot, grid.heights_m[node[1], node[0]] + 2.0 * grid.cell_m])
    ray = _ray(depression_deg, azimuth_deg)
    hits = meet_terrain(camera, ray, grid, earth_radius_m=30_000.0, refraction=0.2)
    if _status(hits) != [Status.OK]:
        assert np.all(np.isnan(hits.points_enu_m))
        return
    along = np.linspace(0.0, 1.0, 200)[:-1, None] * hits.range_m * ray
    bend = 0.8 * np.sum(along[:, :2] ** 2, axis=1) / 60_000.0
    inside = elevation_at(grid, camera[:2] + along[:, :2])
    assert np.nanmin(camera[2] + along[:, 2] + bend - inside) > -1e-9 * grid.cell_m - 1e-9
    end = hits.range_m * ray
    assert_allclose(hits.points_enu_m[:2], camera[:2] + end[:2], atol=1e-9)
    height = camera[2] + end[2] + 0.8 * np.sum(end[:2] ** 2) / 60_000.0
    assert_allclose(hits.points_enu_m[2], height, atol=1e-7)
    back_inside = np.clip(hits.points_enu_m[:2], *_corners(grid))
    assert_allclose(elevation_at(grid, back_inside), height, atol=1e-6)
    assert_allclose(np.linalg.norm(hits.normal_enu), 1.0, atol=1e-12)


def _corners(grid):
    rows, columns = grid.heights_m.shape
    low = np.array([grid.east_m, grid.north_m])
    return low, low + (np.array([columns, rows]) - 1) * grid.cell_m


@pytest.mark.parametrize("refraction", [0.0, STANDARD_REFRACTION])
def test_the_earth_curves_away_below_a_level_sea(refraction):
    """Exactly: ``h - s sin a + c (s cos a)^2 = 0`` for the slant range s."""
    grid = _grid(lambda e, _: 0 * e, half_m=20_000.0, cell_m=100.0)
    down, height, c = math.radians(0.5), 120.0, (1 - refraction) / (2 * EARTH_RADIUS_M)
    a, b = c * math.cos(down) ** 2, math.sin(down)
    expected_m = 2 * height / (b + math.sqrt(b * b - 4 * a * height))
    hits = meet_terrain(np.array([0.0, 0.0, height]), _ray(0.5, 30.0), grid, refraction=refraction)
    assert_allclose(hits.range_m, expected_m, atol=MILLIMETRE)
    flat = meet_terrain(np.array([0.0, 0.0, height]), _ray(0.5, 30.0), grid, earth_radius_m=FLAT_EARTH_M)
    assert_allclose(flat.range_m, height / b, atol=MILLIMETRE)
    assert hits.range_m - flat.range_m > 1000.0


def test_the_sea_ends_at_the_geometric_horizon():
    """Dip of the horizon: ``acos(R / (R + h))``, 0.3226 degrees from 101 m; just above it nothing is hit."""
    grid = _grid(lambda e, _: 0 * e, half_m=60_000.0, cell_m=200.0)
    dip_deg = math.degrees(math.acos(EARTH_RADIUS_M / (EARTH_RADIUS_M + 101.0)))
    hits = meet_terrain(np.array([0.0, 0.0, 101.0]), _ray(dip_deg + np.array([-0.001, 0.001]), 10.0), grid)
    assert _status(hits) == [Status.ABOVE_HORIZON, Status.OK]
    assert_allclose(hits.range_m[1], math.sqrt(2 * EARTH_RADIUS_M * 101.0), rtol=0.1)


def test_each_miss_says_why():
    def hills(east, north):
        return np.where((east > 100) & (east < 110), np.nan, np.where(north > 300, 60.0, 0.0))

    grid = _grid(hills)
    camera = np.array([0.0, 0.0, 50.0])
    scenes = {
        Status.OK: (camera, _ray(30.0, 90.0)),
        Status.ABOVE_HORIZON: (camera, _ray(-45.0, 0.0)),
        Status.NO_ELEVATION: (camera, _ray(20.0, 90.0)),
        Status.BELOW_SURFACE: (np.array([0.0, 0.0, -1.0]), _ray(10.0)),
        Status.BEYOND_LENS_MODEL: (camera, np.full(3, np.nan)),
    }
    for status, (position, ray) in scenes.items():
        hits = meet_terrain(position, ray, grid)
        assert _status(hits) == [status], status
        for values in (hits.points_enu_m, hits.range_m, hits.normal_enu):
            assert_array_equal(np.isfinite(values), status is Status.OK)
    assert _status(meet_terrain(camera, _ray(2.0, 180.0), grid)) == [Status.BEYOND_TERRAIN]
    assert _status(meet_terrain(np.array([900.0, 0.0, 50.0]), _ray(10.0, 270.0), grid)) == [Status.BEYOND_TERRAIN]
    assert _status(meet_terrain(np.array([0.0, 320.0, 50.0]), _ray(90.0), grid)) == [Status.BELOW_SURFACE]
    assert _status(meet_terrain(np.array([105.0, 0.0, 50.0]), _ray(-1.0), grid)) == [Status.NO_ELEVATION]
    assert _status(meet_terrain(np.array([0.0, 0.0, 999.0]), _ray(1.0, 180.0), grid)) == [Status.BEYOND_TERRAIN]
    assert _status(meet_terrain(np.array([0.0, 0.0, 999.0]), _ray(-1.0), grid)) == [Status.ABOVE_HORIZON]


def test_a_hole_below_a_ray_that_is_above_everything_does_not_matter():
    grid = _grid(lambda e, n: np.where((np.hypot(e, n) > 20) & (np.hypot(e, n) < 30), np.nan, 0.0 * e))
    hits = meet_terrain(np.array([0.0, 0.0, 50.0]), _ray(45.0, 90.0), grid, earth_radius_m=FLAT_EARTH_M)
    assert_allclose(hits.points_enu_m, [50.0, 0.0, 0.0], atol=1e-9)


def test_rays_straight_down_and_along_borders():
    grid = _grid(lambda e, n: 0.1 * e + 0 * n, half_m=64.0, cell_m=4.0)
    foot = np.array([[0.0, 0.0], [-64.0, -64.0], [64.0, 64.0], [3.3, -7.7], [64.0, -20.0]])
    hits = meet_terrain(np.column_stack([foot, np.full(5, 30.0)]), np.array([0.0, 0.0, -2.0]), grid)
    assert_allclose(hits.points_enu_m, np.column_stack([foot, 0.1 * foot[:, 0]]), atol=1e-12)
    along = meet_terrain(
        np.array([0.0, 0.0, 10.0]), np.array([[0, 1, -0.25], [0, -1, -0.25], [-1.0, 0, -0.4]]), grid, elevation_m=1.0
    )
    assert_allclose(along.points_enu_m[:, 2] - 1.0, [0.0, 0.0, -3.0], atol=CENTIMETRE)
    assert_allclose(along.points_enu_m[:2, 1], [36.0, -36.0], atol=CENTIMETRE)


def test_a_surface_above_the_ground_is_the_ground_seen_from_lower():
    grid = _grid(lambda e, n: 5 * np.sin(e / 40) + 0.05 * n, cell_m=5.0)
    rays = _ray(np.linspace(20, 80, 40), np.linspace(0, 360, 40))
    above = np.linspace(-3.0, 8.0, 40)
    hits = meet_terrain(np.array([0.0, 0.0, 60.0]), rays, grid, elevation_m=above)
    camera = np.column_stack([np.zeros((40, 2)), 60.0 - above])
    lower = meet_terrain(camera, rays, grid)
    assert_allclose(hits.points_enu_m - lower.points_enu_m, np.column_stack([np.zeros((40, 2)), above]), atol=1e-9)
    assert_allclose(elevation_at(grid, hits.points_enu_m[:, :2]) + above, hits.points_enu_m[:, 2], atol=1e-9)


@pytest.mark.parametrize("shape", [(), (1,), (5, 3)])
def test_shapes(shape):
    grid = _grid(lambda e, n: 0.01 * e * n, half_m=50.0, cell_m=10.0)
    rays = np.broadcast_to(_ray(60.0, 10.0), (*shape, 3))
    hits = meet_terrain(np.array([0.0, 0.0, 30.0]), rays, grid)
    assert hits.points_enu_m.shape == hits.normal_enu.shape == (*shape, 3)
    assert hits.range_m.shape == hits.status.shape == shape
    assert elevation_at(grid, np.zeros((*shape, 2))).shape == shape


def test_heights_between_nodes_are_scipys():
    rng = np.random.default_rng(3)
    grid = ElevationGrid(east_m=10.0, north_m=-20.0, cell_m=2.0, heights_m=rng.normal(size=(7, 5)))
    stock = RegularGridInterpolator((-20.0 + 2.0 * np.arange(7), 10.0 + 2.0 * np.arange(5)), grid.heights_m)
    places = rng.uniform([10.0, -20.0], [18.0, -8.0], (200, 2))
    assert_allclose(elevation_at(grid, places), stock(places[:, ::-1]), atol=1e-12)
    outside = np.array([[9.99, 0.0], [18.01, -10.0], [12.0, -20.01], [12.0, np.nan]])
    assert np.all(np.isnan(elevation_at(grid, outside)))


def test_a_hole_is_as_large_as_its_cells():
    heights = np.zeros((4, 4))
    heights[2, 2] = np.nan
    grid = ElevationGrid(east_m=0.0, north_m=0.0, cell_m=1.0, heights_m=heights)
    places = np.array([[1.0, 2.0], [1.001, 2.0], [2.0, 1.0], [2.5, 2.5], [0.5, 1.5], [3.0, 3.0]])
    assert_array_equal(np.isnan(elevation_at(grid, places)), [False, True, False, True, False, False])


@pytest.mark.parametrize(
    "wrong",
    [
        {"heights_m": np.zeros((1, 5))},
        {"heights_m": np.zeros(5)},
        {"heights_m": np.full((3, 3), np.nan)},
        {"heights_m": np.array([[0.0, np.inf], [0.0, 0.0]])},
        {"cell_m": 0.0},
        {"cell_m": math.nan},
        {"east_m": math.inf},
    ],
)
def test_what_is_no_grid_is_refused(wrong):
    good = {"east_m": 0.0, "north_m": 0.0, "cell_m": 1.0, "heights_m": np.zeros((3, 3))}
    with pytest.raises(ValueError, match=r"got .*, expected"):
        ElevationGrid(**good | wrong)


@pytest.mark.parametrize(
    "wrong",
    [{"earth_radius_m": -1.0}, {"refraction": 1.0}, {"refraction": math.nan}],
)
def test_impossible_earths_are_refused(wrong):
    grid = _grid(lambda e, _: 0 * e, half_m=10.0)
    with pytest.raises(ValueError, match="expected a positive radius"):
        meet_terrain(np.array([0.0, 0.0, 10.0]), _ray(45.0), grid, **wrong)
