"""Time since boot through wraps, reboots, late messages and second vehicles, all with known truth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.model import NO_BOOT_TIME, SyncTrack, Track
from aerodft.service.clocks.boot_time import WRAP_NS, BootClock

MS, SECOND = 1_000_000, 1_000_000_000
HOST0 = 1_795_221_168 * SECOND


def track(arrivals_s, boots_s, kind=Track):
    arrivals = HOST0 + np.rint(np.atleast_1d(arrivals_s) * SECOND).astype(np.int64)
    boots = np.rint(np.broadcast_to(boots_s, arrivals.shape) * SECOND).astype(np.int64)
    return kind(arrival_ns=arrivals, boot_ns=boots)


def bare(arrivals_s):
    found = track(arrivals_s, 0)
    return Track(arrival_ns=found.arrival_ns, boot_ns=np.full_like(found.boot_ns, NO_BOOT_TIME))


def followed(clock, *tracks):
    """Time since boot (s) of the rows that are followed, all tracks together, and whether the clock is new."""
    kept, restarted = clock.follow(tracks)
    return np.concatenate([np.zeros(0), *(each.boot_ns / SECOND for each in kept)]).tolist(), restarted


def steps(start_s, stop_s, step_s=0.1):
    return np.arange(start_s, stop_s, step_s)


def test_32_bit_milliseconds_wrap_after_50_days_and_time_goes_on():
    clock = BootClock()
    boots_ns = np.arange(WRAP_NS - SECOND, WRAP_NS + SECOND, 100 * MS)
    arrivals_ns = HOST0 + np.arange(len(boots_ns)) * 100 * MS
    for cut in np.array_split(np.arange(len(boots_ns)), 3):
        (kept,), restarted = clock.follow((Track(arrival_ns=arrivals_ns[cut], boot_ns=boots_ns[cut] % WRAP_NS),))
        assert not restarted
        np.testing.assert_array_equal(kept.boot_ns, boots_ns[cut])
    assert clock.wraps == 1


def test_a_message_with_64_bit_microseconds_does_not_wrap_with_the_others():
    clock = BootClock()
    clock.follow((Track(arrival_ns=np.array([HOST0]), boot_ns=np.array([WRAP_NS - MS])),))
    wide = Track(arrival_ns=np.array([HOST0 + 2 * MS]), boot_ns=np.array([WRAP_NS + MS]))
    narrow = Track(arrival_ns=np.array([HOST0 + 3 * MS]), boot_ns=np.array([2 * MS]))
    kept, _ = clock.follow((wide, narrow))
    assert [int(each.boot_ns[0]) for each in kept] == [WRAP_NS + MS, WRAP_NS + 2 * MS]


def test_a_reboot_within_a_tick_takes_nothing_along():
    """Old rows keep the old clock; new ones are believed once the old clock has been silent for a second."""
    clock = BootClock()
    old, new = steps(0.0, 0.5), steps(0.0, 2.0)
    boots, restarted = followed(
        clock, track(np.concatenate([old, 0.6 + new[:5]]), np.concatenate([100 + old, new[:5]]))
    )
    assert (boots, restarted) == (pytest.approx(100 + old), False)
    assert clock.other_apart_ns == pytest.approx(-100 * SECOND, abs=SECOND)
    boots, restarted = followed(clock, track(0.6 + new[5:], new[5:]))
    assert restarted
    assert boots == pytest.approx(new[5:])
    assert clock.restarts == 1


def test_after_a_pause_a_reboot_is_believed_at_its_third_message():
    clock = BootClock()
    followed(clock, track(steps(0, 1), 100 + steps(0, 1)))
    assert followed(clock, track([20.0, 20.1], [3.0, 3.1])) == ([], False)
    assert followed(clock, track([20.2], [3.2])) == ([3.2], True)


@pytest.mark.parametrize("apart_s", [-90.0, 2.5, 4900.0])
def test_a_second_autopilot_with_the_same_ids_is_left_out(apart_s):
    """Its rows alternate with the followed one's; unstamped ones go with the stamped one before them."""
    clock = BootClock()
    mine, theirs = [], 0
    for k in range(400):
        at = 0.1 * k
        rows = (track(at, 100 + at), bare(at + 0.01), track(at + 0.05, 100 + apart_s + at), bare(at + 0.06))
        kept, restarted = clock.follow(rows)
        assert not restarted
        mine += [row for each in kept for row in each.boot_ns.tolist()]
        theirs += 4 - sum(len(each.boot_ns) for each in kept)
    np.testing.assert_allclose(np.array(mine) / SECOND, np.repeat(100 + 0.1 * np.arange(400), 2))
    assert clock.has_other_clock
    assert theirs == 800


