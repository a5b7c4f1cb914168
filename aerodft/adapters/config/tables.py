"""The pieces that configuration tables are made of: strict, finite, with the unit in the key."""

from typing import Annotated, Generic, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

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


def _lift(value: object) -> object:
    """A bare number is a value without a standard deviation."""
    return {"value": value} if isinstance(value, int | float) and not isinstance(value, bool) else value


class UncertainTable(Table, Generic[Quantity]):
    """A quantity with its standard deviation, in the same unit."""

    value: Quantity
    std: Annotated[float, Field(ge=0)] = 0.0


Uncertain = Annotated[UncertainTable[Quantity], BeforeValidator(_lift)]

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(gt=0)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=360)]
TiltDeg = Annotated[float, Field(ge=0, le=180)]
RollDeg = Annotated[float, Field(ge=-180, le=180)]
HeadingDeg = Annotated[float, Field(ge=-360, le=360)]
FieldOfViewDeg = Annotated[float, Field(gt=0, lt=180)]
BiasDeg = Annotated[float, Field(ge=-45, le=45)]
Text = Annotated[str, Field(min_length=1)]
Slug = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
Pixel = Annotated[tuple[float, float], Field(strict=False)]


def _unique(values: list[Quantity]) -> list[Quantity]:
    for value in values:
        if values.count(value) > 1:
            raise impossible("", got=f"{value} twice", expected="each once")
    return values


UniqueList = Annotated[list[Quantity], Field(min_length=1), AfterValidator(_unique)]
