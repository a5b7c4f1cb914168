"""UTC as text to exact nanoseconds and back; Python's datetime stops at microseconds."""

import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Final

from aerodft.conventions import SECOND_NS

OLDEST_NS: Final = 946_684_800 * SECOND_NS
"""The year 2000: before it nobody had set the clock."""

_YEAR_10000_NS: Final = 253_402_300_800 * SECOND_NS
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_ISO = re.compile(
    r"(\d{4}-\d{2}-\d{2})[T ](\d{2}:\d{2}:\d{2})(?:[.,](\d{1,9}))?\s*(Z|[+-]\d{2}:?\d{2})?",
    re.IGNORECASE,
)
_FARTHEST: Final = timedelta(hours=14)
_HALF_HOUR_NS: Final = 1800 * SECOND_NS
_HOUR_MIN: Final = 60
_OFFSET = re.compile(r"([+-])(\d{2}):?(\d{2})")


def iso_to_unix_ns(text: str, *, default_offset: timedelta | None = None) -> int:
    """ISO 8601 date and time to UTC nanoseconds.

    Args:
        text: Like ``2026-11-21T01:57:26.123456789Z`` or ``2026-11-21 02:57:26+01:00``.
        default_offset: Offset from UTC of a text that states none; None to refuse such a text.

    Raises:
        ValueError: Not a date and time, impossible, or without an offset from UTC.
    """
    match = _ISO.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"{text!r} is no date and time like 2026-11-21T01:57:26.5Z")
    day, clock, fraction, zone = match.groups()
    if zone is None and default_offset is None:
        raise ValueError(f"{text!r} states no offset from UTC; end it with Z or +01:00")
    offset = parse_offset(zone) if zone else default_offset or timedelta()
    return datetime_to_unix_ns(datetime.fromisoformat(f"{day}T{clock}+00:00") - offset) + int(
        (fraction or "0").ljust(9, "0")
    )


def parse_offset(text: str) -> timedelta:
    """An offset from UTC, ``Z`` or like ``+02:00``.

    Raises:
        ValueError: Neither of them.
    """
    if text.upper() == "Z":
        return timedelta()
    match = _OFFSET.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is no offset from UTC like +02:00")
    sign, hours, minutes = match.groups()
    size = timedelta(hours=int(hours), minutes=int(minutes))
    if size > _FARTHEST or int(minutes) >= _HOUR_MIN:
        raise ValueError(f"{text!r} is no offset from UTC: the farthest is 14 h")
    return -size if sign == "-" else size


def offset_text(offset: timedelta) -> str:
    """An offset from UTC as :func:`parse_offset` reads it, like ``+02:00``."""
    minutes = abs(round(offset / timedelta(minutes=1)))
    return f"{'-' if offset < timedelta() else '+'}{minutes // _HOUR_MIN:02d}:{minutes % _HOUR_MIN:02d}"


def zone_hint(
    images_ns: tuple[int, int],
    telemetry_ns: tuple[int, int],
    remedy: Callable[[timedelta], str] | None = None,
) -> str:
    """Hint where images lie beside telemetry by as much as a clock does that tells local time as UTC.

    Args:
        images_ns: First and last stamp, UTC as it was stated.
        telemetry_ns: First and last stamp.
        remedy: What to state, by how much the images' clock is ahead; None for the UTC of the first image.

    Returns:
        How many hours it is, and what would fit; "" where no whole or half hours explain it.
    """
    steps = _FARTHEST // timedelta(minutes=30)
    first_ns, last_ns = images_ns
    enough_ns = min(last_ns - first_ns, telemetry_ns[1] - telemetry_ns[0]) // 2
    found = []
    for step in range(-steps, steps + 1):
        shift_ns = step * _HALF_HOUR_NS
        shared_ns = min(last_ns + shift_ns, telemetry_ns[1]) - max(first_ns + shift_ns, telemetry_ns[0])
        if step and shared_ns >= enough_ns:
            found.append((step % 2, abs(step), shift_ns))
    if not found:
        return ""
    shift_ns = min(found)[-1]
    hours, side = abs(shift_ns) / (2 * _HALF_HOUR_NS), "ahead of" if shift_ns < 0 else "behind"
    fitting = f"a start of {unix_ns_to_iso(first_ns + shift_ns)}"
    if remedy is not None:
        fitting = remedy(timedelta(seconds=-shift_ns / SECOND_NS))
    return f"their clock is {hours:g} h {side} the telemetry's, as one of local time is: {fitting} would fit"


def datetime_to_unix_ns(when: datetime) -> int:
    """A timezone-aware datetime to UTC nanoseconds, in integers throughout."""
    return (when - _EPOCH) // timedelta(microseconds=1) * 1000


def unix_ns_to_iso(stamp_ns: int) -> str:
    """UTC nanoseconds to text that :func:`iso_to_unix_ns` reads back exactly; beyond the year 9999 the number."""
    if stamp_ns >= _YEAR_10000_NS:
        return f"{stamp_ns} ns"
    seconds, fraction = divmod(stamp_ns, SECOND_NS)
    head = (_EPOCH + timedelta(seconds=seconds)).strftime("%Y-%m-%dT%H:%M:%S")
    tail = f"{fraction:09d}".rstrip("0")
    return f"{head}.{tail}Z" if tail else f"{head}Z"
