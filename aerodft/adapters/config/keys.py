"""What the keys of configuration tables may hold: strict types of pydantic, with their limits."""

import re
from datetime import datetime
from typing import Annotated, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainSerializer,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import PydanticCustomError

from aerodft.adapters.timestamps import datetime_to_unix_ns, iso_to_unix_ns, unix_ns_to_iso
from aerodft.conventions import LARGEST
from aerodft.errors import Reason

_LONGEST_S = 1e6
TILT_RANGE = "0 to 180 deg from straight down: 0 nadir, 90 horizon"
_FARTHEST_S = 1e9  # 32 years: with a stamp of today still nanoseconds in 64 bits

Quantity = TypeVar("Quantity")


def impossible(key: str, *, got: object, expected: str, hint: str = "") -> PydanticCustomError:
    """The error for a validator that looks at more than one key.

    Args:
        key: The key at fault, below the table that is validated; empty for the table itself.
        got: What was found; a ``Reason`` where it is a clause of its own.
        expected: What would have been right.
        hint: What to do next.
    """
    context = {"key": key, "got": str(got), "is_reason": isinstance(got, Reason), "expected": expected, "hint": hint}
    return PydanticCustomError("impossible", "got {got}, expected {expected}", context)


Real = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
Rate = Annotated[float, Field(gt=0, ge=0.01, le=LARGEST)]
Focal = Annotated[float, Field(gt=1e-18, le=LARGEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Gap = Annotated[float, Field(ge=0.001, le=_LONGEST_S)]
Duration = Annotated[float, Field(ge=0, le=_LONGEST_S)]
TimeOffset = Annotated[float, Field(ge=-_FARTHEST_S, le=_FARTHEST_S)]
Count = Annotated[int, Field(gt=0, le=10_000_000)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=360)]


def pitch_hint(tilt_deg: float) -> str:
    """What to write in place of a tilt that is a gimbal's pitch, in degrees; empty where it may be none."""
    is_pitch = -90 <= tilt_deg < 0  # noqa: PLR2004 - from straight down to the horizon
    return f"a gimbal's pitch of {tilt_deg:g} deg is a tilt of {90 + tilt_deg:g}" if is_pitch else ""


def _no_pitch(value: object) -> object:
    if isinstance(value, int | float) and (hint := pitch_hint(value)):
        raise impossible("", got=f"{value:g}", expected=TILT_RANGE, hint=hint)
    return value


TiltDeg = Annotated[float, BeforeValidator(_no_pitch), Field(ge=0, le=180)]
RollDeg = Annotated[float, Field(ge=-180, le=180)]
HeadingDeg = Annotated[float, Field(ge=-360, le=360)]
FieldOfViewDeg = Annotated[float, Field(gt=0.001, lt=180)]
BiasDeg = Annotated[float, Field(ge=-45, le=45)]
Text = Annotated[str, Field(min_length=1)]
Pixel = Annotated[tuple[Real, Real], Field(strict=False)]


def _pixel_or_point(value: object, as_pixel: ValidatorFunctionWrapHandler) -> object:
    """Let text that names a surveyed point stand as it is; anything else must be a pixel."""
    if not isinstance(value, str):
        return as_pixel(value)
    if "@" not in value:
        raise impossible("", got=f'"{value}"', expected='[u, v], "@NAME" or "u,v@NAME"')
    return value


End = Annotated[Pixel, WrapValidator(_pixel_or_point)]
"""A pixel, or text that names a surveyed point: ``@NAME``, or ``u,v@NAME`` where it is seen elsewhere."""
Many = Annotated[tuple[Quantity, ...], Field(strict=False)]
Matrix = Many[Many[Real]]


def _each_of(low: float, expected: str) -> BeforeValidator:
    """A validator that takes a number of at least ``low``, or a list of such numbers."""

    def check(value: object) -> object:
        several = [each for each in _several(value) if isinstance(each, int | float) and not isinstance(each, bool)]
        is_whole = len(several) == len(_several(value)) > 0
        if not is_whole or not all(low <= each <= LARGEST for each in several):
            raise impossible("", got=str(value)[:80], expected=expected)
        return tuple(map(float, several)) if isinstance(value, list | tuple) else float(several[0])

    return BeforeValidator(check)


def _several(value: object) -> list[object]:
    return list(value) if isinstance(value, list | tuple) else [value]


_RealValues = float | tuple[float, ...]
Elevations = Annotated[_RealValues, _each_of(-LARGEST, "a number of metres, or a list of them, one for each point")]
"""One height of all points, or one for each."""
ElevationStds = Annotated[_RealValues, _each_of(0.0, "at least 0 m, or a list of such numbers, one for each point")]


def matching(pattern: str, expected: str) -> AfterValidator:
    """A validator for text that must match ``pattern`` as a whole.

    Args:
        pattern: A regular expression.
        expected: What it stands for, in words.
    """
    compiled = re.compile(pattern)

    def check(value: str) -> str:
        if compiled.fullmatch(value) is None:
            raise impossible("", got=f'"{value}"', expected=expected)
        return value

    return AfterValidator(check)


def broadcast_to(count: int) -> BeforeValidator:
    """A validator that takes one number for all of so many."""

    def repeat(value: object) -> object:
        return (value,) * count if isinstance(value, int | float) and not isinstance(value, bool) else value

    return BeforeValidator(repeat)


def _unique(values: tuple[Quantity, ...]) -> tuple[Quantity, ...]:
    for value in values:
        if values.count(value) > 1:
            raise impossible("", got=f"{value} twice", expected="each once")
    return values


Slug = Annotated[str, matching(r"[A-Za-z0-9][A-Za-z0-9._-]*", "letters, digits, '.', '_' and '-' only")]
Order = Annotated[tuple[Quantity, ...], Field(strict=False, min_length=1), AfterValidator(_unique)]


def _instant(value: object) -> object:
    """Text or a TOML date and time to UTC nanoseconds; an integer is that already."""
    if isinstance(value, datetime):
        if value.tzinfo is None:
            raise impossible("", got=value.isoformat(), expected="an offset from UTC", hint="end it with Z or +01:00")
        return datetime_to_unix_ns(value)
    if isinstance(value, str):
        try:
            return iso_to_unix_ns(value)
        except ValueError as error:
            raise impossible("", got=f'"{value}"', expected='like "2026-11-21T01:57:26.5Z"', hint=str(error)) from None
    return value


Instant = Annotated[int, BeforeValidator(_instant), PlainSerializer(unix_ns_to_iso)]
"""A moment in UTC, nanoseconds; in files text or a TOML date and time."""
