"""Heights by closed form: lines between samples, slant ranges on a tilted body, and the order of sources."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.geometry import from_yaw_pitch_roll
from aerodft.model import HeightSource, HeightTrack, PositionTrack
from aerodft.service.streams import END_OF_TIME, Missing

from .heights import Height, Heights

MS, SECOND = 1_000_000, 1_000_000_000
LEVEL = from_yaw_pitch_roll(0.0, 0.0, 0.0)
NAN = float("nan")


def stamps(*ms):
    array = np.array(ms, dtype=np.int64) * MS
    return {"arrival_ns": array, "boot_ns": array}


def measured(source, ms, values_m, *, std_m=NAN, slant=None):
    slant = source == HeightSource.RANGEFINDER if slant is None else slant
    values = np.array(values_m, dtype=np.float64)
    return HeightTrack(**stamps(*ms), source=source, value_m=values, slant=slant, std_m=np.full_like(values, std_m))


def home(ms, values_m):
    values = np.array(values_m, dtype=np.float64)
    zero = np.zeros_like(values)
    return PositionTrack(**stamps(*ms), lat_rad=zero, lon_rad=zero, alt_msl_m=zero + 600.0, height_home_m=values)


RANGEFINDER = measured(HeightSource.RANGEFINDER, (0, 100), (40.0, 42.0))
TERRAIN = measured(HeightSource.TERRAIN, (0, 1000), (38.0, 39.0))
HOME = home((0, 200), (50.0, 51.0))


@given(st.floats(0.0, 1.0))
def test_between_two_samples_the_height_is_on_their_line(weight):
    stamp_ns = round(weight * 100 * MS)
    found = Heights(RANGEFINDER).at(stamp_ns, 200 * MS, LEVEL)
    assert found.height_agl_m == pytest.approx(40.0 + 2.0 * stamp_ns / (100 * MS), abs=1e-9)


@given(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(-3.1, 3.1))
def test_a_slant_range_is_multiplied_by_cos_roll_cos_pitch(roll, pitch, yaw):
    found = Heights(RANGEFINDER).at(0, 200 * MS, from_yaw_pitch_roll(yaw, pitch, roll))
    assert found.height_agl_m == pytest.approx(40.0 * math.cos(roll) * math.cos(pitch), abs=1e-9)


def test_a_vertical_height_is_taken_as_it_is():
    tilted = from_yaw_pitch_roll(0.0, 0.4, 0.3)
    assert Heights(TERRAIN).at(0, 1000 * MS, tilted).height_agl_m == 38.0


def test_the_first_source_in_order_wins_and_says_what_it_is_above():
    every = Heights(RANGEFINDER, TERRAIN, HOME)
    found = every.at(50 * MS, 200 * MS, LEVEL)
    assert (found.source, found.datum) == (HeightSource.RANGEFINDER, "surface")
    found = Heights(RANGEFINDER, TERRAIN, HOME, order=(HeightSource.TERRAIN, HeightSource.HOME)).at(0, 0, LEVEL)
    assert (found.source, found.datum) == (HeightSource.TERRAIN, "terrain")
    found = Heights(RANGEFINDER, TERRAIN, HOME, order=(HeightSource.HOME,)).at(0, 0, LEVEL)
    assert (found.source, found.datum) == (HeightSource.HOME, "home")


def test_when_a_source_dies_the_next_one_takes_over_once_that_is_certain():
    heights = Heights(
        RANGEFINDER,
        home(range(0, 5000, 200), [50.0] * 25),
        order=(HeightSource.RANGEFINDER, HeightSource.HOME),
        max_gap_ns=2 * SECOND,
    )
    stamp_ns = 1000 * MS
    assert heights.at(stamp_ns, 1000 * MS, LEVEL) is Missing.PENDING
    found = heights.at(stamp_ns, 1101 * MS, LEVEL)
    assert (found.source, found.height_agl_m) == (HeightSource.HOME, 50.0)


def test_all_sources_dead_is_stale_and_none_ever_is_never():
    assert Heights(RANGEFINDER).at(9 * SECOND, END_OF_TIME, LEVEL) is Missing.STALE
    assert Heights().at(9 * SECOND, END_OF_TIME, LEVEL) is Missing.NEVER
    assert Heights(HOME, order=(HeightSource.TERRAIN,)).at(0, END_OF_TIME, LEVEL) is Missing.NEVER


def test_never_across_a_gap():
    heights = Heights(measured(HeightSource.TERRAIN, (0, 5001), (38.0, 39.0)))
    assert heights.at(1000 * MS, 5001 * MS, LEVEL) is Missing.STALE


def test_home_lies_above_the_plane_by_what_the_configuration_says():
    found = Heights(HOME, home_above_plane_m=3.5).at(100 * MS, 200 * MS, LEVEL)
    assert found.height_agl_m == pytest.approx(50.5 + 3.5)


def test_a_height_by_hand_needs_no_telemetry():
    heights = Heights(order=(HeightSource.RANGEFINDER, HeightSource.MANUAL), manual_m=12.0)
    assert heights.at(0, END_OF_TIME, Missing.NEVER) == Height(12.0, 0.5, HeightSource.MANUAL, "manual", 0.0)


def test_by_hand_without_a_height_is_no_source():
    assert Heights(order=(HeightSource.MANUAL,)).at(0, END_OF_TIME, LEVEL) is Missing.NEVER


def test_a_slant_range_without_the_vehicles_attitude_has_no_height():
    assert Heights(RANGEFINDER).at(50 * MS, 100 * MS, Missing.PENDING) is Missing.PENDING
    fallen = Heights(RANGEFINDER, HOME).at(50 * MS, 200 * MS, Missing.STALE)
    assert fallen.source == HeightSource.HOME


@pytest.mark.parametrize(("reported_m", "expected_m"), [(NAN, 0.2), (0.05, 0.05), (0.7, 0.7)])
def test_a_sensor_that_states_its_std_is_believed(reported_m, expected_m):
    track = measured(HeightSource.RANGEFINDER, (0, 100), (40.0, 40.5), std_m=reported_m)
    assert Heights(track).at(50 * MS, 100 * MS, LEVEL).std_m == pytest.approx(expected_m)


def test_age_is_the_distance_to_the_nearest_sample():
    assert Heights(RANGEFINDER).at(30 * MS, 100 * MS, LEVEL).age_s == pytest.approx(0.03)
