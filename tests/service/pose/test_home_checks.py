"""Heights above home against the vehicle's own vertical motion: what physics forbids is refused or held by the std."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerodft.geometry import from_yaw_pitch_roll
from aerodft.model import ClimbTrack, GpsTrack, HeartbeatTrack, HeightSource, LandedTrack, PositionTrack
from aerodft.service import HEIGHT_SOURCES, LAST
from aerodft.service.streams import Missing, Query

from .heights import Height, Heights

SECOND = 1_000_000_000
LEVEL = from_yaw_pitch_roll(0.0, 0.0, 0.0)
HOME_MSL_M = 500.0
RATES_HZ = st.sampled_from([1.0, 2.5, 4.0, 5.0, 10.0])


def stamps(times_s):
    array = np.rint(np.asarray(times_s) * SECOND).astype(np.int64)
    return {"arrival_ns": array, "boot_ns": array}


def positions(times_s, height_m, climb_mps, alt_msl_m=None):
    zero = np.zeros(len(times_s))
    height_m = zero + height_m
    return PositionTrack(
        **stamps(times_s),
        lat_rad=zero,
        lon_rad=zero,
        alt_msl_m=height_m + HOME_MSL_M if alt_msl_m is None else zero + alt_msl_m,
        height_home_m=height_m,
        climb_mps=None if climb_mps is None else zero + climb_mps,
    )


def fixes(times_s, alt_msl_m, std_m=1.2):
    zero = np.zeros(len(times_s))
    three = np.full(len(times_s), 3)
    return GpsTrack(
        **stamps(times_s),
        fix=three,
        satellites=three,
        horizontal_std_m=zero + 1,
        vertical_std_m=zero + std_m,
        alt_msl_m=zero + alt_msl_m,
    )


def armed(times_s, is_armed):
    flags = np.broadcast_to(is_armed, len(times_s)).astype(np.bool_)
    return HeartbeatTrack(**stamps(times_s), autopilot=np.full(len(times_s), 3), is_armed=flags)


def level(stamps_ns, *_):
    """The attitude of a level vehicle at stamps."""
    return np.tile(LEVEL, (len(stamps_ns), 1)), np.zeros(len(stamps_ns), dtype=np.int64)


def asked(made, times_s, vehicle_at=level):
    """Heights at times as ``Heights.at`` gives them, asked for at once."""
    stamps_ns = np.rint(np.asarray(times_s) * SECOND).astype(np.int64)
    query = Query.final(stamps_ns, np.full(len(stamps_ns), -1))
    batch = made.all.at(query, vehicle_at, np.full((len(stamps_ns), 2), np.nan))
    return [_height(batch, row) for row in range(len(stamps_ns))]


def _height(batch, row):
    if batch.missing[row] != Missing.NOTHING:
        return Missing(batch.missing[row])
    source = batch.order[batch.source[row]]
    numbers = float(batch.height_agl_m[row]), float(batch.std_m[row])
    return Height(
        *numbers, source, HEIGHT_SOURCES[source].datum, float(batch.age_s[row]), reasons=batch.reasons.get(row, ())
    )


def errors_in_stds(found, truth_m):
    """Errors of the heights that there are, over their std."""
    pairs = zip(found, truth_m, strict=True)
    return [abs(each.height_agl_m - truth) / each.std_m for each, truth in pairs if not isinstance(each, Missing)]


def climb_to(times_s, height_m, from_s=5.0, mean_mps=2.5):
    """A smooth climb from the ground: heights and vertical speeds."""
    whole_s = height_m / mean_mps
    share = np.clip((np.asarray(times_s) - from_s) / whole_s, 0, 1)
    height = height_m * (share - np.sin(2 * math.pi * share) / (2 * math.pi))
    return height, height_m / whole_s * (1 - np.cos(2 * math.pi * share))


@settings(max_examples=40, deadline=None)
@given(st.floats(2.0, 600.0), st.sampled_from([-1, 1]), st.floats(10.0, 30.0), RATES_HZ, st.booleans())
def test_a_step_that_the_vertical_speed_does_not_explain_is_never_narrow(step_m, sign, at_s, rate_hz, comes_back):
    times = np.arange(0.0, 40.0, 1 / rate_hz)
    is_off = (times >= at_s) & ((times < at_s + 5) | (not comes_back))
    made = Heights(positions(times, 40.0 + sign * step_m * is_off, 0.0))
    found = asked(made, np.arange(2.0, 38.0, 0.31))
    assert max(errors_in_stds(found, np.full(len(found), 40.0))) < 3


@settings(max_examples=40, deadline=None)
@given(st.floats(0.4, 4.0), st.sampled_from([-1, 1]), RATES_HZ)
def test_a_drift_is_held_by_the_std_and_then_refused(drift_mps, sign, rate_hz):
    times = np.arange(0.0, 60.0, 1 / rate_hz)
    drift_m = sign * drift_mps * np.maximum(times - 20, 0)
    found = asked(Heights(positions(times, 100.0 + drift_m, 0.0)), np.arange(2.0, 58.0, 0.5))
    assert max(errors_in_stds(found, np.full(len(found), 100.0))) < 3.3
    assert found[-1] is Missing.REFUSED


def test_a_height_that_stands_still_in_a_climb_is_refused():
    times = np.arange(0.0, 30.0, 0.2)
    _, climb_mps = climb_to(times, 40.0)
    found = asked(Heights(positions(times, 20.0, climb_mps)), [4.0, 28.0])
    assert (found[0].height_agl_m, found[0].std_m, found[1]) == (20.0, 1.0, Missing.REFUSED)


def test_the_refusal_names_both_heights_and_their_std():
    times = np.arange(0.0, 40.0, 0.2)
    made = Heights(positions(times, np.where(times < 30, 40.0, 70.0), 0.0))
    where = np.array([35 * SECOND])
    batch = made.all.at(Query.final(where, LAST), lambda *_: None, np.full((1, 2), np.nan))
    (sentence,) = batch.refusals[0]
    assert sentence == (
        "home is not believed: it says 70.00 m where the vehicle's own vertical motion makes it 40.01 m, 29.99 m apart,"
        " its std is 1.00 m"
    )


def random_flight(rng, times_s):
    """Vertical speeds of up to 8 m/s that change by up to 4 m/s^2, and heights by their integral."""
    fine = np.arange(0.0, times_s[-1] + 1, 0.01)
    goals = np.repeat(rng.uniform(-8, 8, len(fine) // 400 + 1) * rng.integers(0, 2, len(fine) // 400 + 1), 400)
    speed = np.zeros(len(fine))
    for k in range(1, len(fine)):
        speed[k] = speed[k - 1] + np.clip(goals[k] - speed[k - 1], -0.04, 0.04)
    height = 300.0 + np.cumsum(speed) * 0.01
    return np.interp(times_s, fine, height), np.interp(times_s, fine, speed)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), RATES_HZ, st.sampled_from([-1, 1]), st.floats(-0.1, 0.1), st.booleans())
def test_an_honest_flight_keeps_its_heights_and_stds(seed, rate_hz, sign, bias_mps, has_gaps):
    """With noise, a speed that is biased or negated, quantised, and links that break off for 3 s."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, 120.0, 1 / rate_hz)
    if has_gaps:
        times = times[(times % 20 < 12) | (times % 20 > 15)]
    height, speed = random_flight(rng, times)
    noisy_m = height + rng.normal(0, 0.2, len(times))
    made = Heights(positions(times, noisy_m, np.round(sign * (speed + bias_mps), 1)))
    middles = (times[1:] + times[:-1])[np.diff(times) < 2] / 2
    found = asked(made, middles[::7])
    assert max(each.std_m for each in found) < 1.1  # noise of 0.2 m in 0.1 s is faster than a climb
    assert {each.reasons for each in found} == {()}


