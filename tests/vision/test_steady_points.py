"""Steady points found again: after bumps, in noise and other light, behind passers-by; and not found where none are."""

import cv2
import numpy as np
import pytest

from aerodft.geometry import find_rotation
from aerodft.vision.camera_motion import SteadyPoints
from tests.nights import at_night

from .steady_pictures import CAMERA, after_turn, as_taken, error_rad, image_of, pairs_of, scene, with_passers_by

AXES = {"tilt and pan": (0.6, 0.8, 0.0), "roll": (0.0, 0.0, 1.0), "all": (0.36, 0.48, 0.8)}
HUNDREDTH_PX_RAD = 0.01 / CAMERA.fx_px


@pytest.fixture(scope="module")
def picture():
    return scene()


def look(points, picture, index=0):
    (seen,) = points.observe(image_of(picture, index))
    assert seen.name == "steady"
    assert seen.image == index
    return pairs_of(seen)


def found_turn(points, picture, index=0):
    then, now = look(points, picture, index)
    return find_rotation(CAMERA, then, now)


BUMPS = [(angle_deg, axis) for angle_deg in (0.05, 2.0, 8.0, 20.0) for axis in AXES]
BY_DAY = [(0.05, "all"), (2.0, "tilt and pan"), (20.0, "roll")]


@pytest.mark.parametrize(("angle_deg", "axis"), [*BY_DAY, *at_night(*(each for each in BUMPS if each not in BY_DAY))])
def test_a_bump_is_measured_to_hundredths_of_a_pixel(picture, angle_deg, axis):
    rng = np.random.default_rng(round(100 * angle_deg))
    rotvec = np.radians(angle_deg) * np.array(AXES[axis])
    points = SteadyPoints(CAMERA, reference=picture)
    turn = found_turn(points, as_taken(after_turn(picture, rotvec), rng, gain=0.75, offset=12.0))
    assert turn is not None
    assert np.count_nonzero(turn.inliers) >= 40
    allowed = 5 * np.sqrt(np.diag(turn.cov)) + 4 * HUNDREDTH_PX_RAD
    assert np.all(np.abs(error_rad(turn.wxyz, rotvec)) <= allowed)


@pytest.mark.parametrize("looks", [6, *at_night(24)])
def test_errors_of_many_looks_are_as_large_as_stated(picture, looks):
    rng, points, z = np.random.default_rng(5), SteadyPoints(CAMERA, reference=picture), []
    for index in range(looks):
        rotvec = rng.normal(scale=np.radians(0.1), size=3)
        turn = found_turn(points, as_taken(after_turn(picture, rotvec), rng, noise=5.0), index)
        assert turn is not None
        cov = turn.cov + (3 * HUNDREDTH_PX_RAD) ** 2 * np.eye(3)
        z.append(np.linalg.solve(np.linalg.cholesky(cov), error_rad(turn.wxyz, rotvec)))
    assert np.all(np.std(z) < 1.3)
    assert np.all(np.abs(z) < 5)


def test_passers_by_over_two_fifths_of_the_image_take_nothing_away(picture):
    rng, points = np.random.default_rng(7), SteadyPoints(CAMERA, reference=picture)
    for index in range(5):
        rotvec = rng.normal(scale=np.radians(0.05), size=3)
        select = with_passers_by(as_taken(after_turn(picture, rotvec), rng), rng)
        turn = found_turn(points, select, index)
        assert turn is not None
        assert np.count_nonzero(turn.inliers) >= 0.5 * len(turn.inliers)
        assert np.all(np.abs(error_rad(turn.wxyz, rotvec)) < 8 * HUNDREDTH_PX_RAD)


