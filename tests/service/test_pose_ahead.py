"""What is prepared for many stamps at once is what is found for one after the other, to the last bit."""

import numpy as np
import pytest

from aerodft.geometry.interpolation import bracket, brackets
from aerodft.service.pose_ahead import by_tick
from aerodft.service.streams import Missing, Stream

SAMPLES_NS = np.cumsum(np.random.default_rng(3).integers(1, 400_000_000, 200))
VALUES = np.random.default_rng(4).normal(size=200)


def test_many_brackets_are_the_single_ones() -> None:
    asked = np.concatenate([SAMPLES_NS[::7], np.random.default_rng(5).integers(-10, SAMPLES_NS[-1] + 10, 500)])
    found = brackets(SAMPLES_NS, asked, 300_000_000)
    values = found.linear(VALUES)
    known = 0
    for row, stamp_ns in enumerate(asked.tolist()):
        single = bracket(SAMPLES_NS, stamp_ns, 300_000_000)
        assert found.is_known[row] == (single is not None)
        if single is not None:
            known += 1
            assert (found.before[row], found.after[row], found.weight[row], found.gap_ns[row]) == (
                single.before,
                single.after,
                single.weight,
                single.gap_ns,
            )
            assert values[row] == single.linear(VALUES)
    assert 100 < known < len(asked)  # both kinds were asked for


@pytest.mark.parametrize("asked_ns", [0, 5])
def test_nothing_is_found_among_no_samples(asked_ns: int) -> None:
    assert not brackets(np.empty(0, dtype=np.int64), np.array([asked_ns]), 10).is_known.any()


def test_a_stream_looks_at_no_sample_that_had_not_come() -> None:
    stream, edges = Stream(10**9), np.array([50, 120, 200])
    stream.append(SAMPLES_NS, edges, value=VALUES)
    rng = np.random.default_rng(6)
    stamps_ns, ticks = rng.integers(0, SAMPLES_NS[-1], 600), rng.integers(0, 3, 600)
    found, newest = stream.find_all(stamps_ns, ticks), stream.last_before(stamps_ns, ticks)
    ages_s = stream.ages_s(stamps_ns, found)
    pending = 0
    for row, (stamp_ns, tick) in enumerate(zip(stamps_ns.tolist(), ticks.tolist(), strict=True)):
        stream.see(tick)
        single = stream.find(stamp_ns, 0)
        assert found.is_known[row] == (not isinstance(single, Missing))
        pending += single is Missing.PENDING
        if not isinstance(single, Missing):
            assert found.linear(stream.all_of("value"))[row] == single.linear(stream.column("value"))
            assert ages_s[row] == stream.age_s(stamp_ns)
        assert newest[row] == np.searchsorted(stream.stamps_ns, stamp_ns, side="right") - 1
    assert pending > 50


def test_what_is_asked_for_waits_for_the_slowest_stream_and_for_its_own_tick() -> None:
    newest = [np.array([10, 20, 30]), np.array([5, 25, 26])]
    asked = np.array([[4, 0], [8, 0], [26, 0], [4, 2], [27, 0]])
    assert by_tick(asked, [*newest, np.empty(0)]).tolist() == [[0, 4], [1, 8], [2, 26], [2, 4]]
    assert not len(by_tick(asked, [np.empty(0)]))