def test_a_bias_of_the_vertical_speed_does_not_add_up_over_ten_minutes():
    times = np.arange(0.0, 600.0, 0.2)
    found = asked(Heights(positions(times, 50.0, 0.12)), np.arange(500.0, 599.0))
    assert {(each.std_m, each.reasons) for each in found} == {(1.0, ())}


@pytest.mark.parametrize("step_m", [-12.0, 30.0])
def test_where_the_altitude_agrees_with_the_vertical_speed_it_gives_the_height(step_m):
    """Home moves in flight, or the height above it jumps: altitude and vertical speed outvote it."""
    times = np.arange(0.0, 40.0, 0.2)
    height_m = np.where(times < 20, 40.0, 40.0 + step_m)
    found = asked(Heights(positions(times, height_m, 0.0, HOME_MSL_M + 40.0)), [10.0, 19.9, 25.0, 39.0])
    assert [each.height_agl_m for each in found] == pytest.approx([40.0] * 4)
    assert [len(each.reasons) for each in found] == [0, 1, 1, 1]
    assert f"home jumped by {step_m:.2f} m: it is corrected to 40.00 m" in found[2].reasons[0]


def test_gps_outvotes_a_vertical_speed_that_is_stuck():
    times, seconds = np.arange(0.0, 60.0, 0.2), np.arange(0.0, 60.0)
    height_m, _ = climb_to(times, 30.0, from_s=20.0)
    made = Heights(
        fixes(seconds, HOME_MSL_M + climb_to(seconds, 30.0, from_s=20.0)[0]), positions(times, height_m, 0.0)
    )
    found = asked(made, [10.0, 40.0, 59.0])
    assert [(each.height_agl_m, each.std_m) for each in found] == [(0.0, 1.2), (pytest.approx(30.0), 1.2)] * 1 + [
        (pytest.approx(30.0), 1.2)
    ]
    alone = Heights(positions(times, height_m, 0.0))
    assert asked(alone, [40.0]) == [Missing.REFUSED]


def test_gps_does_not_vouch_for_a_step_faster_than_any_climb():
    """Height, altitude and GPS all jump by 584 m within 0.2 s."""
    times, seconds = np.arange(0.0, 40.0, 0.2), np.arange(0.0, 40.0)
    jumps = positions(times, np.where(times < 20, 40.0, 624.0), 0.0)
    made = Heights(fixes(seconds, HOME_MSL_M + np.where(seconds < 20, 40.0, 624.0)), jumps)
    assert asked(made, [30.0, 39.0]) == [Missing.REFUSED] * 2


