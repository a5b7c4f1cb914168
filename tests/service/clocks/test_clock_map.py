"""The clock map against clocks whose offsets are known: UTC, this machine's, and the vehicle's."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.model import NO_BOOT_TIME, ClockTrack, Track
from aerodft.service import LAST
from aerodft.service.clocks import JUMP_NS, ClockMap, Ticks
from aerodft.service.clocks.stated_offset import ClockOffset, StatedOffset
from aerodft.service.clocks.tracks_by_tick import OffsetsByTick

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


def to_utc(clock, track):
    """Stamps by what is known now."""
    return clock.to_utc(track, LAST)


def host_to_utc(clock, host_ns):
    return int(clock.host_to_utc(np.array([host_ns]))[0])


def utc_minus_boot_ns(clock, boot_ns=200 * SECOND):
    return int(to_utc(clock, sent(boot_ns))[0]) - boot_ns


def told(*utc_at_boot_ns):
    """A map that was told these offsets, one a second, and the shifts after the first, which ends arrival times."""
    clock = ClockMap()
    shifts = [clock.update(Ticks.one((system_time(k * SECOND, utc),))).shift_ns for k, utc in enumerate(utc_at_boot_ns)]
    return clock, shifts[1:]


def test_system_time_gives_utc_whatever_the_link_delays():
    clock, _ = told(UTC0)
    stamps = to_utc(clock, track([2 * SECOND, 3 * SECOND], [HOST0 + 2 * SECOND, HOST0 + 9 * SECOND]))
    np.testing.assert_array_equal(stamps, [UTC0 + 2 * SECOND, UTC0 + 3 * SECOND])


def test_whole_milliseconds_of_boot_time_average_out():
    rng = np.random.default_rng(3)
    clock, shifts = told(*(UTC0 + rng.integers(0, MS, 64)).tolist())
    assert set(shifts) == {0}
    assert abs(utc_minus_boot_ns(clock) - (UTC0 + MS // 2)) < MS // 5


def test_without_system_time_the_fastest_message_says_what_time_it_is():
    clock = ClockMap()
    assert not clock.is_utc_known
    clock.update(Ticks.one((sent(SECOND, 900 * MS),)))
    clock.update(Ticks.one((sent(2 * SECOND, LINK),)))
    clock.update(Ticks.one((sent(3 * SECOND, 400 * MS),)))
    np.testing.assert_array_equal(to_utc(clock, sent(3 * SECOND, 400 * MS)), [HOST0 + 3 * SECOND + LINK])
    assert host_to_utc(clock, HOST0) == HOST0


def test_a_link_that_is_busy_for_a_while_does_not_move_the_clock():
    rng = np.random.default_rng(5)
    clock = ClockMap()
    for second in range(1, 31):
        busy_ms = rng.uniform(100, 900) if 10 <= second < 20 else 0.0
        clock.update(Ticks.one((sent(second * SECOND, LINK + round(busy_ms * MS)),)))
    assert utc_minus_boot_ns(clock) == HOST0 + LINK


@pytest.mark.parametrize("step_ms", [-700, 300])
def test_a_step_of_this_machines_clock_is_found(step_ms):
    """Backwards at once, forwards when for ten seconds nothing was as fast as before."""
    clock, _ = told(*[UTC0] * 30)
    for second in range(30, 42):
        clock.update(Ticks.one((sent(second * SECOND, LINK + step_ms * MS),)))
    host_ns = HOST0 + 42 * SECOND + step_ms * MS
    assert host_to_utc(clock, host_ns + LINK) == pytest.approx(UTC0 + 42 * SECOND, abs=MS)


@pytest.mark.parametrize("step_ms", [150, 500, 3000])
def test_until_a_step_of_this_machines_clock_is_believed_its_stamps_are_unsettled(step_ms):
    clock, _ = told(*[UTC0] * 30)
    off_ns, waits = [], []
    for tenth in range(300, 420):
        boot_ns = tenth * SECOND // 10
        clock.update(Ticks.one((sent(boot_ns, LINK + (step_ms + tenth % 4) * MS),)))
        off_ns.append(abs(host_to_utc(clock, HOST0 + boot_ns + LINK + step_ms * MS) - UTC0 - boot_ns))
        waits.append(clock.unsettled(by_utc=False))
        assert clock.unsettled(by_utc=True) is None  # the vehicle's UTC did not jump
    assert waits[:5] == [None] * 5  # a receiver that is held up
    said_s = float(re.search(r"arrives ([\d.]+) s later than before", waits[5])[1])
    assert said_s == pytest.approx(step_ms / 1000, abs=0.06)
    wrong = np.array(off_ns) > 10 * MS
    np.testing.assert_array_equal([wait is not None for wait in waits[5:]], wrong[5:])
    assert np.count_nonzero(wrong) in range(50, 101)


def test_a_link_that_is_slow_for_some_and_not_for_others_leaves_this_machines_clock_alone():
    rng = np.random.default_rng(7)
    clock, _ = told(*[UTC0] * 30)
    waits = []
    for second in range(30, 40):
        boots = second * SECOND + np.arange(10) * SECOND // 10
        clock.update(Ticks.one((track(boots, HOST0 + boots + LINK + rng.integers(110, 900, 10) * MS),)))
        waits.append(clock.unsettled(by_utc=False) is not None)
    assert sum(waits) <= 1
    clock.update(Ticks.one((sent(41 * SECOND),)))
    assert clock.unsettled(by_utc=False) is None
    assert abs(host_to_utc(clock, HOST0 + 41 * SECOND + LINK) - UTC0 - 41 * SECOND) < MS


def test_before_utc_is_known_a_step_leaves_all_stamps_unsettled():
    clock = ClockMap()
    for second in range(1, 21):
        clock.update(Ticks.one((sent(second * SECOND),)))
    assert (clock.unsettled(by_utc=False), clock.unsettled(by_utc=True)) == (None, None)
    for tenth in range(6):
        clock.update(Ticks.one((sent(21 * SECOND + tenth * 100 * MS, LINK + SECOND),)))
    for by_utc in (False, True):
        assert "arrives 1.0 s later" in clock.unsettled(by_utc=by_utc)


def test_host_stamps_are_mapped_with_the_fastest_message():
    clock, _ = told(UTC0)
    clock.update(Ticks.one((sent(2 * SECOND, 5 * SECOND),)))
    assert host_to_utc(clock, HOST0 + 7 * SECOND) == UTC0 + 7 * SECOND - LINK


@pytest.mark.parametrize("strangers", [1, 2])
def test_a_jump_is_not_believed_at_once(strangers):
    clock, shifts = told(*[UTC0] * 5, *[UTC0 + SECOND] * strangers, UTC0)
    assert set(shifts) == {0}
    assert utc_minus_boot_ns(clock) == UTC0


def test_a_jump_is_believed_when_three_say_it():
    clock, shifts = told(*[UTC0] * 5, *[UTC0 + SECOND] * 3)
    assert shifts == [0] * 6 + [SECOND]
    assert utc_minus_boot_ns(clock) == UTC0 + SECOND


def test_three_strangers_that_do_not_agree_are_not_believed():
    wild = [UTC0 + SECOND, UTC0 - 40 * SECOND, UTC0 + 300 * SECOND, UTC0 - 7 * SECOND]
    clock, shifts = told(*[UTC0] * 5, *wild)
    assert set(shifts) == {0}
    assert utc_minus_boot_ns(clock) == UTC0


def test_a_small_correction_is_no_jump():
    clock, shifts = told(*[UTC0] * 5, *[UTC0 + JUMP_NS] * 128)
    assert set(shifts) == {0}
    assert utc_minus_boot_ns(clock) == pytest.approx(UTC0 + JUMP_NS, abs=MS)


def test_until_a_jump_is_believed_it_is_said():
    clock, _ = told(*[UTC0] * 5, *[UTC0 + 2 * SECOND] * 2)
    assert clock.unsettled(by_utc=True) == "the vehicle's UTC jumped by +2.000 s, and has not settled yet"
    clock.update(Ticks.one((system_time(8 * SECOND, UTC0 + 2 * SECOND),)))
    assert clock.unsettled(by_utc=True) is None
    assert clock.health.jumps_s == (2.0,)


def test_the_first_utc_moves_what_was_stamped_by_arrival():
    clock = ClockMap()
    clock.update(Ticks.one((sent(SECOND),)))
    heard = clock.update(Ticks.one((system_time(2 * SECOND),)))
    assert heard.shift_ns == heard.host_shift_ns == UTC0 - HOST0 - LINK
    assert host_to_utc(clock, HOST0 + LINK) == UTC0


def test_an_unstamped_message_takes_the_time_of_the_stamped_one_before_it():
    """Over a radio that holds everything back for two seconds, the delay is not in the stamp."""
    clock, _ = told(UTC0)
    arrival_ns = HOST0 + 10 * SECOND + 2 * SECOND
    stamped = track([10 * SECOND], [arrival_ns])
    bare = track([NO_BOOT_TIME, NO_BOOT_TIME], [arrival_ns + 3 * MS, arrival_ns + 400 * MS])
    stamped, bare = clock.update(Ticks.one((stamped, bare))).ticks.tracks
    np.testing.assert_array_equal(to_utc(clock, bare), [UTC0 + 10 * SECOND] * 2)


def test_an_anchor_of_the_tick_before_serves_too():
    clock, _ = told(UTC0)
    clock.update(Ticks.one((sent(10 * SECOND, 2 * SECOND),)))
    bare = track([NO_BOOT_TIME], [HOST0 + 12 * SECOND + 60 * MS])
    (bare,) = clock.update(Ticks.one((bare,))).ticks.tracks
    np.testing.assert_array_equal(to_utc(clock, bare), [UTC0 + 10 * SECOND])


def test_without_an_anchor_near_an_unstamped_message_is_stamped_by_its_arrival():
    clock, _ = told(UTC0)
    bare = track([NO_BOOT_TIME], [HOST0 + 3 * SECOND + LINK])
    clock.update(Ticks.one((bare,)))
    np.testing.assert_array_equal(to_utc(clock, bare), [UTC0 + 3 * SECOND])


def test_before_anything_is_known_arrival_is_all_there_is():
    bare = track([NO_BOOT_TIME], [HOST0])
    clock = ClockMap()
    assert not clock.update(Ticks.one((bare,))).restarted
    np.testing.assert_array_equal(to_utc(clock, bare), bare.arrival_ns)


@given(st.lists(st.integers(0, 3 * SECOND), min_size=1, max_size=30), st.integers(0, 29))
def test_stamps_do_not_depend_on_delays_once_utc_is_known(delays_ns, learnt_at):
    clock = ClockMap()
    stamps = []
    for k, delay_ns in enumerate(delays_ns):
        boot_ns = (k + 1) * 100 * MS
        message = sent(boot_ns, delay_ns)
        said = (system_time(boot_ns, delay_ns=delay_ns),) if k >= learnt_at else ()
        clock.update(Ticks.one((message, *said)))
        stamps.append(int(to_utc(clock, message)[0]))
    known = stamps[learnt_at:]
    assert known == [UTC0 + (k + 1) * 100 * MS for k in range(learnt_at, len(delays_ns))][: len(known)]


def test_what_a_jump_ahead_never_said_is_known():
    ahead, back = StatedOffset(), StatedOffset()
    for second in range(40):
        for line, jump_s in ((ahead, 5), (back, -5)):
            line.learn(second * SECOND, (jump_s if second >= 30 else 0) * SECOND)
    assert (ahead.jumps_ns, ahead.skipped_ns) == ([5 * SECOND], [(29 * SECOND, 35 * SECOND)])
    assert ahead.copy().skipped_ns == ahead.skipped_ns
    assert (back.jumps_ns, back.skipped_ns) == ([-5 * SECOND], [])
    # Three samples confirm it; until then it is still taken for what it was.
    assert (back.repeated_ns, ahead.repeated_ns) == ([(25 * SECOND, 32 * SECOND)], [])
    assert back.copy().repeated_ns == back.repeated_ns


def test_lines_of_many_ticks_are_each_as_it_is_alone():
    rng = np.random.default_rng(6)
    lines = [ClockOffset(UTC0 + k * SECOND, HOST0 - UTC0 + k * MS, 1e-5 * k) for k in range(4)]
    table = OffsetsByTick.from_lines(lines, [3, 3, 8], 12)
    own_ns, ticks = UTC0 + rng.integers(0, 100 * SECOND, 60), rng.integers(0, 12, 60)
    wanted = [lines[0 if tick < 3 else 2 if tick < 8 else 3] for tick in ticks.tolist()]
    offsets = [line.offset_at(each) for line, each in zip(wanted, own_ns.tolist(), strict=True)]
    assert table.offset(own_ns, ticks).tolist() == offsets
    assert [table.line(tick) for tick in ticks.tolist()] == wanted
    off_ns = np.abs(table.own(own_ns + offsets, ticks) - own_ns)
    assert off_ns.max() <= 3e-5**2 * 100 * SECOND, "the drift over what it gained itself"
