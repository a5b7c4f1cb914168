"""What a stream keeps, when it has a value at a stamp, when it waits, and why it has none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.service import LAST
from aerodft.service.streams import END_OF_TIME, HISTORY_NS, Missing, Query, Stream

GAP = 1000
CHUNKS = st.lists(st.lists(st.integers(0, 3000), max_size=12), max_size=25)


def stream_of(*stamps):
    return filled([stamps])


def filled(chunks, scale=1, gap=GAP):
    """Chunks of stamps, a step of one tick each."""
    stream = Stream(gap)
    for chunk in chunks:
        stream.commit()
        append(stream, scale * np.array(chunk, dtype=np.int64))
    return stream


def append(stream, stamps, row_end_by_tick=None):
    stream.append(stamps, row_end_by_tick, value=stamps * 0.5, wxyz=np.repeat(stamps[:, None], 4, axis=1) * 1.0)


def why(stream, stamp, watermark):
    """Why there is no value, as of the last tick."""
    found, missing = stream.find(Query(np.array([stamp]), LAST, np.array([watermark])))
    assert found.is_known.tolist() == [missing[0] == Missing.NOTHING]
    return Missing(missing[0])


@given(CHUNKS)
def test_it_keeps_what_a_list_would_keep(chunks):
    """Against a plain list that does the same; a sixtieth of the history is the unit of the stamps."""
    unit = HISTORY_NS // 60
    expected: list[int] = []
    dropped = 0
    for chunk in chunks:
        before = len(expected), dropped
        for stamp in chunk:
            if not expected or stamp > expected[-1]:
                expected.append(stamp)
            else:
                dropped += 1
        if (len(expected), dropped) != before:
            expected = [stamp for stamp in expected if stamp >= expected[-1] - 60]
    stream = filled(chunks, unit)
    assert stream.is_empty == (not expected)
    assert stream.stamps_ns.tolist() == [unit * stamp for stamp in expected]
    assert stream.out_of_order == dropped
    assert stream.began_by(np.array([END_OF_TIME]))[0] == any(chunks)
    if expected:
        assert stream.last_ns == unit * expected[-1]
        stamps = unit * np.array(expected)
        np.testing.assert_array_equal(stream.column("value"), stamps * 0.5)
        np.testing.assert_array_equal(stream.column("wxyz"), np.repeat(stamps[:, None], 4, axis=1))


@given(st.lists(st.lists(st.integers(0, 300), max_size=8), min_size=1, max_size=12), st.data())
def test_it_does_not_matter_how_ticks_are_put_into_steps(ticks, data):
    """As of each tick there is the same to be found, whichever ticks were taken in with it."""
    unit = HISTORY_NS // 100
    alone, together = Stream(7 * unit), Stream(7 * unit)
    tick = 0
    while tick < len(ticks):
        stop = tick + data.draw(st.integers(1, len(ticks) - tick))
        rows = unit * np.array([stamp for own in ticks[tick:stop] for stamp in own], dtype=np.int64)
        has_begun = together.began_by(np.array([END_OF_TIME]))[0]
        together.commit()
        append(together, rows, np.cumsum([len(own) for own in ticks[tick:stop]]))
        for number in range(stop - tick):
            alone.commit()
            append(alone, unit * np.array(ticks[tick + number], dtype=np.int64))
            asked = unit * np.arange(-1, 302)
            same = np.full(len(asked), number)
            newest = np.maximum(together.newest_ns(same), 0)
            found, missing = together.find(Query(asked, same, newest))
            own, own_missing = alone.find(Query(asked, LAST.repeat(len(asked)), newest))
            assert newest[0] == alone.newest_ns(LAST)[0]
            if has_begun:  # what begins is taken in on a tick of its own
                np.testing.assert_array_equal(missing, own_missing)
            np.testing.assert_array_equal(found.is_known, own.is_known)
            if alone.is_empty:
                continue
            known = found.is_known
            np.testing.assert_array_equal(
                found.linear(together.column("value"))[known], own.linear(alone.column("value"))[known]
            )
            np.testing.assert_array_equal(together.ages_s(asked, found)[known], alone.ages_s(asked, own)[known])
            last, own_last = together.last_before(asked, same), alone.last_before(asked, LAST.repeat(len(asked)))
            np.testing.assert_array_equal(last >= 0, own_last >= 0)
            at = last >= 0
            np.testing.assert_array_equal(together.stamps_ns[last[at]], alone.stamps_ns[own_last[at]])
        tick = stop
    assert together.out_of_order == alone.out_of_order


def test_after_clear_older_stamps_are_welcome_again():
    stream = stream_of(100, 200)
    stream.clear()
    assert stream.is_empty
    append(stream, np.array([50]))
    assert stream.stamps_ns.tolist() == [50]
    assert stream.column("value").tolist() == [25.0]


def test_memory_stays_near_what_the_history_holds():
    stream = filled([range(start, start + 10) for start in range(0, 20_000, 10)], HISTORY_NS // 100)
    assert len(stream.stamps_ns) == 101
    assert len(stream.column("value").base) < 1000


def test_between_two_samples_there_is_a_value():
    stream = stream_of(1000, 1400)
    found, missing = stream.find(Query(np.array([1100]), LAST, np.array([1400])))
    assert (missing.tolist(), found.is_known.tolist()) == ([Missing.NOTHING], [True])
    numbers = found.before, found.after, found.weight, found.gap_ns
    assert [each.tolist() for each in numbers] == [[0], [1], [0.25], [400]]
    assert found.linear(stream.column("value")).tolist() == [550.0]


@pytest.mark.parametrize(
    ("stamp", "watermark", "expected"),
    [
        (2500, 2500, Missing.PENDING),  # the next sample may still come
        (2500, 3000, Missing.PENDING),
        (2500, 3001, Missing.STALE),  # the stream has been silent for longer than may be interpolated over
        (2500, END_OF_TIME, Missing.STALE),
        (1500, 2000, Missing.STALE),  # in a gap between two samples that is too long
        (900, 2000, Missing.NEVER),  # before the first sample there was none
    ],
)
def test_why_there_is_no_value(stamp, watermark, expected):
    stream = stream_of(1000, 2000) if stamp > 2000 else stream_of(1000, 2001)
    assert why(stream, stamp, watermark) is expected


def test_a_stream_without_samples_is_waited_for_until_others_have_passed_the_stamp():
    stream = Stream(GAP)
    assert why(stream, 500, 499) is Missing.PENDING
    assert why(stream, 500, 500) is Missing.NEVER
    assert (stream.last_ns, stream.began_by(np.array([500])).tolist()) == (None, [False])


def test_what_was_forgotten_is_stale_not_never():
    stream = stream_of(5000, 5100)
    stream.clear()
    assert stream.last_ns is None
    assert why(stream, 100, END_OF_TIME) is Missing.STALE
    append(stream, np.array([300]))
    assert why(stream, 100, END_OF_TIME) is Missing.STALE


def test_clearing_a_stream_that_never_had_samples_changes_nothing():
    stream = Stream(GAP)
    stream.clear()
    assert why(stream, 100, END_OF_TIME) is Missing.NEVER


def test_age_is_the_distance_to_the_nearer_sample():
    stream = filled([[1_000_000_000, 1_400_000_000]], gap=10**9)
    stamps = np.array([1_000_000_000, 1_100_000_000, 1_350_000_000])
    found, _ = stream.find(Query.final(stamps, LAST.repeat(3)))
    assert stream.ages_s(stamps, found) == pytest.approx([0.0, 0.1, 0.05])


@given(st.lists(st.integers(0, 20_000), min_size=1, max_size=30, unique=True), st.integers(0, 22_000))
def test_what_was_found_stays_whatever_comes_later(stamps, stamp):
    """An answer given early is the answer given late: what a live run and a recomputation share."""
    stamps.sort()
    answers = []
    stream = Stream(GAP)
    for value in stamps:
        stream.commit()
        append(stream, np.array([value]))
        found, missing = stream.find(Query(np.array([stamp]), LAST, np.array([value])))
        if missing[0] != Missing.PENDING:
            is_known = missing[0] == Missing.NOTHING
            answers.append(float(stream.column("value")[found.after[0]]) if is_known else Missing(missing[0]))
    assert len(set(answers)) <= 1
