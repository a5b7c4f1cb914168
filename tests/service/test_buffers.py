"""The sliding window against a plain list that does the same."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from aerodft.service.buffers import TrackBuffer

CHUNKS = st.lists(st.lists(st.integers(0, 3000), max_size=12), max_size=25)


def filled(chunks, window_ns):
    buffer = TrackBuffer(window_ns)
    for chunk in chunks:
        stamps = np.array(chunk, dtype=np.int64)
        buffer.append(stamps, value=stamps * 2.0, wxyz=np.repeat(stamps[:, None], 4, axis=1) * 1.0)
    return buffer


@given(CHUNKS, st.integers(1, 4000))
def test_it_keeps_what_a_list_would_keep(chunks, window_ns):
    expected: list[int] = []
    dropped = 0
    for chunk in chunks:
        kept_any = False
        for stamp in chunk:
            if not expected or stamp > expected[-1]:
                expected.append(stamp)
                kept_any = True
            else:
                dropped += 1
        if kept_any:
            expected = [stamp for stamp in expected if stamp >= expected[-1] - window_ns]
    buffer = filled(chunks, window_ns)
    assert len(buffer) == len(expected)
    assert buffer.stamps_ns.tolist() == expected
    assert buffer.out_of_order == dropped
    if expected:
        np.testing.assert_array_equal(buffer.column("value"), np.array(expected) * 2.0)
        np.testing.assert_array_equal(buffer.column("wxyz"), np.repeat(np.array(expected)[:, None], 4, axis=1))


@given(st.lists(st.integers(0, 10_000), max_size=60, unique=True), st.lists(st.integers(1, 7), min_size=1))
def test_it_does_not_matter_how_rows_are_cut(stamps, sizes):
    stamps.sort()
    chunks, at = [], 0
    while at < len(stamps):
        size = sizes[len(chunks) % len(sizes)]
        chunks.append(stamps[at : at + size])
        at += size
    whole, cut = filled([stamps], 500), filled(chunks, 500)
    assert whole.stamps_ns.tolist() == cut.stamps_ns.tolist()


def test_after_clear_older_stamps_are_welcome_again():
    buffer = filled([[100, 200]], 1000)
    buffer.clear()
    assert len(buffer) == 0
    buffer.append(np.array([50]), value=np.array([7.0]), wxyz=np.zeros((1, 4)))
    assert buffer.stamps_ns.tolist() == [50]
    assert buffer.column("value").tolist() == [7.0]


def test_memory_stays_near_what_the_window_holds():
    buffer = TrackBuffer(100)
    for start in range(0, 200_000, 10):
        stamps = np.arange(start, start + 10)
        buffer.append(stamps, value=stamps * 1.0)
    assert len(buffer) == 101
    assert len(buffer.column("value").base) < 1000
