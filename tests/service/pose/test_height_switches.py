"""Sources of the height against each other and against the truth: closed forms, Monte-Carlo, and what is far off."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.geometry import from_yaw_pitch_roll, matrix
from aerodft.model import GpsTrack, HeightSource, HeightTrack, PositionTrack
from aerodft.service.streams import END_OF_TIME, Missing

from .heights import Heights

MS, SECOND = 1_000_000, 1_000_000_000
RANGEFINDER, TERRAIN, HOME = HeightSource.RANGEFINDER, HeightSource.TERRAIN, HeightSource.HOME
EARTH_M = 6_371_008.8
STD = {RANGEFINDER: 0.3, TERRAIN: 3.0, HOME: 1.0}


def stamps(ms):
    array = np.rint(np.atleast_1d(ms) * MS).astype(np.int64)
    return {"arrival_ns": array, "boot_ns": array}


def measured(source, ms, values_m, *, std_m=math.nan, places=None):
    values = np.atleast_1d(np.asarray(values_m, dtype=np.float64))
    std = np.full_like(values, std_m)
    return HeightTrack(
        **stamps(ms), source=source, value_m=values, slant=source is RANGEFINDER, std_m=std, lat_lon_rad=places
    )


def home(ms, values_m):
    values = np.atleast_1d(np.asarray(values_m, dtype=np.float64))
    zero = np.zeros_like(values)
    return PositionTrack(**stamps(ms), lat_rad=zero, lon_rad=zero, alt_msl_m=zero, height_home_m=values)


def level(_):
    return from_yaw_pitch_roll(0.0, 0.0, 0.0)


def swaying(stamp_ns):
    time_s = stamp_ns / SECOND
    return from_yaw_pitch_roll(0.7, 0.4 * math.sin(3 * time_s), 0.3 * math.cos(2 * time_s))


def slant_m(height_m, stamp_ns, normal=(0.0, 0.0, -1.0)):
    """By ray and plane: from a sensor that looks along the body's down axis, to a plane under it, NED."""
    beam = matrix(swaying(stamp_ns))[:, 2]
    return height_m * normal[2] / (beam @ np.array(normal))


@given(st.floats(0, 10), st.floats(2.0, 300.0))
def test_over_level_ground_a_swaying_vehicle_keeps_its_height(time_s, height_m):
    """Ranges at 10 Hz from a vehicle that sways by 20 degrees; interpolated slant ranges would be centimetres off."""
    times_ms = 100.0 * np.arange(int(time_s * 10), int(time_s * 10) + 2)
    ranges = [slant_m(height_m, round(ms * MS)) for ms in times_ms]
    found = Heights(measured(RANGEFINDER, times_ms, ranges)).at(round((times_ms[0] + 37) * MS), END_OF_TIME, swaying)
    assert found.height_agl_m == pytest.approx(height_m, abs=1e-9)


def test_the_foot_of_the_beam_is_where_the_ray_meets_a_slope():
    """Over a slope of 10 degrees that rises to the north the range is another, and so is the foot."""
    rise = math.tan(math.radians(10))
    normal = np.array([-rise, 0.0, -1.0]) / math.hypot(rise, 1.0)
    range_m = slant_m(50.0, 0, normal)
    found = Heights(measured(RANGEFINDER, 0, range_m)).at(0, END_OF_TIME, swaying)
    hit_ned = range_m * matrix(swaying(0))[:, 2]
    assert hit_ned[2] == pytest.approx(50.0 - rise * hit_ned[0])
    np.testing.assert_allclose([found.foot_m[1], found.foot_m[0], found.height_agl_m], hit_ned)


