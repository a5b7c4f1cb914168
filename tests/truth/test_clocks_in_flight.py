"""Poses under clocks that drift, jump, wrap and begin anew, by where the vehicle truly was: never a wrong one."""

import math

import numpy as np
import pytest

from aerodft.model import StampClock, Status
from tests.nights import at_night

from .clock_flights import UTC0, WRAP_MS, Clocks, flown

SECOND = 1_000_000_000
BY_UTC_S = 0.002  # boot times are whole milliseconds
WHOLE_S = 0.001
BY_HOST_S = 0.03  # the least delay of 20 ms is not to be known from arrivals


def good(taken, after_s=0.0):
    return [each for each in taken if each.sample.status is Status.OK and each.true_s >= after_s]


def off_s(taken, after_s=0.0):
    return np.array([each.off_s for each in good(taken, after_s)])


@pytest.mark.nightly
@pytest.mark.parametrize("boot_drift", [0.0, 3e-5, -2e-4, 1e-3])
def test_a_vehicles_clock_that_drifts(boot_drift, capsys):
    taken, health = flown(Clocks(boot_drift=boot_drift, booted_s=86_400.0, delay_s=0.2), 60.0)
    error = off_s(taken, after_s=2.0)
    assert len(error) == len([each for each in taken if each.true_s >= 2.0])
    assert np.max(np.abs(error)) < BY_UTC_S
    found = health().drift
    truth = 1 / (1 + boot_drift) - 1
    assert found == pytest.approx(truth, abs=WHOLE_S / 60)
    with capsys.disabled():
        print(f"\nboot drift {boot_drift:g}: {1e3 * error.std():.2f} ms, drift off by {1e6 * (found - truth):+.2f} ppm")


@pytest.mark.nightly
@pytest.mark.parametrize(("host_drift", "delay_s"), [(0.0, 0.15), (1e-4, 0.005), (-3e-4, 0.005), (-3e-4, 0.15)])
def test_this_machines_clock_drifts(host_drift, delay_s, capsys):
    """Stamped on arrival: the fastest messages tell how the clocks stand, whatever the radio delays."""
    clocks = Clocks(host_ahead_s=-7.3, host_drift=host_drift, delay_s=delay_s)
    error = off_s(flown(clocks, 100.0, by=StampClock.HOST, rate_hz=5.0, image_hz=2.0)[0], after_s=30.0)
    assert len(error) > 125
    assert np.max(np.abs(error)) < BY_HOST_S + 0.1 * delay_s
    with capsys.disabled():
        mean_ms, std_ms = 1e3 * error.mean(), 1e3 * error.std()
        print(f"\nhost drift {host_drift:g}, delays {delay_s:g} s: {mean_ms:+.1f} +- {std_ms:.1f} ms")


@pytest.mark.parametrize("by", StampClock)
def test_utc_that_becomes_known_in_flight_comes_with_no_gap(by):
    """Images by UTC wait for it; those before it are held against this machine's clock, which is said."""
    taken, _ = flown(Clocks(utc_known_at_s=10.0, host_ahead_s=0.06), 30.0, by=by)
    assert len(good(taken, 1.0)) > 0.95 * len([each for each in taken if each.true_s > 1.0])
    assert np.max(np.abs(off_s(taken, 8.5))) < (BY_HOST_S if by is StampClock.HOST else BY_UTC_S)
    guessed, hosted = (
        [each for each in good(taken) if f"the vehicle has not said what UTC is: {what}" in each.sample.reasons]
        for what in ("the receiving machine's clock is taken for it", "the stamp is the receiving machine's clock")
    )
    assert bool(hosted) == (by is StampClock.HOST)
    assert all(each.true_s < 10.0 for each in hosted)
    assert all(each in hosted for each in good(taken) if by is StampClock.HOST and each.true_s < 9.0)
    assert all(each.true_s < 10.0 and each.sample.pose.time_std_s >= 0.1 for each in guessed)
    assert bool(guessed) == (by is StampClock.UTC)
    assert all(abs(each.off_s) < 2 * each.sample.pose.time_std_s for each in guessed)


def test_a_vehicle_that_never_knows_utc_has_poses_by_this_machines_clock():
    taken, _ = flown(Clocks(utc_known_at_s=math.inf, host_ahead_s=0.05), 10.0)
    assert len(good(taken)) > 30
    assert all("has not said what UTC is" in each.sample.reasons[-1] for each in good(taken))