def test_a_bump_behind_a_truck_is_measured(picture):
    rng, rotvec = np.random.default_rng(8), np.radians([1.5, -2.0, 1.0])
    select = as_taken(after_turn(picture, rotvec), rng)
    select[:, 240:] = np.array([40, 60, 170], dtype=np.uint8) + rng.integers(0, 8, (540, 720, 3), dtype=np.uint8)
    turn = found_turn(SteadyPoints(CAMERA, reference=picture), select)
    assert turn is not None
    assert np.all(np.abs(error_rad(turn.wxyz, rotvec)) < 5 * np.sqrt(np.diag(turn.cov)) + 4 * HUNDREDTH_PX_RAD)


def dark(rng):
    return rng.integers(0, 6, (540, 960, 3), dtype=np.uint8)


def covered(_):
    return np.full((540, 960, 3), 127, dtype=np.uint8)


def noisy(rng):
    return rng.integers(0, 120, (540, 960, 3), dtype=np.uint8)


def foggy(rng):
    return as_taken(scene(), rng, gain=0.01, offset=180.0, noise=2.0)


@pytest.mark.parametrize("blind", [dark, foggy, *at_night(covered, noisy)])
def test_nothing_is_found_where_nothing_is_seen_and_all_of_it_afterwards(picture, blind):
    rng, points = np.random.default_rng(9), SteadyPoints(CAMERA, reference=picture)
    before = found_turn(points, as_taken(picture, rng), 0)
    assert found_turn(points, blind(rng), 1) is None
    rotvec = np.radians([0.0, 4.0, -3.0])
    after = found_turn(points, as_taken(after_turn(picture, rotvec), rng), 2)
    assert before is not None
    assert after is not None
    assert np.all(np.abs(error_rad(after.wxyz, rotvec)) < 5 * HUNDREDTH_PX_RAD)


def test_nothing_is_looked_for_in_what_is_to_be_ignored(picture):
    river = ((0.0, 60.0), (959.0, 20.0), (959.0, 100.0), (0.0, 160.0))
    points = SteadyPoints(CAMERA, (river,), picture)
    then, _ = look(points, picture)
    inside = [cv2.pointPolygonTest(np.float32(river), (float(u), float(v)), measureDist=False) > 0 for u, v in then]
    everywhere, _ = look(SteadyPoints(CAMERA, reference=picture), picture)
    assert not any(inside)
    assert len(everywhere) > len(then) > 40


def test_points_are_spread_over_the_image(picture):
    then, _ = look(SteadyPoints(CAMERA, reference=picture), picture)
    quarters = (then[:, 0] > 480).astype(int) + 2 * (then[:, 1] > 270).astype(int)
    assert np.min(np.bincount(quarters, minlength=4)) >= 15


def test_the_first_image_that_the_next_one_confirms_is_the_reference(picture):
    rng, points = np.random.default_rng(10), SteadyPoints(CAMERA)
    broken = picture.copy()
    broken[150:] = 128  # as a stream that is joined in the middle
    assert len(look(points, broken, 0)[0]) == 0
    assert len(look(points, dark(rng), 1)[0]) == 0
    assert points.corners is None
    assert len(look(points, as_taken(picture, rng), 2)[0]) == 0
    assert len(look(points, as_taken(picture, rng), 3)[0]) > 40


def test_points_that_move_by_themselves_are_dropped(picture):
    rng, points = np.random.default_rng(11), SteadyPoints(CAMERA, reference=picture)
    branch = (slice(300, 480), slice(500, 800))
    shaken = []
    for index in range(12):
        select = as_taken(picture, rng)
        select[branch] = np.roll(select[branch], (0, (-3, 3)[index % 2]), axis=(0, 1))
        then, _ = look(points, select, index)
        inside = (then[:, 0] > 515) & (then[:, 0] < 785) & (then[:, 1] > 315) & (then[:, 1] < 465)
        shaken.append(int(np.count_nonzero(inside)))
    assert shaken[0] >= 8
    assert shaken[-1] <= 1


def test_an_image_without_pixels_is_not_looked_at(picture):
    image = image_of(picture)
    bare = type(image)(index=0, stamp_ns=image.stamp_ns, arrival_ns=image.arrival_ns)
    assert SteadyPoints(CAMERA, reference=picture).observe(bare) == ()