@pytest.mark.parametrize("seed", range(3))
def test_stated_stds_are_those_of_monte_carlo(seed):
    """A rangefinder of 0.3 m on a vehicle whose attitude is off by 0.2 degrees, leaning by up to 35."""
    rng = np.random.default_rng(seed)
    pitch, roll, height_m = *rng.uniform(-0.6, 0.6, 2), rng.uniform(20, 150)
    truth = matrix(from_yaw_pitch_roll(0.0, pitch, roll))[:, 2]
    off = []
    for _ in range(1500):
        noisy = from_yaw_pitch_roll(0.0, *(np.array([pitch, roll]) + rng.normal(0, math.radians(0.2), 2)))
        made = Heights(measured(RANGEFINDER, 0, height_m / truth[2] + rng.normal(0, 0.3)), std_m=STD)
        found = made.at(0, END_OF_TIME, lambda _, noisy=noisy: noisy)
        off.append((found.height_agl_m - height_m) / found.std_m)
    assert np.std(off) == pytest.approx(1.0, abs=0.08)
    assert np.mean(np.abs(off) < 1.96) == pytest.approx(0.95, abs=0.02)


def fixes(ms, accuracy_m, fix=3):
    accuracy = np.atleast_1d(np.asarray(accuracy_m, dtype=np.float64))
    kind = np.broadcast_to(fix, accuracy.shape)
    return GpsTrack(**stamps(ms), fix=kind, satellites=kind, horizontal_std_m=accuracy, vertical_std_m=accuracy)


@pytest.mark.parametrize(
    ("accuracy_m", "age_s", "expected_m"), [(2.5, 1, 2.5), (0.4, 1, 1.0), (2.5, 100, 2.5), (math.nan, 1, 1.0)]
)
def test_a_height_with_the_position_is_no_better_than_the_fix(accuracy_m, age_s, expected_m):
    fix = fixes(200_000 - 1000 * age_s, accuracy_m)
    found = Heights(fix, home([199_900, 200_100], [50, 50])).at(200 * SECOND, END_OF_TIME, level)
    assert found.std_m == expected_m


@pytest.mark.parametrize(
    ("later", "expected_m"),
    [
        (fixes([2000, 3000], [math.nan, math.nan]), 2.5),
        (fixes([2000, 3000], [0.1, 0.2], fix=1), 2.5),
        (fixes([2000, 3000], [9.0, 65.0], fix=[3, 1]), 65.0),
        (fixes([2000, 3000], [65.0, 1.5], fix=[1, 3]), 1.5),
    ],
)
def test_a_fix_that_is_lost_makes_no_height_better(later, expected_m):
    made = Heights(fixes([0, 1000], [4.0, 2.5]), later, home([9_900, 10_100], [50, 50]))
    assert made.at(10 * SECOND, END_OF_TIME, level).std_m == expected_m


def test_clocks_that_start_anew_make_no_height_better():
    made = Heights(fixes([0, 1000], [4.0, 2.5]))
    made.all.clear()
    made.append(home([500, 1500, 2500, 3500], [50, 50, 50, 50]), fixes(3000, 1.5))
    found = [made.at(ms * MS, END_OF_TIME, level).std_m for ms in (1000, 2900, 3100)]
    assert found == [2.5, 2.5, 1.5]


@given(st.floats(0.0, 1.0))
def test_a_step_between_two_samples_is_in_the_std(weight):
    """Over an edge of 30 m the height is one or the other, at any time between the two with the same chances."""
    stamp_ns = round(100 * MS * weight)
    found = Heights(measured(RANGEFINDER, [0, 100], [60.0, 30.0])).at(stamp_ns, END_OF_TIME, level)
    share = stamp_ns / (100 * MS)
    truth = np.array([60.0] * 1000 + [30.0] * 1000)
    chance = np.concatenate([np.full(1000, (1 - share) / 1000), np.full(1000, share / 1000)])
    spread = math.sqrt(float(chance @ (truth - found.height_agl_m) ** 2))
    assert found.std_m == pytest.approx(math.hypot(0.2, spread * 29 / 30), rel=1e-6)  # 1 m may be the climb


