"""Times as people write them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.options import parse_instant, parse_utc
from aerodft.errors import UsageError

SECOND = 1_000_000_000
START = 1_795_221_168 * SECOND
STAMPS = st.integers(10**17, 9 * 10**18)


@given(STAMPS)
def test_nanoseconds_and_iso_text_are_exact(stamp_ns):
    assert parse_utc("--at", str(stamp_ns)) == stamp_ns
    assert parse_utc("--at", unix_ns_to_iso(stamp_ns)) == stamp_ns
    assert parse_instant("--at", unix_ns_to_iso(stamp_ns), START) == stamp_ns


@given(st.integers(10**8, 9 * 10**9), st.integers(0, SECOND - 1))
def test_unix_seconds_are_exact_to_the_nanosecond(seconds, nanoseconds):
    assert parse_utc("--at", f"{seconds}.{nanoseconds:09d}") == seconds * SECOND + nanoseconds
    assert parse_utc("--at", str(seconds)) == seconds * SECOND


@pytest.mark.parametrize(
    "text",
    [
        "2026-11-21T00:32:48Z",
        "2026-11-21 00:32:48Z",
        "2026-11-21T01:32:48+01:00",
        "1795221168",
        "1795221168.0",
        "1795221168000000000",
        "1.795221168e9",
        "1.795221168e18",
    ],
)
def test_many_ways_to_say_one_moment(text):
    assert parse_utc("--video-start", text) == START


@pytest.mark.parametrize(("text", "seconds"), [("0", 0), ("12.5", 12.5), ("-3", -3), ("1e3", 1000)])
def test_small_numbers_are_seconds_from_the_start(text, seconds):
    assert parse_instant("--at", text, START) == START + seconds * SECOND


@pytest.mark.parametrize(
    "text",
    [
        "",
        "tomorrow",
        "2026-11-21T00:32:48",
        "2026-11-21 00:32:48.5",
        "12:30",
        "2026-13-01T00:00:00Z",
        "1795221168868",
        "1795221168868833",
        "nan",
        "-1e9",
        "1e30",
        "0001-01-01T00:00:00Z",
        "1969-12-31T23:59:59Z",
    ],
)
def test_anything_else_is_refused_in_one_sentence(text):
    with pytest.raises(UsageError, match=r"^--at: got .*, expected ISO 8601 that ends with Z"):
        parse_instant("--at", text, START)


@pytest.mark.parametrize("text", ["12.5", "0"])
def test_where_there_is_no_start_small_numbers_are_no_time(text):
    with pytest.raises(UsageError):
        parse_utc("--video-start", text)
