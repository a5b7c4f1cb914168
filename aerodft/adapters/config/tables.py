"""The pieces that configuration tables are made of: strict, finite, with the unit in the key; and their SI values.

A table is the one list of its keys: ``value_of`` makes the value that it describes, ``keys_of`` writes such a value
down again. Key and attribute find each other by name: ``wait_s`` is ``wait_s`` or ``wait_ns``, ``limit_deg`` is
``limit_rad``. Where an attribute has another name, or its value is made otherwise, the key's type says so with
``Means``.
"""

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Final, Generic, TypeVar, get_args, get_type_hints

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from aerodft.adapters.config.units import to_deg, to_ns, to_percent, to_s
from aerodft.conventions import LARGEST

LOCAL: Final = "local"
"""What a file may call its coordinates, beside the codes of maps: metres east, north and up of somewhere."""

GEO: Final = "geo"
"""What a file may call its coordinates: WGS84 degrees."""

_LARGEST_STD = LARGEST / 1000  # it is squared on the way to the resolved configuration, and must come back
_LONGEST_S = 1e6
_FARTHEST_S = 1e9  # 32 years: with a stamp of today still nanoseconds in 64 bits

Quantity = TypeVar("Quantity")
Value = TypeVar("Value")


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


def repeated(count: int) -> BeforeValidator:
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


@dataclass(frozen=True, slots=True)
class Means:
    """What a key stands for, beside the rule for names.

    Attributes:
        attribute: Of the value; with dots for one of a value within it. Empty for the name that the key has.
        into: From what the key says to the attribute.
        out: Back; None leaves the key out.
    """

    attribute: str = ""
    into: Callable[[Any], Any] | None = None
    out: Callable[[Any], Any] | None = None


_PERCENT = 100.0
_INTO_SI: dict[tuple[str, str], tuple[Callable[[float], float], Callable[[Any], float]]] = {
    ("deg", "rad"): (math.radians, to_deg),
    ("dps", "radps"): (math.radians, to_deg),
    ("s", "ns"): (to_ns, to_s),
    ("percent", "share"): (lambda percent: percent / _PERCENT, to_percent),
}
AS_SHARE = _INTO_SI["percent", "share"]
"""Percent to a share and back, where no name tells."""


ROWS = Means(into=lambda rows: tuple(rows or ()), out=lambda rows: [list(row) for row in rows] or None)
"""A covariance in rows, empty where none is stated."""


def value_of(table: Table, kind: type[Value], folder: Path = Path(), **stated: object) -> Value:
    """The value that a table describes.

    Args:
        table: The table; keys that no attribute has are left alone.
        kind: The dataclass.
        folder: What relative paths start from.
        stated: Attributes that are known otherwise, whatever the table says.
    """
    found: dict[str, Any] = {}
    _collect(found, table, kind, folder)
    return _made(kind, found | stated)


def keys_of(table: type[Table], value: object) -> dict[str, Any]:
    """What a table says of a value, in the order of its keys and as TOML has it; what is None is left out.

    Args:
        table: The kind of table; keys that no attribute has are left out.
        value: The dataclass; ``value_of`` makes an equal one, as far as the table has its attributes.
    """
    document = {}
    for key, means, nested in _keys(table):
        *path, last = (means.attribute or key).split(".")
        owner: Any = value
        for step in path:
            owner = getattr(owner, step, None)
        attribute = _attribute_of(type(owner), last)
        if attribute is None:
            continue
        found = getattr(owner, attribute)
        if means.out is not None:
            found = means.out(found)
        elif found is not None:
            found = _plain(found) if nested is None else keys_of(nested, found)
            if (units := _units(last, attribute)) is not None:
                found = units[1](found)
        if found is not None:
            document[key] = found
    return document


def _collect(found: dict[str, Any], table: Table, kind: type, folder: Path) -> None:
    """The attributes of ``kind`` that a table states; those of a value within it as a dictionary of its own."""
    for key, means, nested in _keys(type(table)):
        *path, last = (means.attribute or key).split(".")
        owner, node = kind, found
        if path and path[0] not in _hints(kind):
            continue
        for step in path:
            owner, node = _within(owner, step), node.setdefault(step, {})
        attribute = _attribute_of(owner, last)
        if attribute is None:
            continue
        said = getattr(table, key)
        if means.into is not None:
            node[attribute] = means.into(said)
        elif said is None:
            node[attribute] = None
        elif nested is not None:
            _collect(node.setdefault(attribute, {}), said, _within(owner, attribute), folder)
        elif (units := _units(last, attribute)) is not None:
            node[attribute] = units[0](said)
        else:
            node[attribute] = _typed(said, _hints(owner)[attribute], folder)


def _made(kind: type[Value], found: dict[str, Any]) -> Value:
    """A value of its attributes; one within it may be a dictionary of its own."""
    is_whole = {name: _within(kind, name) is None or not isinstance(each, dict) for name, each in found.items()}
    return kind(**{name: each if is_whole[name] else _made(_within(kind, name), each) for name, each in found.items()})


@cache
def _keys(table: type[Table]) -> tuple[tuple[str, Means, type[Table] | None], ...]:
    """The keys of a table, with what each stands for and, of a table within it, its kind."""
    found = []
    for key, field in table.model_fields.items():
        means = next((each for each in field.metadata if isinstance(each, Means)), Means())
        nested = [each for each in _types(field.annotation) if issubclass(each, Table)]
        found.append((key, means, nested[0] if nested else None))
    return tuple(found)


def _types(hint: Any) -> Iterator[type]:  # noqa: ANN401 - whatever annotations are
    """The classes that an annotation names, those within others too."""
    if isinstance(hint, type) and not get_args(hint):
        yield hint
    for each in get_args(hint):
        yield from _types(each)


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind) if is_dataclass(kind) else {}


def _within(kind: type, attribute: str) -> Any:  # noqa: ANN401 - its class, or None
    """The dataclass that an attribute is; None where it is none."""
    return next((each for each in _types(_hints(kind).get(attribute)) if is_dataclass(each)), None)


def _attribute_of(kind: type, key: str) -> str | None:
    """What an attribute is called that says what a key says; None where there is none."""
    names, (stem, _, unit) = _hints(kind), key.rpartition("_")
    in_si = (f"{stem}_{si}" for people, si in _INTO_SI if people == unit)
    return next((name for name in (key, *in_si) if name in names), None)


def _units(key: str, attribute: str) -> tuple[Callable[[Any], Any], Callable[[Any], Any]] | None:
    return _INTO_SI.get((key.rpartition("_")[2], attribute.rpartition("_")[2]))


def _typed(said: Any, hint: Any, folder: Path) -> Any:  # noqa: ANN401 - whatever TOML and dataclasses hold
    """Text as the path or the name that an attribute is; all else as it is."""
    if isinstance(said, tuple):
        return tuple(_typed(each, hint, folder) for each in said)
    if not isinstance(said, str):
        return said
    kind = next((each for each in _types(hint) if issubclass(each, Path | Enum)), str)
    return folder / said if issubclass(kind, Path) else kind(said)


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever TOML and dataclasses hold
    """A value as TOML has it."""
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    if isinstance(value, Path):
        return str(value.absolute())
    return str(value) if isinstance(value, Enum) else value
