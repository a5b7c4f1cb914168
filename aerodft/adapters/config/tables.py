"""What configuration tables are made of: strict, finite, with the unit in the key; and their SI values.

A table is the one list of its keys. ``si_value`` makes the dataclass of SI values that tables describe,
``Table.from_si`` the table of such dataclasses, and ``Table.to_toml`` what is written: reading that gives an equal
dataclass, to the last bit. Key and attribute find each other by name and unit: ``wait_s`` is ``wait_s`` or ``wait_ns``,
``limit_deg`` is ``limit_rad``. Where an attribute has another name, or its value is made otherwise, the key's type says
so with ``SiAttribute``. So a new key is a field of its table and an attribute of the dataclass.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Generic, Literal, Self, TypeAlias, TypeVar, get_args, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, model_validator

from aerodft.adapters.config.keys import Quantity, impossible
from aerodft.conventions import LARGEST, SECOND_NS
from aerodft.errors import Reason

LOCAL: Final = "local"
"""What a file may call its coordinates, beside the codes of maps: metres east, north and up of somewhere."""

GEO: Final = "geo"
"""What a file may call its coordinates: WGS84 degrees."""

_LARGEST_STD = LARGEST / 1000  # it is squared on the way to the resolved configuration, and must come back

Value = TypeVar("Value")
AnyValue: TypeAlias = Any
"""Whatever TOML, dataclasses and annotations hold."""


class Table(BaseModel):
    """A TOML table: unknown keys are refused, text is no number, numbers are finite."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True, protected_namespaces=())

    INSTEAD_OF: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Keys that take the place of others: what is stated beside them is refused, and not written."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        for key, others in self.INSTEAD_OF.items():
            stated = [each for each in others if each in self.model_fields_set and getattr(self, each) is not None]
            if getattr(self, key) is not None and stated:
                raise impossible(stated[0], got=Reason(f"it stands beside {key}"), expected="one of the two")
        return self

    @classmethod
    def from_si(cls, *values: object, stds: object = None, **keys: AnyValue) -> Self:
        """The table of dataclasses of SI values.

        Args:
            values: The dataclasses; a key is that of the first one that has its attribute, else it is left out.
            stds: What has the standard deviations of ``Uncertain`` keys, under the attributes of their values.
            keys: Keys that are known otherwise, as the table has them; None leaves one out.
        """
        if unknown := keys.keys() - cls.model_fields.keys():
            raise ValueError(f"keys {sorted(unknown)}, must be of {cls.__name__}")
        found: dict[str, Any] = {}
        for key, si, nested in _keys(cls):
            owner, attribute = next((at for each in values if (at := _owner_of(each, si.name or key))), (None, ""))
            if owner is None or key in keys:
                continue
            found[key] = _to_key(getattr(owner, attribute), key, attribute, si, nested)
            if nested is not None and issubclass(nested, Uncertain):
                std = _to_key(getattr(stds, attribute), key, attribute, si, nested)
                found[key] = nested.model_construct(value=found[key], std=std)
        found |= keys
        replaced = {other for key, others in cls.INSTEAD_OF.items() if found.get(key) is not None for other in others}
        return cls.model_construct(**{key: value for key, value in found.items() if key not in replaced})

    def to_toml(self) -> dict[str, Any]:
        """TOML values of the keys that are set, in the order of the table; None is left out."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True, exclude_unset=True, warnings="error")

    @classmethod
    def without_marked(cls, document: dict[str, Any]) -> dict[str, Any]:
        """A result of ``to_toml`` without the keys that are ``NOT_IN_CONFIG_ID``."""
        found = {}
        for key, _, nested in _keys(cls):
            if key in document and NOT_IN_CONFIG_ID not in cls.model_fields[key].metadata:
                value = document[key]
                found[key] = nested.without_marked(value) if nested and isinstance(value, dict) else value
        return found | {key: value for key, value in document.items() if key not in cls.model_fields}


class FromFile(Table):
    """A table that names a file, or has in its place all that such a file would hold."""

    model_config = ConfigDict(extra="allow")

    file: Annotated[str, Field(min_length=1)] | None = None

    @property
    def contents(self) -> dict[str, Any]:
        """Plain TOML values that the table holds in place of a file."""
        return self.model_extra or {}

    @classmethod
    def from_contents(cls, contents: dict[str, Any], **keys: object) -> Self:
        """The table that has in it what a file would hold, beside keys of its own."""
        return cls.model_validate(keys | contents)

    @model_validator(mode="after")
    def _file_alone(self) -> Self:
        if self.file is not None and self.model_extra:
            own = " and ".join(type(self).model_fields)
            key = next(iter(self.model_extra))
            raise impossible(
                key, got=Reason("it stands beside file"), expected=f"{own} alone, or what such a file holds"
            )
        return self


class ValueOrTable(Table):
    """A table with the key ``value``, which may stand in its place."""

    @model_validator(mode="before")
    @classmethod
    def _lift(cls, document: object) -> object:
        return document if isinstance(document, dict | ValueOrTable) else {"value": document}


class Uncertain(ValueOrTable, Generic[Quantity]):
    """A quantity with its standard deviation in the same unit; a bare number is one without."""

    value: Quantity
    std: Annotated[float, Field(ge=0, le=_LARGEST_STD)] = 0.0


_NEIGHBOURS = 6


def to_deg(angle_rad: float) -> float:
    """The shortest number of degrees whose ``math.radians`` is exactly ``angle_rad``.

    Where no double has that image (it cannot have come from degrees), the nearest one.
    """
    angle_deg = math.degrees(angle_rad)
    for digits in range(1, 16):
        candidate = round(angle_deg, digits)
        if math.radians(candidate) == angle_rad:
            return candidate
    below = above = angle_deg
    for _ in range(_NEIGHBOURS):
        for candidate in (below, above):
            if math.radians(candidate) == angle_rad:
                return candidate
        below, above = math.nextafter(below, -math.inf), math.nextafter(above, math.inf)
    return angle_deg


def to_ns(duration_s: float) -> int:
    """Seconds to the nearest nanosecond."""
    return round(duration_s * SECOND_NS)


def to_s(duration_ns: int) -> float:
    """Nanoseconds to seconds; exact both ways below eleven days."""
    return duration_ns / SECOND_NS


def to_percent(share: float) -> float:
    """The shortest number of percent that is a hundred times ``share`` and, divided, gives it back exactly."""
    percent = 100 * share
    return next((each for digits in range(16) if (each := round(percent, digits)) / 100 == share), percent)


@dataclass(frozen=True, slots=True)
class SiAttribute:
    """Which attribute of a dataclass of SI values a key is, beside the rule for names.

    Attributes:
        name: With dots for an attribute of a dataclass within; empty for that of the key.
        into: From the key's value to the attribute's, in place of the change of units.
        out: From the attribute's value to the key's; None leaves the key out.
    """

    name: str = ""
    into: Callable[[Any], Any] | None = None
    out: Callable[[Any], Any] | None = None


NOT_IN_CONFIG_ID: Final = "not in config_id"
"""Marks a key that no number depends on, in its ``Annotated`` type: it is left out of the configuration's id."""

