"""The pieces that configuration tables are made of: strict, finite, with the unit in the key."""

import re
from typing import Annotated, Generic, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from aerodft.conventions import LARGEST

_LARGEST_STD = LARGEST / 1000  # it is squared on the way to the resolved configuration, and must come back
_LONGEST_S = 1e6
_FARTHEST_S = 1e9  # 32 years: with a stamp of today still nanoseconds in 64 bits

Quantity = TypeVar("Quantity")


def impossible(key: str, *, got: object, expected: str, hint: str = "") -> PydanticCustomError:
    """The error for a validator that looks at more than one key.

    Args:
        key: The key at fault, below the table that is validated; empty for the table itself.
        got: What was found.
        expected: What would have been right.
        hint: What to do next.
    """
    return PydanticCustomError(
        "impossible",
        "got {got}, expected {expected}",
        {"key": key, "got": str(got), "expected": expected, "hint": hint},
    )


class Table(BaseModel):
    """A TOML table: unknown keys are refused, text is no number, numbers are finite."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True, protected_namespaces=())


class Uncertain(Table, Generic[Quantity]):
    """A quantity with its standard deviation in the same unit; a bare number is one without."""

    value: Quantity
    std: Annotated[float, Field(ge=0, le=_LARGEST_STD)] = 0.0

    @model_validator(mode="before")
    @classmethod
    def _lift(cls, given: object) -> object:
        return {"value": given} if isinstance(given, int | float) and not isinstance(given, bool) else given


Real = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
Focal = Annotated[float, Field(gt=1e-18, le=LARGEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Gap = Annotated[float, Field(ge=0.001, le=_LONGEST_S)]
Duration = Annotated[float, Field(ge=0, le=_LONGEST_S)]
TimeOffset = Annotated[float, Field(ge=-_FARTHEST_S, le=_FARTHEST_S)]
Count = Annotated[int, Field(gt=0, le=10_000_000)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=360)]
TiltDeg = Annotated[float, Field(ge=0, le=180)]
RollDeg = Annotated[float, Field(ge=-180, le=180)]
HeadingDeg = Annotated[float, Field(ge=-360, le=360)]
FieldOfViewDeg = Annotated[float, Field(gt=0.001, lt=180)]
BiasDeg = Annotated[float, Field(ge=-45, le=45)]
Text = Annotated[str, Field(min_length=1)]
Pixel = Annotated[tuple[Real, Real], Field(strict=False)]
Many = Annotated[tuple[Quantity, ...], Field(strict=False)]


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


def _unique(values: tuple[Quantity, ...]) -> tuple[Quantity, ...]:
    for value in values:
        if values.count(value) > 1:
            raise impossible("", got=f"{value} twice", expected="each once")
    return values


Slug = Annotated[str, matching(r"[A-Za-z0-9][A-Za-z0-9._-]*", "letters, digits, '.', '_' and '-' only")]
Order = Annotated[tuple[Quantity, ...], Field(strict=False, min_length=1), AfterValidator(_unique)]
