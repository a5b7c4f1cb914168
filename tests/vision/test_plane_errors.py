"""What a plane's homography is off by, held against drawn errors and differences."""

import math
from dataclasses import replace

import numpy as np
import pytest

from aerodft.geometry import camera_pose, from_rotation_vector, matrix
from aerodft.vision.common import (
    FREE,
    PlanePose,
    apply_change,
    apply_homography,
    by_elements,
    change_between,
    compose_cov,
    place_cov_px2,
    predicted_cov,
)
from aerodft.vision.plane_lock import MatchedPoints, groups_of

UNIT = np.array([[520.0, 0, 319.5], [0, 530.0, 179.5], [0, 0, 1]])
LENS = np.array([[700.0, 0, 319.5], [0, 714.0, 179.5], [0, 0, 1]])  # zoomed
POINTS = np.array([[40.0, 60.0], [320.0, 180.0], [600.0, 330.0]])


def standpoint(height_m: float, tilt_deg: float, heading_deg: float, east_m: float) -> PlanePose:
    pose = camera_pose(height_agl_m=height_m, tilt_rad=math.radians(tilt_deg), heading_rad=math.radians(heading_deg))
    return PlanePose(LENS, matrix(pose.wxyz), pose.position_enu_m + [east_m, 0.0, 0.0])


THEN, NOW = standpoint(40.0, 20.0, 0.0, 0.0), standpoint(44.0, 35.0, 15.0, 8.0)


def test_a_homography_by_telemetry_carries_what_lies_on_the_plane():
    ground = np.array([[3.0, 12.0], [-4.0, 9.0]])
    seen = [apply_homography(each.from_plane(), ground) for each in (THEN, NOW)]
    np.testing.assert_allclose(apply_homography(THEN.onto(NOW), seen[0]), seen[1], atol=1e-8)


def test_places_move_by_elements_as_their_derivatives_say():
    onto, at = THEN.onto(NOW), apply_homography(THEN.onto(NOW), POINTS)
    step = 1e-6
    for k, unit in enumerate(np.eye(FREE)):
        ahead, back = (apply_homography(apply_change(onto, sign * step * unit, UNIT), POINTS) for sign in (1, -1))
        np.testing.assert_allclose((ahead - back) / (2 * step), by_elements(UNIT, at)[..., k], rtol=1e-5, atol=1e-5)


def test_a_change_is_found_again_and_goes_along_under_another_homography():
    draws = np.random.default_rng(1)
    onto, later = THEN.onto(NOW), NOW.onto(standpoint(50.0, 10.0, 40.0, 15.0))
    small = draws.normal(0, 1e-4, (4000, FREE))
    np.testing.assert_allclose(
        change_between(onto, apply_change(onto, small[0], UNIT), UNIT), small[0], rtol=1e-6, atol=1e-9
    )
    moved = [change_between(later @ onto, later @ apply_change(onto, each, UNIT), UNIT) for each in small]
    want = compose_cov(np.eye(FREE) * 1e-8, later, UNIT)
    np.testing.assert_allclose(np.cov(np.array(moved).T), want, rtol=0.2, atol=0.1 * np.max(want))
    np.testing.assert_allclose(np.var(moved, axis=0), np.diag(want), rtol=0.1)


def test_what_telemetry_may_be_off_by_is_the_spread_of_drawn_poses():
    draws = np.random.default_rng(2)
    exact, places = THEN.onto(NOW), []
    for _ in range(4000):
        turn, move, tilt = draws.normal(0, 0.026, 3), draws.normal(0, 0.05, 3), draws.normal(0, 0.026, 2)
        zoom = 1 + draws.normal(0, 0.01)
        off = replace(
            NOW,
            lens=NOW.lens * [[zoom, 1, 1], [1, zoom, 1], [1, 1, 1]],
            rotation=NOW.rotation @ matrix(from_rotation_vector(turn)),
            place_m=NOW.place_m + NOW.rotation @ move * NOW.place_m[2],
        )
        lean = matrix(from_rotation_vector(np.array([tilt[0], tilt[1], 0.0])))
        then = replace(THEN, rotation=lean @ THEN.rotation)
        # A plane that leans: both cameras turn about the foot of the first.
        foot = THEN.place_m * [1, 1, 0]
        off = replace(off, rotation=lean @ off.rotation, place_m=lean @ (off.place_m - THEN.place_m) + THEN.place_m)
        assert foot[2] == 0
        places.append(apply_homography(then.onto(off), POINTS))
    spread = np.cov(np.array(places).reshape(len(places), -1).T)
    want = place_cov_px2(predicted_cov(THEN, NOW, UNIT), UNIT, apply_homography(exact, POINTS))
    for k in range(len(POINTS)):
        np.testing.assert_allclose(
            spread[2 * k : 2 * k + 2, 2 * k : 2 * k + 2], want[k], rtol=0.15, atol=0.04 * np.max(want[k])
        )


@pytest.mark.parametrize("told", [True, False])
def test_points_along_one_bank_tell_the_other_one_with_telemetry(told: bool):  # noqa: FBT001 - a parameter of a test
    """Drawn trackers' errors: the covariance is at least their spread, and no more than it must be for alike points."""
    draws = np.random.default_rng(3)
    strip = np.column_stack([draws.uniform(20, 620, 60), draws.uniform(10, 50, 60)])
    exact = THEN.onto(NOW)
    off, stated = [], []
    for _ in range(200):
        now = apply_homography(exact, strip) + draws.normal(0, 0.15, strip.shape)
        seen = MatchedPoints(strip, now, UNIT, exact, predicted_cov(THEN, NOW, UNIT) if told else None)
        (group, *_) = groups_of(seen, now - apply_homography(exact, strip), 12, 8)
        off.append(apply_homography(group.homography, POINTS[2]) - apply_homography(exact, POINTS[2]))
        stated.append(place_cov_px2(group.cov, UNIT, apply_homography(exact, POINTS[2])))
    spread, want = np.cov(np.array(off).T), np.mean(stated, axis=0)
    stds = np.sqrt(np.linalg.eigvalsh(spread)[-1]), np.sqrt(np.linalg.eigvalsh(want)[-1])
    assert 1.0 < stds[1] / stds[0] < 3.0, stds
    assert bool(stds[0] < 1.0) is told, "far from the points a homography of eight elements is known badly"