@pytest.mark.parametrize("wrong_s", [-3.0, 0.4, 18.0])
def test_a_jump_of_utc_costs_no_image_that_can_wait(wrong_s):
    taken, _ = flown(Clocks(utc_wrong_s=wrong_s, utc_right_at_s=20.0), 40.0, wait_s=5.0)
    assert np.max(np.abs(off_s(taken, after_s=20.1))) < BY_UTC_S
    assert len(good(taken, 20.1)) > 75


@pytest.mark.parametrize("wrong_s", [18.0, *at_night(-3.0, 0.4)])
def test_a_jump_of_utc_is_a_status_until_it_is_settled(wrong_s, capsys):
    """From the first second of the right time to the third; then all is right again, without a gap."""
    taken, health = flown(Clocks(utc_wrong_s=wrong_s, utc_right_at_s=20.0), 40.0, wait_s=0.5)
    assert np.max(np.abs(off_s(taken, after_s=22.5))) < BY_UTC_S
    jumped = [each for each in taken if each.sample.status is Status.CLOCK_JUMPED]
    assert jumped
    assert all("UTC jumped by" in each.sample.reasons[0] for each in jumped)
    wrong = [each for each in good(taken) if each.true_s >= 20.0 and abs(each.off_s) > BY_UTC_S]
    assert wrong == []
    assert health().jumps_s == pytest.approx((-wrong_s,), abs=0.002)
    twice = [any("said this time twice" in reason for reason in each.sample.reasons) for each in good(taken, 22.5)]
    assert sum(twice) == pytest.approx(4 * min(max(wrong_s, 0.0), 17.0), abs=4 if wrong_s > 0 else 0)
    with capsys.disabled():
        print(f"\nUTC jumps by {-wrong_s:g} s: {len(jumped)} images of 4 a second are CLOCK_JUMPED")


@pytest.mark.parametrize("wrong_s", [-3.0, 18.0])
def test_a_jump_of_utc_loses_no_image_of_this_machines_clock(wrong_s):
    taken, _ = flown(Clocks(utc_wrong_s=wrong_s, utc_right_at_s=20.0), 40.0, by=StampClock.HOST)
    assert np.max(np.abs(off_s(taken, after_s=1.0))) < BY_HOST_S
    assert len(good(taken, 1.0)) > 0.95 * len([each for each in taken if each.true_s > 1.0])


@pytest.mark.parametrize("by", StampClock)
def test_a_reboot_makes_no_pose_of_both_sides(by):
    taken, health = flown(Clocks(reboot_at_s=20.0), 45.0, by=by)
    assert np.max(np.abs(off_s(taken, after_s=1.0))) < BY_HOST_S
    assert len(good(taken, 25.0)) > 0.9 * len([each for each in taken if each.true_s > 25.0])
    between = [each.sample.status for each in taken if 20.2 < each.true_s < 21.8]
    assert Status.OK not in between
    assert health().restarts == 1
    for each in good(taken, 1.0):
        assert ("the vehicle rebooted" in " ".join(each.sample.reasons)) == (each.true_s > 20.0)


def test_after_50_days_milliseconds_wrap_and_nothing_happens():
    taken, health = flown(Clocks(booted_s=(WRAP_MS - 10_000) / 1000), 20.0)
    assert np.max(np.abs(off_s(taken, after_s=1.0))) < BY_UTC_S
    assert len(good(taken, 1.0)) > 0.95 * len([each for each in taken if each.true_s > 1.0])
    assert health().wraps == 1


@pytest.mark.parametrize("booted_s", [63.0, *at_night(10.0, 90_000.0)])
def test_two_autopilots_with_the_same_ids_are_not_mixed(booted_s):
    taken, health = flown(Clocks(rival_booted_s=booted_s), 20.0)
    places = {round(math.degrees(each.sample.lon_rad), 3) for each in good(taken)}
    assert places == {149.16}
    assert np.max(np.abs(off_s(taken, after_s=1.0))) < BY_UTC_S
    assert health().rivals
    assert all("a second autopilot speaks" in each.sample.reasons[-1] for each in good(taken, 2.0))


def test_stamps_are_utc_whatever_this_machines_clock_says():
    taken, _ = flown(Clocks(host_ahead_s=-7.3), 10.0, by=StampClock.HOST)
    late = [each.sample.stamp_ns - UTC0 - each.true_s * SECOND for each in good(taken, 2.0)]
    assert np.max(np.abs(late)) < BY_HOST_S * SECOND