_PERCENT = 100.0
_MS_NS = 1_000_000
_INTO_SI: dict[tuple[str, str], tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    ("deg", "rad"): (math.radians, to_deg),
    ("dps", "radps"): (math.radians, to_deg),
    ("s", "ns"): (to_ns, to_s),
    ("ms", "ns"): (lambda duration_ms: duration_ms * _MS_NS, lambda duration_ns: duration_ns // _MS_NS),
    ("percent", "share"): (lambda percent: percent / _PERCENT, to_percent),
}
AS_SHARE = _INTO_SI["percent", "share"]
"""Percent to a share and back, where no name tells."""


def unless_zero(value: AnyValue) -> AnyValue:
    """The value; None where it is 0 or holds nothing, so that its key is left out."""
    return value or None


UNLESS_ZERO = SiAttribute(out=unless_zero)
"""Left out where it is 0: the ids of configurations that were written before the key was known stay as they are."""

ROWS = SiAttribute(into=lambda rows: tuple(rows or ()), out=unless_zero)
"""Rows of a matrix, or several values, of which the dataclass has none where the key is left out."""


def si_value(
    kind: type[Value],
    *tables: Table,
    relative_to: Path = Path(),
    part: Literal["value", "std"] = "value",
    **stated: object,
) -> Value:
    """The dataclass of SI values that tables describe.

    Args:
        kind: The dataclass.
        tables: The tables; keys that no attribute has are left alone.
        relative_to: What relative paths start from.
        part: Of ``Uncertain`` keys: their values, or their standard deviations.
        stated: Attributes that are known otherwise, whatever the tables say.
    """
    found: dict[str, Any] = {}
    for table in tables:
        _collect(found, table, kind, relative_to, part)
    return _built(kind, found | stated)


def _to_key(value: AnyValue, key: str, attribute: str, si: SiAttribute, nested: type[Table] | None) -> AnyValue:
    """A key's value, of an attribute's."""
    if si.out is not None:
        return si.out(value)
    if is_dataclass(value) and nested is not None:
        return nested.from_si(value)
    if nested is not None and isinstance(value, tuple):
        return tuple(map(nested.from_si, value))
    units = _units((si.name or key).rpartition(".")[2], attribute)
    return _plain(value) if units is None or value is None else units[1](value)


def _owner_of(value: object, name: str) -> tuple[object, str] | None:
    """The object that has the attribute of a key, and the attribute's name; None where nothing has."""
    *path, last = name.split(".")
    for step in path:
        value = getattr(value, step, None)
    attribute = _attribute_of(type(value), last)
    return None if attribute is None else (value, attribute)


def _collect(found: dict[str, Any], table: Table, kind: type, folder: Path, part: str) -> None:
    """The attributes of ``kind`` that a table states; those of a dataclass within it as a dictionary of its own."""
    for key, si, _ in _keys(type(table)):
        *path, last = (si.name or key).split(".")
        owner, node = kind, found
        if path and path[0] not in _hints(kind):
            continue
        for step in path:
            owner, node = _within(owner, step), node.setdefault(step, {})
        attribute = _attribute_of(owner, last)
        if attribute is None:
            continue
        said = getattr(table, key)
        if isinstance(said, Uncertain):
            said = getattr(said, part)
        if si.into is not None:
            node[attribute] = si.into(said)
        elif said is None:
            node[attribute] = None
        elif isinstance(said, Table):
            _collect(node.setdefault(attribute, {}), said, _within(owner, attribute), folder, part)
        elif (units := _units(last, attribute)) is not None:
            node[attribute] = units[0](said)
        else:
            node[attribute] = _typed(said, _hints(owner)[attribute], folder)


def _built(kind: type[Value], found: dict[str, Any]) -> Value:
    """A dataclass of its attributes; those of one within it may be a dictionary."""
    is_whole = {name: _within(kind, name) is None or not isinstance(each, dict) for name, each in found.items()}
    return kind(**{name: each if is_whole[name] else _built(_within(kind, name), each) for name, each in found.items()})


@cache
def _keys(table: type[Table]) -> tuple[tuple[str, SiAttribute, type[Table] | None], ...]:
    """The keys of a table, with the attribute that each is and, of a table within it, its class."""
    found = []
    for key, field in table.model_fields.items():
        si = next((each for each in field.metadata if isinstance(each, SiAttribute)), SiAttribute())
        nested = [each for each in _types(field.annotation) if issubclass(each, Table)]
        found.append((key, si, nested[0] if nested else None))
    return tuple(found)


def _types(hint: AnyValue) -> Iterator[type]:
    """The classes that an annotation names, those within others too."""
    if isinstance(hint, type) and not get_args(hint):
        yield hint
    for each in get_args(hint):
        yield from _types(each)


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind) if is_dataclass(kind) else {}


