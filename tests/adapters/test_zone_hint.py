"""A clock that tells local time as UTC is named by how many hours it is off, and other gaps are not."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.adapters.timestamps import iso_to_unix_ns, parse_offset, zone_hint

FLIGHT_NS = tuple(iso_to_unix_ns(f"2026-06-01T{clock}Z") for clock in ("10:00:00", "10:12:00"))
VIDEO_NS = tuple(iso_to_unix_ns(f"2026-06-01T{clock}Z") for clock in ("10:01:00", "10:09:00"))


@given(half_hours=st.integers(-28, 28).filter(bool))
def test_every_zone_is_told_and_the_start_that_would_fit(half_hours):
    shifted = tuple(each + half_hours * 1_800_000_000_000 for each in VIDEO_NS)
    hint = zone_hint(shifted, FLIGHT_NS)
    side = "ahead of" if half_hours > 0 else "behind"
    assert f"{abs(half_hours) / 2:g} h {side}" in hint
    assert "2026-06-01T10:01:00Z" in hint


@pytest.mark.parametrize("minutes", [13, 17, -20, 3 * 60 + 15, 15 * 60])
def test_what_no_zone_explains_is_not_called_one(minutes):
    shifted = tuple(each + minutes * 60_000_000_000 for each in VIDEO_NS)
    assert zone_hint(shifted, FLIGHT_NS) == ""


@pytest.mark.parametrize("text", ["+25:99", "-14:30", "+01:60", "1h"])
def test_offsets_that_no_place_has_are_refused(text):
    with pytest.raises(ValueError, match="no offset from UTC"):
        parse_offset(text)
