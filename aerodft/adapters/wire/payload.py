"""What all payloads share: JSON with every key present, stamps as decimal strings, null for what is not known.

A JSON Schema (draft 2020-12) describes a payload and is the one list of its keys. Angles are degrees on the wire. A
double survives JSON exactly; degrees and back cost up to ``DEGREES_RTOL``.
"""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import suppress
from typing import Annotated, Any, Final, NoReturn, TypeAlias, TypeVar

import orjson
from pydantic import BeforeValidator, Field

from aerodft.conventions import LARGEST
from aerodft.errors import InputError, Reason
from aerodft.version import SOFTWARE

JsonValue: TypeAlias = Any
"""Whatever JSON holds: text, a number, a list, an object, ..."""

MOST_JSON_BYTES: Final = 4 << 20
"""Of a payload without an image: a thousand measurements of one image take one or two."""
MOST_PICTURE_BYTES: Final = 16 << 20
"""Of a payload with an image as text."""
_MOST_SHOWN: Final = 80  # letters of a value in a sentence
_MOST_COMMAS: Final = 200_000  # there is one for each value; an object of one key takes 300 bytes

Schema = dict[str, Any]

NUMBER: Final[Schema] = {"type": ["number", "null"]}
INTEGER: Final[Schema] = {"type": ["integer", "null"]}
TEXT: Final[Schema] = {"type": "string"}
TEXT_OR_NULL: Final[Schema] = {"type": ["string", "null"]}
STAMP: Final[Schema] = {
    "type": "string",
    "pattern": "^-?[0-9]+$",
    "description": "Nanoseconds UTC as a decimal string, because 64 bits do not survive other languages' numbers",
}
COUNT: Final[Schema] = {"type": "integer"}
STAMP_OR_NULL: Final[Schema] = {**STAMP, "type": ["string", "null"]}


def load_bounded_json(data: bytes, most_bytes: int = MOST_JSON_BYTES) -> JsonValue:
    """The value of a JSON text.

    Args:
        data: The text.
        most_bytes: No longer one is read.

    Raises:
        orjson.JSONDecodeError: It is no JSON text, or one of more than is believed.
    """
    if len(data) > most_bytes:
        raise orjson.JSONDecodeError(f"more than {most_bytes >> 20} MB", "", 0)
    if data.count(b",") > _MOST_COMMAS:
        raise orjson.JSONDecodeError(f"more than {_MOST_COMMAS} values", "", 0)
    return orjson.loads(data)


DEGREES_RTOL = 4.5e-16  # two roundings: an angle comes back within two units in the last place

LATEST_NS = 2**63 - 1
"""Stamps are 64 bits with a sign."""

_WRONG: Final = (KeyError, TypeError, ValueError, IndexError, AttributeError)

T = TypeVar("T")
Json = dict[str, JsonValue]


def dump_payload(payload: Json) -> bytes:
    """Payload to bytes; numpy arrays become lists, non-finite numbers null."""
    return orjson.dumps(payload, option=orjson.OPT_SERIALIZE_NUMPY)


def load_object(data: bytes, what: str, where: str, example: str) -> Json:
    """A JSON object written by somebody else.

    Args:
        data: The text.
        what: What it is, in the sentence that refuses it: ``the question``.
        where: Where it is from.
        example: How one looks.

    Raises:
        InputError: It is no JSON, or no object.
    """
    try:
        payload = load_bounded_json(data)
    except orjson.JSONDecodeError as error:
        raise InputError(f"{what} is not JSON", where=where, got=error, expected=example) from error
    if not isinstance(payload, dict):
        raise InputError(f"{what} is no JSON object", where=where, got=as_json(payload), expected=example)
    return payload


def as_json(value: object) -> str:
    """A value as JSON shows it, its first letters, for a sentence that refuses it."""
    return orjson.dumps(value, default=str).decode()[:_MOST_SHOWN]


def _digits(value: object) -> object:
    return int(value[:20]) if isinstance(value, str) and value.isascii() and value.isdigit() else value


StampNs = Annotated[int, Field(ge=0, le=LATEST_NS), BeforeValidator(_digits)]
"""A stamp (ns, UTC) as somebody else wrote it: a decimal string, or an integer."""


def load_payload(data: bytes, schema: str, build: Callable[[Json], T]) -> T:
    """Bytes to a value.

    Args:
        data: The payload.
        schema: What its ``schema`` key must say.
        build: Makes the value from the parsed object.

    Raises:
        InputError: Not JSON, another schema, a key missing or of the wrong type.
    """
    try:
        payload = load_bounded_json(data)
    except orjson.JSONDecodeError as error:
        _refuse(schema, data, error)
    if not isinstance(payload, dict) or payload.get("schema") != schema:
        _refuse(schema, data)
    return _built(schema, payload, build)


def load_payloads(
    data: Sequence[bytes],
    schema: str,
    build: Callable[[Json], T],
    build_all: Callable[[Sequence[Json]], Sequence[T] | None] = lambda _: None,
) -> Sequence[T]:
    """The values of many bytes, each as ``load_payload`` builds it.

    Args:
        data: The payloads.
        schema: What their ``schema`` keys must say.
        build: Makes a value from a parsed object.
        build_all: Makes all values at once; gives None, or fails, where that cannot be done.
    """
    try:
        payloads = load_bounded_json(b"[%b]" % b",".join(data))
    except orjson.JSONDecodeError:
        payloads = []
    if len(payloads) != len(data) or not all(
        isinstance(each, dict) and each.get("schema") == schema for each in payloads
    ):
        return [load_payload(each, schema, build) for each in data]  # one of them says what it is
    with suppress(*_WRONG):
        found = build_all(payloads)
        if found is not None:
            return found
    return [_built(schema, each, build) for each in payloads]