def _within(kind: type, attribute: str) -> AnyValue:
    """The dataclass that an attribute is; None where it is none."""
    return next((each for each in _types(_hints(kind).get(attribute)) if is_dataclass(each)), None)


def _attribute_of(kind: type, key: str) -> str | None:
    """Name of the attribute that a key stands for; None where there is none."""
    names, (stem, _, unit) = _hints(kind), key.rpartition("_")
    in_si = (f"{stem}_{si}" for people, si in _INTO_SI if people == unit)
    return next((name for name in (key, *in_si) if name in names), None)


def _units(key: str, attribute: str) -> tuple[Callable[[Any], Any], Callable[[Any], Any]] | None:
    return _INTO_SI.get((key.rpartition("_")[2], attribute.rpartition("_")[2]))


def _typed(said: AnyValue, hint: AnyValue, folder: Path) -> AnyValue:
    """Text as the path or the name that an attribute is; all else as it is."""
    if isinstance(said, tuple):
        return tuple(_typed(each, hint, folder) for each in said)
    if not isinstance(said, str) or type(said) in _types(hint):
        return said
    kind = next((each for each in _types(hint) if issubclass(each, Path | Enum)), str)
    return folder / said if issubclass(kind, Path) else kind(said)


def _plain(value: AnyValue) -> AnyValue:
    """A value with text for paths."""
    if isinstance(value, tuple):
        return tuple(map(_plain, value))
    return str(value.absolute()) if isinstance(value, Path) else value
