"""Heights above the surface: who follows the vehicle's vertical motion is believed, who does not is refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerodft.geometry import from_yaw_pitch_roll
from aerodft.model import HeightSource, HeightTrack, PositionTrack
from aerodft.service import LAST, HeightSettings
from aerodft.service.pose.heights import HeightSources
from aerodft.service.streams import END_OF_TIME, Missing, Query

from .heights import Heights
from .test_home_checks import asked, climb_to, level, stamps

SECOND = 1_000_000_000
EARTH_M = 6_371_008.8
RANGEFINDER, HOME = HeightSource.RANGEFINDER, HeightSource.HOME
LEVEL = from_yaw_pitch_roll(0.0, 0.0, 0.0)
TIMES = np.arange(0.0, 60.0, 0.1)


def ranges(values_m, times_s=TIMES):
    values = np.zeros(len(times_s)) + values_m
    return HeightTrack(
        **stamps(times_s), source=RANGEFINDER, value_m=values, slant=True, std_m=np.full_like(values, np.nan)
    )


def home(height_m, climb_mps, north_m=0.0, times_s=TIMES):
    zero = np.zeros(len(times_s))
    return PositionTrack(
        **stamps(times_s),
        lat_rad=zero + np.asarray(north_m) / EARTH_M,
        lon_rad=zero,
        alt_msl_m=zero + height_m,
        height_home_m=zero + height_m,
        climb_mps=zero + climb_mps,
    )


def wrong_share(found, truth_m):
    """Share of the heights that miss by more than 3 std."""
    pairs = [(f, t) for f, t in zip(found, truth_m, strict=True) if not isinstance(f, Missing) and t > 1]
    return np.mean([abs(f.height_agl_m - t) > 3 * f.std_m for f, t in pairs])


@pytest.mark.parametrize(("stuck_m", "home_m"), [(15.0, 40.0), (130.0, 40.0), (130.0, 140.0)])
def test_in_a_hover_the_std_holds_both_and_says_so(stuck_m, home_m):
    (found,) = asked(Heights(ranges(stuck_m), home(home_m, 0.0)), [30.05])
    apart_m = abs(home_m - stuck_m)
    assert (found.source, found.std_m) == (RANGEFINDER, pytest.approx(apart_m))
    assert found.reasons[-1] == "nothing shows whether rangefinder or home is right: the std holds both"
    assert f"{apart_m:.2f} m apart" in found.reasons[0]


@pytest.mark.parametrize("noise_m", [0.0, 0.1])
@pytest.mark.parametrize("stuck_m", [15.0, 130.0])
def test_a_reading_that_stood_still_in_a_climb_is_refused_and_home_answers(stuck_m, noise_m):
    rng = np.random.default_rng(1)
    height_m, climb_mps = climb_to(TIMES, 40.0)
    made = Heights(ranges(stuck_m + rng.normal(0, 1, len(TIMES)) * noise_m), home(height_m, climb_mps))
    (found,) = asked(made, [40.05])
    assert (found.source, found.height_agl_m, found.std_m) == (HOME, pytest.approx(40.0), 1.0)
    assert found.reasons[0].endswith("and is not believed: it stood still while the vehicle climbed or sank")


def test_a_reading_that_scatters_is_refused_and_home_answers():
    values_m = np.random.default_rng(2).uniform(0.3, 120.0, len(TIMES))
    found = asked(Heights(ranges(values_m), home(40.0, 0.0)), np.arange(5.05, 55.0, 0.5))
    assert {each.source for each in found} == {HOME}
    assert {each.std_m for each in found} == {1.0}
    assert "and is not believed: it scatters by" in found[0].reasons[0]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 6.0), st.booleans())
def test_honest_ranges_over_any_terrain_keep_their_std(seed, relief_m, follows_terrain):
    """After a climb, over slopes, banks and canopy that pass at 4 m/s; a vehicle may follow the terrain."""
    rng = np.random.default_rng(seed)
    height_m, climb_mps = climb_to(TIMES, 60.0)
    north_m = 4.0 * np.maximum(TIMES - 35, 0)
    places = np.arange(0.0, 120.0, 8.0)
    ground_m = np.interp(north_m, places, np.concatenate([[0, 0], rng.uniform(0, relief_m, len(places) - 2)]))
    if follows_terrain:
        height_m, climb_mps = height_m + ground_m, climb_mps + np.gradient(ground_m, TIMES)
    clearance_m = height_m - ground_m
    made = Heights(
        ranges(np.maximum(clearance_m, 0.2) + rng.normal(0, 0.1, len(TIMES))),
        home(height_m + rng.normal(0, 0.1, len(TIMES)), climb_mps, north_m),
    )
    found = asked(made, np.arange(36.05, 59.0, 0.7))
    assert {each.source for each in found} == {RANGEFINDER}
    assert max(each.std_m for each in found) < 0.25


def test_a_banks_edge_is_no_lie():
    """The vehicle flies from a bank over the water 8 m below: the rangefinder steps, and is believed."""
    height_m, climb_mps = climb_to(TIMES, 40.0)
    north_m = 3.0 * np.maximum(TIMES - 30, 0)
    clearance_m = height_m + 8.0 * (north_m > 20)
    found = asked(Heights(ranges(clearance_m), home(height_m, climb_mps, north_m)), [50.05])
    assert [(each.source, each.std_m) for each in found] == [(RANGEFINDER, pytest.approx(0.2))]
    assert "home says 40.00 m where rangefinder says 48.00 m" in found[0].reasons[0]


def test_a_step_in_a_hover_takes_belief_away_until_a_motion_is_followed():
    height_m, climb_mps = climb_to(TIMES, 40.0)
    down_m, down_mps = climb_to(TIMES, 10.0, from_s=45.0)
    stepped_m = np.where(TIMES < 35, 0.0, 12.0)
    made = Heights(
        ranges(np.maximum(height_m - down_m - stepped_m, 0.2)), home(height_m - down_m, climb_mps - down_mps)
    )
    before, after, followed = asked(made, [34.05, 40.05, 55.05])
    assert (before.std_m, after.std_m) == (pytest.approx(0.2), pytest.approx(12.0, abs=0.5))
    assert (followed.source, followed.std_m) == (RANGEFINDER, pytest.approx(0.2))


@pytest.mark.parametrize("drift_mps", [-1.0, 0.5, 3.0])
def test_a_drift_in_a_hover_is_in_the_std(drift_mps):
    height_m, climb_mps = climb_to(TIMES, 40.0)
    values_m = np.maximum(height_m + drift_mps * np.maximum(TIMES - 30, 0), 0.2)
    found = asked(Heights(ranges(values_m), home(height_m, climb_mps)), np.arange(6.05, 58.0, 0.1))
    truth_m = np.interp(np.arange(6.05, 58.0, 0.1), TIMES, height_m)
    assert wrong_share(found, truth_m) < 0.04


@pytest.mark.parametrize("scale", [0.5, 2.0, 3.28])
def test_a_reading_in_other_units_is_refused_or_held(scale):
    height_m, climb_mps = climb_to(TIMES, 40.0)
    when = np.arange(6.05, 58.0, 0.1)
    found = asked(Heights(ranges(np.maximum(scale * height_m, 0.2)), home(height_m, climb_mps)), when)
    assert wrong_share(found, np.interp(when, TIMES, height_m)) < 0.02


def test_home_that_jumps_leaves_the_rangefinder_alone():
    height_m, climb_mps = climb_to(TIMES, 40.0)
    made = Heights(ranges(np.maximum(height_m, 0.2)), home(height_m + 30.0 * (TIMES > 35), climb_mps))
    found = asked(made, np.arange(36.05, 58.0))
    assert {(each.source, round(each.std_m, 6), each.reasons) for each in found} == {(RANGEFINDER, 0.2, ())}


def test_both_wrong_is_a_refusal_that_names_both():
    height_m, climb_mps = climb_to(TIMES, 40.0)
    made = Heights(ranges(15.0), home(height_m + 30.0 * (TIMES > 35), climb_mps))
    where = np.array([round(40.05 * SECOND)])
    batch = made.all.at(Query.final(where, LAST), level, np.full((1, 2), np.nan))
    assert batch.missing[0] == Missing.REFUSED
    assert [sentence.split(":")[0] for sentence in batch.refusals[0]] == [
        "rangefinder says 15.00 m and is not believed",
        "home is not believed",
    ]


def test_heights_on_known_ground_are_compared_above_it():
    made = Heights(ranges(25.0), home(60.0, 0.0)).all
    where = np.array([round(30.05 * SECOND)])
    query = Query.final(where, LAST), level, np.full((1, 2), np.nan)
    assert (made.at(*query, np.array([35.0])).std_m[0], made.at(*query).std_m[0]) == (0.2, 35.0)


def test_verdicts_do_not_depend_on_how_ticks_are_grouped():
    rng = np.random.default_rng(5)
    height_m, climb_mps = climb_to(TIMES, 40.0)
    jumping_m = height_m + np.where((TIMES > 30) & (TIMES < 38), 20.0, 0.0)
    erratic_m = np.maximum(height_m * np.where(TIMES < 20, 1.0, 0.3) + rng.normal(0, 0.3, len(TIMES)), 0.2)
    tracks = home(jumping_m, climb_mps), ranges(erratic_m)
    ticks_ns = np.arange(0, 60 * SECOND, SECOND // 4) + SECOND // 8
    results = [_checked(tracks, ticks_ns, size) for size in (1, 7, len(ticks_ns))]
    for name, values in results[0].items():
        assert np.ptp(values) > 0 or name == "correction_m"
        for other in results[1:]:
            np.testing.assert_array_equal(values, other[name])


def _checked(tracks, ticks_ns, size):
    """What is found of each sample, taking so many ticks at once."""
    made = HeightSources(HeightSettings(order=(RANGEFINDER, HOME)))
    ends = [np.searchsorted(track.arrival_ns, ticks_ns, side="right") for track in tracks]
    for first in range(0, len(ticks_ns), size):
        made.commit()
        for track, end in zip(tracks, ends, strict=True):
            start = end[first - 1] if first else 0
            part = track.rows(slice(start, end[min(first + size, len(ticks_ns)) - 1]))
            made.append(part, part.boot_ns, end[first : first + size] - start)
        made.check(lambda stamps_ns, _: np.tile(LEVEL, (len(stamps_ns), 1)))
    heights, rangefinder = made.streams()[3], made.streams()[0]
    found = {name: heights.column(name) for name in ("unexplained_m", "correction_m", "follows")}
    return {**found, **{name: rangefinder.column(name) for name in ("verdict", "doubt_m")}}


def test_a_climb_of_a_sway_is_followed():
    """A vehicle that rolls by 17 degrees: ranges along its down axis follow all the same."""

    def swaying(stamp_ns):
        return from_yaw_pitch_roll(0.0, 0.0, 0.3 * math.sin(2 * stamp_ns / SECOND))

    height_m, climb_mps = climb_to(TIMES, 40.0)
    slant_m = np.maximum(height_m, 0.2) / np.cos(0.3 * np.sin(2 * TIMES))
    made = Heights(ranges(slant_m), home(height_m, climb_mps))
    found = made.at(round(50.05 * SECOND), END_OF_TIME, swaying)
    assert (found.source, found.reasons) == (RANGEFINDER, ())
