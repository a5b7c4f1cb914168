"""When a stream has a value at a stamp, when it waits, and why it has none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.geometry.interpolation import Bracket
from aerodft.service.streams import END_OF_TIME, Missing, Stream

GAP = 1000


def stream_of(*stamps):
    stream = Stream(GAP)
    rows = np.array(stamps, dtype=np.int64)
    stream.append(rows, value=rows * 0.5)
    return stream


def test_between_two_samples_there_is_a_value():
    stream = stream_of(1000, 1400)
    found = stream.find(1100, 1400)
    assert found == Bracket(0, 1, 0.25, 400)
    assert found.linear(stream.column("value")) == 550.0


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
    assert stream.find(stamp, watermark) is expected


def test_a_stream_without_samples_is_waited_for_until_others_have_passed_the_stamp():
    stream = Stream(GAP)
    assert stream.find(500, 499) is Missing.PENDING
    assert stream.find(500, 500) is Missing.NEVER
    assert (stream.last_ns, stream.age_s(500), stream.began_by(500)) == (None, None, False)


def test_what_was_forgotten_is_stale_not_never():
    stream = stream_of(5000, 5100)
    stream.clear()
    assert stream.last_ns is None
    assert stream.find(100, END_OF_TIME) is Missing.STALE
    stream.append(np.array([300]), value=np.array([1.0]))
    assert stream.find(100, END_OF_TIME) is Missing.STALE


def test_clearing_a_stream_that_never_had_samples_changes_nothing():
    stream = Stream(GAP)
    stream.clear()
    assert stream.find(100, END_OF_TIME) is Missing.NEVER


def test_age_is_the_distance_to_the_nearest_sample():
    stream = stream_of(1_000_000_000, 1_400_000_000)
    for stamp, age_s in ((1_000_000_000, 0.0), (1_100_000_000, 0.1), (1_350_000_000, 0.05), (2_400_000_000, 1.0)):
        assert stream.age_s(stamp) == pytest.approx(age_s)


@given(st.lists(st.integers(0, 20_000), min_size=1, max_size=30, unique=True), st.integers(0, 22_000))
def test_what_was_found_stays_whatever_comes_later(stamps, stamp):
    """An answer given early is the answer given late: what a live run and a recomputation share."""
    stamps.sort()
    answers = []
    stream = Stream(GAP)
    for value in stamps:
        stream.append(np.array([value]), value=np.array([value * 1.0]))
        found = stream.find(stamp, value)
        if found is not Missing.PENDING:
            answers.append((stream.column("value")[found.after]) if isinstance(found, Bracket) else found)
    assert len(set(answers)) <= 1