@pytest.mark.parametrize(("climb_mps", "refused"), [(None, True), (-327.67, True)])
def test_without_a_vertical_speed_a_step_faster_than_any_climb_is_refused(climb_mps, refused):
    times = np.arange(0.0, 40.0, 0.2)
    steps = asked(Heights(positions(times, np.where(times < 20, 40.0, 60.0), climb_mps)), [30.0])
    assert (steps == [Missing.REFUSED]) is refused
    climbs = asked(Heights(positions(times, 40.0 + 8.0 * np.clip(times - 20, 0, 5), climb_mps)), [30.0])
    assert climbs[0].std_m == 1.0


def test_the_vertical_speed_may_come_in_a_message_of_its_own():
    times = np.arange(0.0, 40.0, 0.1)
    height_m, climb_mps = climb_to(times, 40.0)
    made = Heights(ClimbTrack(**stamps(times), climb_mps=climb_mps), positions(times, height_m, None))
    assert asked(made, [30.0])[0].std_m == 1.0
    made = Heights(ClimbTrack(**stamps(times), climb_mps=climb_mps), positions(times, 20.0, None))
    assert asked(made, [30.0]) == [Missing.REFUSED]


@pytest.mark.parametrize("says", ["landed", "armed"])
def test_a_reading_on_the_ground_is_an_offset_that_the_std_holds(says):
    times, seconds = np.arange(0.0, 60.0, 0.2), np.arange(0.0, 60.0)
    height_m, climb_mps = climb_to(times, 30.0, from_s=20.0)
    if says == "landed":
        ground = LandedTrack(**stamps(seconds), is_landed=seconds < 20)
    else:
        ground = armed(seconds, seconds >= 15)
    (found,) = asked(Heights(ground, positions(times, height_m + 3.0, climb_mps)), [50.0])
    assert (found.height_agl_m, found.std_m) == (pytest.approx(33.0), pytest.approx(math.hypot(1.0, 3.0)))
    assert found.reasons == ("home said 3.00 m on the ground: its std holds this offset",)
    (small,) = asked(Heights(ground, positions(times, height_m + 0.5, climb_mps)), [50.0])
    assert (small.std_m, small.reasons) == (1.0, ())


def test_a_flight_that_lands_elsewhere_has_no_offset():
    """It lands on a hill of 20 m, is disarmed and armed, and flies again."""
    times, seconds = np.arange(0.0, 120.0, 0.2), np.arange(0.0, 120.0)
    up_m, up_mps = climb_to(times, 40.0, from_s=10.0)
    down_m, down_mps = climb_to(times, 20.0, from_s=40.0)
    again_m, again_mps = climb_to(times, 30.0, from_s=80.0)
    is_armed = ((seconds > 5) & (seconds < 60)) | (seconds > 70)
    flight = positions(times, up_m - down_m + again_m, up_mps - down_mps + again_mps)
    (found,) = asked(Heights(armed(seconds, is_armed), flight), [110.0])
    assert (found.height_agl_m, found.std_m, found.reasons) == (pytest.approx(50.0), 1.0, ())


def test_home_may_move_on_the_ground():
    """Between two flights, disarmed, home is set anew 8 m higher."""
    times, seconds = np.arange(0.0, 120.0, 0.2), np.arange(0.0, 120.0)
    up_m, up_mps = climb_to(times, 40.0, from_s=10.0)
    down_m, down_mps = climb_to(times, 32.0, from_s=40.0)
    again_m, again_mps = climb_to(times, 30.0, from_s=80.0)
    height_m = up_m - down_m + again_m - np.where(times > 65, 8.0, 0.0)
    is_armed = ((seconds > 5) & (seconds < 60)) | (seconds > 70)
    made = Heights(armed(seconds, is_armed), positions(times, height_m, up_mps - down_mps + again_mps))
    (found,) = asked(made, [110.0])
    assert (found.height_agl_m, found.std_m, found.reasons) == (pytest.approx(30.0), 1.0, ())


def test_a_flag_that_always_says_disarmed_does_not_hide_a_step():
    times, seconds = np.arange(0.0, 40.0, 0.2), np.arange(0.0, 40.0)
    made = Heights(armed(seconds, is_armed=False), positions(times, np.where(times < 20, 40.0, 70.0), 0.0))
    assert asked(made, [30.0]) == [Missing.REFUSED]


def test_the_next_source_answers_for_a_height_that_is_refused():
    times = np.arange(0.0, 40.0, 0.2)
    made = Heights(
        positions(times, np.where(times < 20, 40.0, 70.0), 0.0),
        order=(HeightSource.HOME, HeightSource.MANUAL),
        manual_m=40.5,
    )
    (found,) = asked(made, [30.0])
    assert (found.source, found.height_agl_m, found.std_m) == (HeightSource.MANUAL, 40.5, 0.5)
    assert found.reasons[0].startswith("home is not believed: it says 70.00 m")
