"""TOML text to validated tables, and what pydantic found to one sentence."""

import difflib
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from aerodft.adapters.config.tables import Table
from aerodft.adapters.files import check_is_no_pipe, content_looks_like, hint_for_kind, looks_like
from aerodft.errors import ConfigError, Reason

TableT = TypeVar("TableT", bound=Table)

_MOST_BYTES = 16 << 20  # somebody means a file of text, and gives a video

_HEAD_BYTES: Final = 16_384  # that say what a file is: some begin with a coordinate system's long text

_UNITS = {
    "m": "metres",
    "deg": "degrees",
    "s": "seconds",
    "ms": "milliseconds",
    "px": "pixels",
    "hz": "hertz",
    "ns": "nanoseconds",
}
_FOREIGN_UNITS = {"cm", "mm", "km", "ft", "in", "rad", "us", "mps", "pct"}
_EXPECTED = {
    "missing": "a value",
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "text in quotes",
    "bool_type": "true or false",
    "finite_number": "a finite number",
    "list_type": "a list",
    "tuple_type": "a list",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dict_type": "a table",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "string_too_long": "at most {max_length} letters",
    "string_too_short": "text in quotes, not empty",
    "literal_error": "one of {expected}",
    "enum": "one of {expected}",
    "too_short": "at least {min_length} of them",
    "too_long": "at most {max_length} of them",
}
_MOST_SHOWN: Final = 62  # letters of a value: one line of a terminal
_INTEGER_BITS: Final = 64
_INTEGERS: Final = "one of 64 bits"


def read_bytes(path: Path) -> bytes:
    """The bytes of a configuration file.

    Raises:
        ConfigError: Missing, a folder, unreadable, or too large.
    """
    try:
        check_is_no_pipe(path)
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
    except FileNotFoundError:
        raise ConfigError("no such file", where=path, hint="check the path") from None
    except OSError:
        raise ConfigError("cannot be read", where=path, got=looks_like(path), expected="a TOML file") from None
    if len(data) > _MOST_BYTES:
        got = f"{content_looks_like(data)} of more than {_MOST_BYTES >> 20} MB"
        raise ConfigError("too large for a configuration", where=path, got=got, expected="a TOML file")
    return data


def parse_toml(data: bytes) -> dict[str, Any]:
    """TOML to plain values.

    Args:
        data: The file's bytes.

    Raises:
        ConfigError: Not UTF-8 text, empty, or a syntax error (with its line).
    """
    try:
        text = data.decode()
        if hint := hint_for_kind(kind := content_looks_like(data[:_HEAD_BYTES])):
            raise ConfigError("wrong type of file", got=kind, expected="TOML", hint=hint)
        document = tomllib.loads(text)
        leaves = list(_leaves(document))
    except UnicodeDecodeError:
        raise ConfigError("not a text file", got=content_looks_like(data), expected="TOML") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"TOML syntax: {error}", hint="correct that line") from None
    except ValueError:  # more digits than Python converts
        raise ConfigError("TOML syntax: an integer of too many digits", expected=_INTEGERS) from None
    except RecursionError:
        raise ConfigError("TOML syntax: too many lists or tables within each other") from None
    if any(isinstance(leaf, int) and leaf.bit_length() >= _INTEGER_BITS for leaf in leaves):  # of base 16, say
        raise ConfigError("TOML: an integer that is too large", expected=_INTEGERS)
    if any(isinstance(leaf, str) and "\0" in leaf for leaf in leaves):  # no file has such a name
        raise ConfigError("TOML: a text with the character 0 in it", hint="take it out")
    if not document:
        raise ConfigError("holds no keys", got=content_looks_like(data), expected="TOML tables and keys")
    return document


def _leaves(value: object) -> Iterator[object]:
    """All values in it that are neither tables nor lists."""
    if isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _leaves(each)
    else:
        yield value


def validated(model: type[TableT], document: object, prefix: str = "") -> TableT:
    """``document`` as a ``model``.

    Args:
        model: The table's class.
        document: Plain values from TOML.
        prefix: Key path of the table in its file, with a trailing dot; empty for the file's root.

    Raises:
        ConfigError: One sentence about the first thing that is wrong; unknown keys come before missing ones, because
            a misspelt key is both.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        found = error.errors(include_url=False)
    problem = min(found, key=lambda each: each["type"] != "extra_forbidden")
    loc = problem["loc"]
    if problem["type"] == "extra_forbidden":
        raise _unknown_key(model, loc, prefix)
    context: dict[str, Any] = problem.get("ctx", {})
    key = prefix + dotted_key((*loc, *([context["key"]] if context.get("key") else [])))
    if problem["type"] == "impossible":
        got = Reason(context["got"]) if context["is_reason"] else context["got"]
        raise ConfigError(key.rstrip(".") or "its keys", got=got, expected=context["expected"], hint=context["hint"])
    expected = _EXPECTED[problem["type"]].format(**context) if problem["type"] in _EXPECTED else problem["msg"]
    got = "nothing" if problem["type"] == "missing" else toml_excerpt(problem["input"])
    raise ConfigError(key, got=got, expected=expected)


def dotted_key(loc: tuple[int | str, ...]) -> str:
    """A key path as people write it: ``probe[0].pixels[1]``."""
    text = ""
    for part in loc:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def toml_excerpt(value: object) -> str:
    """A value as TOML shows it, shortened."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    text = f'"{value}"' if isinstance(value, str) else "null" if value is None else repr(value)
    return text if len(text) <= _MOST_SHOWN else f"{text[: _MOST_SHOWN - 4]}...{text[-1]}"


def _unknown_key(model: type[BaseModel], loc: tuple[int | str, ...], prefix: str) -> ConfigError:
    names = _names_at(model, loc[:-1])
    key = str(loc[-1])
    what = f"{prefix}{dotted_key(loc)}: unknown key"
    meant = _same_quantity(key, names)
    if meant and _split_unit(key)[1]:
        unit = _UNITS[_split_unit(meant)[1]]
        return ConfigError(what, expected=f"{meant} (in {unit})", hint=f"write {meant}")
    close = meant or next(iter(difflib.get_close_matches(key, names, n=1, cutoff=0.6)), "")
    hint = f"did you mean {close}?" if close else f"known keys here are {', '.join(names)}"
    return ConfigError(what, hint=hint)


def _same_quantity(key: str, names: list[str]) -> str:
    """The one of ``names`` that says what ``key`` says, with the unit that belongs to it; empty where there is none."""
    stem = _split_unit(key)[0]
    with_unit = [(name, _split_unit(name)[0]) for name in names if _split_unit(name)[1]]
    exact = [name for name, own in with_unit if own == stem]
    longer = [name for name, own in with_unit if own.startswith(f"{stem}_")]
    return next(iter(exact + longer), "")


def _split_unit(name: str) -> tuple[str, str]:
    stem, _, unit = name.rpartition("_")
    return (stem, unit) if stem and (unit in _UNITS or unit in _FOREIGN_UNITS) else (name, "")


def _names_at(model: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    current = model
    for part in loc:
        if isinstance(part, str):
            current = _nested_model(current.model_fields[_field_of(current, part)].annotation) or current
    return [field.alias or name for name, field in current.model_fields.items()]


def _field_of(model: type[BaseModel], key: str) -> str:
    return next(name for name, field in model.model_fields.items() if key in (name, field.alias))


def _nested_model(annotation: object) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (_nested_model(inner) for inner in get_args(annotation))
    return next((model for model in found if model), None)
