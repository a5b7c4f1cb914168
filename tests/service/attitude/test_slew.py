"""How far a camera may be from a demand, against cameras that follow it late and slowly, one step at a time."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from aerodft.geometry import slerp
from aerodft.service.attitude.slew import demands_before, lag_std
from aerodft.service.streams import brackets

MS, SECOND = 1_000_000, 1_000_000_000
LAG_NS, SLEW = 300 * MS, math.radians(60)
STAMPS = np.arange(0, 6 * SECOND, 100 * MS)


def pitches(values_rad):
    return Rotation.from_euler("Y", np.asarray(values_rad)[:, None]).as_quat(scalar_first=True)


def std_at(demands_rad, stamp_ns, lag_ns=LAG_NS, slew_radps=SLEW):
    return lag_at(pitches(demands_rad), stamp_ns, lag_ns, slew_radps)


def lag_at(reported_wxyz, stamp_ns, lag_ns=LAG_NS, slew_radps=SLEW):
    stamps_ns = np.full(3, stamp_ns)
    found = brackets(STAMPS, stamps_ns, SECOND)
    first = np.zeros(3, dtype=np.int64)
    demands = demands_before(STAMPS, found.before, stamps_ns, first, lag_ns=lag_ns, slew_radps=slew_radps)
    now = slerp(*found.ends(reported_wxyz), found.weight)
    together = lag_std(demands, reported_wxyz, now, slew_radps)
    assert np.array_equal(together[1:], together[:-1])
    return together[0]


def followed(demands_rad, lag_s, rate_radps):
    """A camera that turns at a limited rate to where the demand was a lag ago, at the stamps."""
    fine = np.arange(0, 6 * SECOND, MS)
    held = np.asarray(demands_rad)[np.clip((fine - round(lag_s * SECOND)) // (100 * MS), 0, len(STAMPS) - 1)]
    camera, most = np.empty(len(fine)), rate_radps / 1000
    camera[0] = held[0]
    for k in range(1, len(fine)):
        camera[k] = camera[k - 1] + min(max(held[k] - camera[k - 1], -most), most)
    return camera[::100]


def test_a_steady_demand_adds_nothing():
    assert_allclose(std_at(np.full(len(STAMPS), -0.7), 3 * SECOND + 33 * MS), 0.0, atol=1e-12)


def test_a_step_counts_until_the_slowest_camera_is_there():
    demands = np.where(STAMPS < 2 * SECOND, 0.0, -math.pi / 3)  # 60 degrees: a second at 60 deg/s
    ages_s = np.array([0.0, 0.2, 0.3, 0.8, 1.2, 1.4])
    stds = np.array([std_at(demands, 2 * SECOND + round(age * SECOND)) for age in ages_s])
    left = np.clip(1.0 - (ages_s - 0.3), 0.0, 1.0) * math.pi / 3
    assert_allclose(np.abs(stds[:, 1]), left / math.sqrt(3), atol=1e-9)
    assert_allclose(stds[:, [0, 2]], 0.0, atol=1e-12)


@given(
    st.lists(st.floats(-1.5, 0.0), min_size=3, max_size=3),
    st.floats(0.05, 0.3),
    st.floats(math.radians(60), math.radians(400)),
)
def test_no_camera_within_the_stated_limits_is_farther_off_than_the_way_that_is_left(steps_rad, lag_s, rate_radps):
    demands = np.repeat(steps_rad, len(STAMPS) // 3)
    camera = followed(demands, lag_s, rate_radps)
    for k in range(5, len(STAMPS), 5):
        most = math.sqrt(3) * np.linalg.norm(std_at(demands, int(STAMPS[k])))
        assert abs(camera[k] - demands[k]) <= most + 0.02


def test_the_answer_is_about_the_axis_that_turns():
    yaws = np.where(STAMPS < 2 * SECOND, 0.0, 0.5)
    reported = Rotation.from_euler("ZY", np.column_stack([yaws, np.full(len(STAMPS), -math.pi / 2)]))
    stamp_ns = 2 * SECOND + 100 * MS
    std = lag_at(reported.as_quat(scalar_first=True), stamp_ns)
    assert abs(std[0]) == pytest.approx(0.5 / math.sqrt(3), abs=1e-9)  # at nadir a pan is a roll of the image
    assert_allclose(std[1:], 0.0, atol=1e-9)
