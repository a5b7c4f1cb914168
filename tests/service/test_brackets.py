import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.service.streams import brackets

STAMPS = np.array([0, 100, 200, 1200], dtype=np.int64)


def at(stamp, max_gap):
    return brackets(STAMPS, np.array([stamp]), max_gap)


@pytest.mark.parametrize("stamp", [-1, 1201])
def test_nothing_outside(stamp):
    assert at(stamp, 10_000).is_known.tolist() == [False]


def test_nothing_across_a_gap():
    assert at(700, 999).is_known.tolist() == [False]
    assert at(700, 1000).is_known.tolist() == [True]


def test_a_sample_itself_needs_no_neighbour():
    found = at(1200, 10)
    assert found.is_known.tolist() == [True]
    assert found.linear(np.array([1.0, 2.0, 3.0, 4.0])).tolist() == [4.0]


def test_linear_between():
    assert at(125, 1000).linear(np.array([0.0, 1, 2, 0])).tolist() == [1.25]


def test_empty():
    assert brackets(np.empty(0, dtype=np.int64), np.array([0, 5]), 10).is_known.tolist() == [False, False]


@given(
    st.lists(st.integers(0, 60), max_size=25, unique=True),
    st.lists(st.tuples(st.integers(-3, 63), st.integers(0, 25), st.integers(0, 25)), min_size=1, max_size=30),
    st.integers(0, 20),
)
def test_only_samples_that_count_are_looked_at(samples, asked, max_gap):
    """Each stamp has samples of its own that count, one after the other; against a search through these."""
    samples.sort()
    ends = [sorted((min(first, len(samples)), min(end, len(samples)))) for _, first, end in asked]
    stamps, seen = np.array([stamp for stamp, _, _ in asked]), np.array(ends).T
    found = brackets(np.array(samples, dtype=np.int64), stamps, max_gap, (seen[0], seen[1]))
    for row, (stamp, (first, end)) in enumerate(zip(stamps.tolist(), ends, strict=True)):
        before = [k for k in range(first, end) if samples[k] <= stamp]
        after = [k for k in range(first, end) if samples[k] >= stamp]
        is_known = bool(before) and bool(after) and samples[after[0]] - samples[before[-1]] <= max_gap
        assert found.is_known[row] == is_known
        if is_known:
            gap = samples[after[0]] - samples[before[-1]]
            assert (found.before[row], found.after[row], found.gap_ns[row]) == (before[-1], after[0], gap)
            assert found.weight[row] == ((stamp - samples[before[-1]]) / gap if gap else 0.0)
