"""The clock map against clocks whose offsets are known: UTC, this machine's, and the vehicle's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.model.telemetry import NO_BOOT_TIME, ClockTrack, Track
from aerodft.service.timing import JUMP_NS, ClockChange, ClockMap

MS, SECOND = 1_000_000, 1_000_000_000
UTC0 = 1_795_221_168 * SECOND  # UTC at power-on
HOST0 = UTC0 + 1_300 * MS  # this machine's clock at the same moment
LINK = 20 * MS  # the fastest way from vehicle to machine


def track(boot_ns, arrival_ns):
    return Track(arrival_ns=np.atleast_1d(arrival_ns), boot_ns=np.atleast_1d(boot_ns))


def sent(boot_ns, delay_ns=LINK):
    """A stamped message that took ``delay_ns`` to arrive."""
    return track(boot_ns, HOST0 + boot_ns + delay_ns)


def system_time(boot_ns, utc_at_boot_ns=UTC0, delay_ns=LINK):
    return ClockTrack(
        arrival_ns=np.array([HOST0 + boot_ns + delay_ns]),
        boot_ns=np.array([boot_ns]),
        unix_ns=np.array([utc_at_boot_ns + boot_ns]),
    )


def told(*utc_at_boot_ns):
    """A map that was told these offsets, one a second, and the changes after the first, which ends arrival times."""
    clock = ClockMap()
    changes = [clock.update((system_time(k * SECOND, utc),)) for k, utc in enumerate(utc_at_boot_ns)]
    return clock, changes[1:]


def test_system_time_gives_utc_whatever_the_link_delays():
    clock, _ = told(UTC0)
    stamps = clock.to_utc(track([2 * SECOND, 3 * SECOND], [HOST0 + 2 * SECOND, HOST0 + 9 * SECOND]))
    np.testing.assert_array_equal(stamps, [UTC0 + 2 * SECOND, UTC0 + 3 * SECOND])


def test_whole_milliseconds_of_boot_time_average_out():
    rng = np.random.default_rng(3)
    clock, changes = told(*(UTC0 + rng.integers(0, MS, 60)).tolist())
    assert set(changes) == {ClockChange.NONE}
    assert abs(clock.utc_minus_boot_ns - (UTC0 + MS // 2)) < MS // 5


def test_without_system_time_the_fastest_message_says_what_time_it_is():
    clock = ClockMap()
    assert (clock.host_minus_boot_ns, clock.utc_minus_host_ns) == (None, 0)
    clock.update((sent(SECOND, 900 * MS),))
    clock.update((sent(2 * SECOND, LINK),))
    clock.update((sent(3 * SECOND, 400 * MS),))
    assert clock.host_minus_boot_ns == HOST0 + LINK
    np.testing.assert_array_equal(clock.to_utc(sent(3 * SECOND, 400 * MS)), [HOST0 + 3 * SECOND + LINK])
    assert clock.utc_minus_host_ns == 0


def test_the_fastest_message_is_forgotten_after_a_while():
    clock = ClockMap()
    clock.update((sent(SECOND, LINK),))
    for second in range(2, 15):
        clock.update((sent(second * SECOND, 300 * MS),))
    assert clock.host_minus_boot_ns == HOST0 + 300 * MS


def test_host_stamps_are_mapped_with_the_fastest_message():
    clock, _ = told(UTC0)
    clock.update((sent(2 * SECOND, 5 * SECOND),))
    host_ns = HOST0 + 7 * SECOND
    assert host_ns + clock.utc_minus_host_ns == UTC0 + 7 * SECOND - LINK


@pytest.mark.parametrize("strangers", [1, 2])
def test_a_jump_is_not_believed_at_once(strangers):
    clock, changes = told(*[UTC0] * 5, *[UTC0 + SECOND] * strangers, UTC0)
    assert set(changes) == {ClockChange.NONE}
    assert clock.utc_minus_boot_ns == UTC0


def test_a_jump_is_believed_when_three_say_it():
    clock, changes = told(*[UTC0] * 5, *[UTC0 + SECOND] * 3)
    assert changes == [ClockChange.NONE] * 6 + [ClockChange.JUMPED]
    assert clock.utc_minus_boot_ns == UTC0 + SECOND


def test_three_strangers_that_do_not_agree_are_not_believed():
    wild = [UTC0 + SECOND, UTC0 - 40 * SECOND, UTC0 + 300 * SECOND, UTC0 - 7 * SECOND]
    clock, changes = told(*[UTC0] * 5, *wild)
    assert set(changes) == {ClockChange.NONE}
    assert clock.utc_minus_boot_ns == UTC0


def test_a_small_correction_is_no_jump():
    clock, changes = told(*[UTC0] * 5, *[UTC0 + JUMP_NS] * 60)
    assert set(changes) == {ClockChange.NONE}
    assert clock.utc_minus_boot_ns == UTC0 + JUMP_NS


def test_the_first_utc_after_arrival_times_is_a_jump_where_the_clocks_differ():
    clock = ClockMap()
    clock.update((sent(SECOND),))
    assert clock.update((system_time(2 * SECOND),)) is ClockChange.JUMPED
    assert clock.utc_minus_host_ns == UTC0 - HOST0 - LINK


def test_a_reboot_forgets_and_learns_anew():
    clock, _ = told(*[UTC0] * 5)
    later_ns = 100 * SECOND  # the vehicle's second power-on
    rebooted = track([SECOND], [HOST0 + later_ns + SECOND + LINK])
    assert clock.update((rebooted,)) is ClockChange.JUMPED
    assert clock.utc_minus_boot_ns is None
    np.testing.assert_array_equal(clock.to_utc(rebooted), rebooted.arrival_ns)
    anew = ClockTrack(
        arrival_ns=np.array([HOST0 + later_ns + 2 * SECOND + LINK]),
        boot_ns=np.array([2 * SECOND]),
        unix_ns=np.array([UTC0 + later_ns + 2 * SECOND]),
    )
    clock.update((anew,))
    np.testing.assert_array_equal(clock.to_utc(rebooted), [UTC0 + later_ns + SECOND])


def test_a_late_message_is_no_reboot():
    clock, _ = told(UTC0)
    clock.update((sent(5 * SECOND),))
    assert clock.update((sent(4 * SECOND, 2 * SECOND),)) is ClockChange.NONE
    assert clock.utc_minus_boot_ns == UTC0


def test_an_unstamped_message_takes_the_time_of_the_stamped_one_before_it():
    """Over a radio that holds everything back for two seconds, the delay is not in the stamp."""
    clock, _ = told(UTC0)
    arrival_ns = HOST0 + 10 * SECOND + 2 * SECOND
    stamped = track([10 * SECOND], [arrival_ns])
    bare = track([NO_BOOT_TIME, NO_BOOT_TIME], [arrival_ns + 3 * MS, arrival_ns + 400 * MS])
    clock.update((stamped, bare))
    np.testing.assert_array_equal(clock.to_utc(bare), [UTC0 + 10 * SECOND] * 2)


def test_an_anchor_of_the_tick_before_serves_too():
    clock, _ = told(UTC0)
    clock.update((sent(10 * SECOND, 2 * SECOND),))
    bare = track([NO_BOOT_TIME], [HOST0 + 12 * SECOND + 60 * MS])
    clock.update((bare,))
    np.testing.assert_array_equal(clock.to_utc(bare), [UTC0 + 10 * SECOND])


def test_without_an_anchor_near_an_unstamped_message_is_stamped_by_its_arrival():
    clock, _ = told(UTC0)
    bare = track([NO_BOOT_TIME], [HOST0 + 3 * SECOND + LINK])
    clock.update((bare,))
    np.testing.assert_array_equal(clock.to_utc(bare), [UTC0 + 3 * SECOND])


def test_before_anything_is_known_arrival_is_all_there_is():
    bare = track([NO_BOOT_TIME], [HOST0])
    clock = ClockMap()
    assert clock.update((bare,)) is ClockChange.NONE
    np.testing.assert_array_equal(clock.to_utc(bare), bare.arrival_ns)


@given(st.lists(st.integers(0, 3 * SECOND), min_size=1, max_size=30), st.integers(0, 29))
def test_stamps_do_not_depend_on_delays_once_utc_is_known(delays_ns, learnt_at):
    clock = ClockMap()
    stamps = []
    for k, delay_ns in enumerate(delays_ns):
        boot_ns = (k + 1) * 100 * MS
        message = sent(boot_ns, delay_ns)
        clock.update((message, system_time(boot_ns, delay_ns=delay_ns)) if k >= learnt_at else (message,))
        stamps.append(int(clock.to_utc(message)[0]))
    known = stamps[learnt_at:]
    assert known == [UTC0 + (k + 1) * 100 * MS for k in range(learnt_at, len(delays_ns))][: len(known)]