def _built(schema: str, payload: Json, build: Callable[[Json], T]) -> T:
    try:
        return build(payload)
    except _WRONG as error:
        raise InputError(
            f"{schema} payload is incomplete or wrong", got=Reason(f"{type(error).__name__}: {error}")
        ) from error


def _refuse(schema: str, data: bytes, error: Exception | None = None) -> NoReturn:
    raise InputError("payload is of another kind", got=repr(bytes(data[:60])), expected=schema) from error


def integers(*values: int | str) -> list[int]:
    """Integers from numbers or decimal strings.

    Raises:
        ValueError: One is none, or takes more than 64 bits.
    """
    found = list(map(int, values)) if set(map(type, values)) <= {int, str} else []
    if not found or not -LATEST_NS <= min(found) <= max(found) <= LATEST_NS:
        raise ValueError(f"{values!r:.60}: not whole numbers of 64 bits")
    return found


def number_or_nan(value: float | None) -> float:
    """A number where JSON had null for a non-finite one."""
    return math.nan if value is None else float(value)


def pixel_pairs(values: Iterable[Sequence[float | None]]) -> tuple[tuple[float, float], ...]:
    """Pixels ``((u, v), ...)``.

    Raises:
        ValueError: A pixel without exactly two coordinates, or one that nothing can be calculated with.
    """
    pixels = tuple((number_or_nan(u), number_or_nan(v)) for u, v in values)
    if any(abs(u) > LARGEST or abs(v) > LARGEST for u, v in pixels):
        raise ValueError("pixels beyond all images")
    return pixels


def doc(schema: Schema, description: str) -> Schema:
    """A schema with a description."""
    return {**schema, "description": description}


def one_of(values: Iterable[str]) -> Schema:
    """One of some names, or of the values of an enumeration."""
    return {"enum": [str(value) for value in values]}


def or_null(schema: Schema) -> Schema:
    """A schema that takes null too."""
    if "enum" in schema:
        return {**schema, "enum": [*schema["enum"], None]}
    return {**schema, "type": [schema["type"], "null"]}


def list_of(items: Schema, *, length: int | None = None) -> Schema:
    """An array, of any length or of one."""
    size = {} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": items, **size}


def object_of(properties: Schema, optional: Collection[str] = ()) -> Schema:
    """An object with exactly these properties; those that are ``optional`` are absent where they would be null."""
    return {
        "type": "object",
        "properties": properties,
        "required": [key for key in properties if key not in optional],
        "additionalProperties": False,
    }


PIXELS: Final = doc(list_of(list_of(NUMBER, length=2)), "Pixels (u, v); (0, 0) is the centre of the top-left pixel")


def payload_of(schema: Schema, value: object, /, **known: object) -> Json:
    """The payload of a value: the keys of an object's schema, each from the attribute of its name.

    A key is the value's attribute of that name; one in degrees that of the same name in radians, a stamp its decimal
    digits, an object within a payload of its own.

    Args:
        schema: From ``object_of``.
        value: What has the attributes.
        known: Keys that are known otherwise, as JSON has them.
    """
    found = {
        key: known[key] if key in known else _json(own, _attribute(value, key))
        for key, own in schema["properties"].items()
    }
    optional = schema["properties"].keys() - set(schema["required"])
    return {key: each for key, each in found.items() if each is not None or key not in optional}


def _attribute(value: object, key: str) -> JsonValue:
    if key.endswith("_deg") and not hasattr(value, key):
        angle_rad = getattr(value, f"{key.removesuffix('deg')}rad")
        return None if angle_rad is None else math.degrees(angle_rad)
    return getattr(value, key)


def _json(schema: Schema, value: JsonValue) -> object:
    if value is None:
        return None
    if "pattern" in schema:
        return str(value)
    if "properties" in schema:
        return payload_of(schema, value)
    items = schema.get("items", {})
    return [payload_of(items, each) for each in value] if "properties" in items else value


class Payload:
    """A kind of payload, which names itself and the software that made it.

    Args:
        name: For instance ``aerodft.image/1``.
        title: What it is, for people.
        properties: The schema of each of its keys.
        optional: Keys that are absent where they would be null.

    Attributes:
        name: As given.
        schema: Of the whole payload.
    """

    def __init__(self, name: str, title: str, properties: Schema, optional: Collection[str] = ()) -> None:
        self.name = name
        self.schema: Schema = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "$id": f"urn:{name.replace('/', ':')}",
            "title": title,
            **object_of({"schema": {"const": name}, **properties, "software": TEXT}, optional),
        }

    def to_json(self, value: object, /, **known: object) -> Json:
        """The payload of a value, as ``payload_of``."""
        return payload_of(self.schema, value, schema=self.name, software=SOFTWARE, **known)

    def dump(self, value: object, /, **known: object) -> bytes:
        """The payload of a value as JSON text."""
        return dump_payload(self.to_json(value, **known))