@pytest.mark.parametrize(("north_m", "source"), [(140.0, TERRAIN), (160.0, HOME)])
def test_a_terrain_report_of_elsewhere_is_none(north_m, source):
    place = (0.6, 1.2)
    reported = np.array([[place[0] + north_m / EARTH_M, place[1]]] * 2)
    made = Heights(measured(TERRAIN, [0, 1000], [40, 40], places=reported), home([0, 1000], [50, 50]))
    found = made.at(500 * MS, END_OF_TIME, level, place)
    assert found.source is source
    passed_over = "terrain is of a place more than 150 m away, and is not taken"
    assert (passed_over in found.reasons) == (source is HOME)


def test_a_terrain_report_from_across_the_180th_meridian_is_near():
    reported = np.array([[0.6, -math.pi + 1e-6]] * 2)
    made = Heights(measured(TERRAIN, [0, 1000], [40, 40], places=reported), home([0, 1000], [50, 50]))
    assert made.at(500 * MS, END_OF_TIME, level, (0.6, math.pi - 1e-6)).source is TERRAIN


def test_a_source_that_disagrees_is_named_with_both_values():
    made = Heights(
        measured(RANGEFINDER, [0, 100], [40, 40]), measured(TERRAIN, [0, 100], [49, 49]), home([0, 100], [50, 50])
    )
    found = made.at(50 * MS, END_OF_TIME, level)
    assert found.source is RANGEFINDER
    assert found.reasons == (
        "terrain says 49.00 m where rangefinder says 40.00 m: 9.00 m apart, their std is 3.01 m",
        "home says 50.00 m where rangefinder says 40.00 m: 10.00 m apart, their std is 1.02 m",
        "rangefinder is alone: terrain and home are 1.00 m apart",
        "nothing shows whether rangefinder or terrain and home is right: the std holds both",
    )
    assert found.std_m == 10.0


@pytest.mark.parametrize(("apart_m", "said"), [(1.9, 0), (2.1, 1)])
def test_what_the_stds_explain_is_no_disagreement(apart_m, said):
    made = Heights(measured(RANGEFINDER, [0, 100], [40, 40]), home([0, 100], [40 + apart_m] * 2))
    assert len(made.at(50 * MS, END_OF_TIME, level).reasons) == said


def test_false_alarms_are_one_in_twenty():
    rng = np.random.default_rng(4)
    alarms = 0
    for _ in range(600):
        range_m, home_m = 50 + rng.normal(0, 0.2), 50 + rng.normal(0, 1.0)
        made = Heights(measured(RANGEFINDER, [0, 100], [range_m] * 2), home([0, 100], [home_m] * 2))
        alarms += len(made.at(50 * MS, END_OF_TIME, level).reasons)
    assert alarms / 600 == pytest.approx(0.05, abs=0.025)


def test_a_switch_tells_the_step_of_when_the_old_source_last_spoke():
    """The rangefinder ends at 1 s while the vehicle climbs by 2 m/s: only the offset of the two is the step."""
    times = np.arange(0, 5000, 100.0)
    climbing = 30 + 0.002 * times
    made = Heights(measured(RANGEFINDER, times[:11], climbing[:11]), home(times, climbing + 4.0))
    switch = made.switch(RANGEFINDER, HOME, 4 * SECOND, level)
    assert (switch.before, switch.after, switch.step.stamp_ns) == (RANGEFINDER, HOME, SECOND)
    assert switch.step.step_m == pytest.approx(4.0)
    assert switch.step.std_m == pytest.approx(math.hypot(0.2, 1.0))
    back = made.switch(HOME, RANGEFINDER, SECOND, level)
    assert back.step.step_m == pytest.approx(-4.0)


def test_sources_that_never_spoke_at_one_time_have_no_step():
    made = Heights(measured(RANGEFINDER, [0, 100], [40, 40]), home([9000, 9100], [50, 50]))
    assert made.switch(RANGEFINDER, HOME, 9 * SECOND, level).step is None


def test_a_sensor_that_looks_up_says_nothing():
    made = Heights(measured(RANGEFINDER, 0, 40.0))
    assert made.at(0, END_OF_TIME, lambda _: from_yaw_pitch_roll(0.0, 0.0, math.pi)) is Missing.STALE