def test_a_stray_row_is_left_out_and_forgotten():
    clock = BootClock()
    followed(clock, track(0.0, 50.0))
    assert followed(clock, track([0.1, 0.2, 0.3], [50.1, 7.0, 50.3]))[0] == [50.1, 50.3]
    assert (clock.other_apart_ns, clock.has_other_clock, clock.left_out) == (None, False, 1)


@given(st.lists(st.floats(0.0, 30.0), min_size=1, max_size=60))
def test_no_delay_of_an_orderly_link_is_a_reboot(delays_s):
    """A radio holds back what it has, for half a minute, and lets it out in order."""
    clock = BootClock()
    arrival_s, kept = 0.0, 0
    for k, delay_s in enumerate(delays_s):
        arrival_s = max(arrival_s, 0.2 * k + delay_s)
        boots, restarted = followed(clock, track(arrival_s, 10 + 0.2 * k))
        assert not restarted
        kept += len(boots)
    assert kept == len(delays_s)


def test_a_late_message_is_none_of_another_clock():
    clock = BootClock()
    assert followed(clock, track([5.0, 5.1, 5.2], [5.0, 3.5, 5.2]))[0] == pytest.approx([5.0, 3.5, 5.2])


def test_a_companions_time_is_not_taken_for_the_vehicles():
    clock = BootClock()
    followed(clock, track(0.0, 50.0))
    kept, _ = clock.follow((track([0.1, 0.2, 0.3], [50.1, 900.0, 50.3], SyncTrack),))
    assert [each.boot_ns.tolist() for each in kept] == [[50_100_000_000, 50_300_000_000]]
    assert clock.follow((track(0.4, 900.4, SyncTrack),)) == ((), False)


@given(st.lists(st.integers(1, 40), max_size=6), st.sampled_from([-50.0, 0.0, 700.0]))
def test_how_ticks_are_cut_does_not_matter(cuts, jump_s):
    at = steps(0, 5)
    boots = 100 + at + np.where(at > 2.0, jump_s, 0.0)
    whole, parts = BootClock(), BootClock()
    whole.follow((track(at, boots),))
    for part in np.split(np.arange(len(at)), sorted({min(cut, len(at) - 1) for cut in cuts})):
        parts.follow((track(at[part], boots[part]),)) if len(part) else None
    assert (whole.last_boot_ns, whole.restarts, whole.wraps) == (parts.last_boot_ns, parts.restarts, parts.wraps)


def test_a_clock_that_stands_still_is_dropped_until_it_goes_on():
    """Not for its first two seconds: what is late, or of the same millisecond, is no reason."""
    clock = BootClock()
    followed(clock, track(steps(0.0, 5.0), 100 + steps(0.0, 5.0)))
    stuck, restarted = followed(clock, track(steps(5.0, 20.0), 104.9))
    assert not restarted
    assert len(stuck) <= 20
    again, restarted = followed(clock, track(steps(20.0, 21.0), 100 + steps(20.0, 21.0)))
    assert not restarted
    assert len(again) == 10


def test_standing_still_is_found_however_the_rows_are_cut():
    arrivals, boots = steps(0.0, 12.0), np.minimum(100 + steps(0.0, 12.0), 105.0)
    whole, _ = followed(BootClock(), track(arrivals, boots))
    clock, cut = BootClock(), []
    for part in np.array_split(np.arange(len(arrivals)), 17):
        cut += followed(clock, track(arrivals[part], boots[part]))[0]
    assert cut == whole


def test_a_silent_link_does_not_stand_still():
    clock = BootClock()
    followed(clock, track(steps(0.0, 2.0), 100 + steps(0.0, 2.0)))
    again, restarted = followed(clock, track([9.0, 9.1], [109.0, 109.1]))
    assert (len(again), restarted) == (2, False)
