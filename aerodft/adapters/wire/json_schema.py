"""What payloads are described with (JSON Schema, draft 2020-12) and written by: a schema is the one list of keys."""

import math
from collections.abc import Iterable
from typing import Any, Final

from aerodft.adapters.wire.payload import Json, dump_payload
from aerodft.version import SOFTWARE

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


def object_of(properties: Schema) -> Schema:
    """An object with exactly these properties."""
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


PIXELS: Final = doc(list_of(list_of(NUMBER, length=2)), "Pixels (u, v); (0, 0) is the centre of the top-left pixel")


def payload_of(schema: Schema, value: object, /, **known: object) -> Json:
    """What an object's schema has of a value.

    A key is the value's attribute of that name; one in degrees that of the same name in radians, a stamp its decimal
    digits, an object within a payload of its own.

    Args:
        schema: From ``object_of``.
        value: What has the attributes.
        known: Keys that are known otherwise, as JSON has them.
    """
    return {
        key: known[key] if key in known else _json(own, _attribute(value, key))
        for key, own in schema["properties"].items()
    }


def _attribute(value: object, key: str) -> Any:  # noqa: ANN401 - whatever values hold
    if key.endswith("_deg") and not hasattr(value, key):
        angle_rad = getattr(value, f"{key.removesuffix('deg')}rad")
        return None if angle_rad is None else math.degrees(angle_rad)
    return getattr(value, key)


def _json(schema: Schema, value: Any) -> object:  # noqa: ANN401 - whatever values hold
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

    Attributes:
        name: As given.
        schema: Of the whole payload.
    """

    def __init__(self, name: str, title: str, properties: Schema) -> None:
        self.name = name
        self.schema: Schema = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "$id": f"urn:{name.replace('/', ':')}",
            "title": title,
            **object_of({"schema": {"const": name}, **properties, "software": TEXT}),
        }

    def of(self, value: object, /, **known: object) -> Json:
        """The payload of a value, as ``payload_of``."""
        return payload_of(self.schema, value, schema=self.name, software=SOFTWARE, **known)

    def dump(self, value: object, /, **known: object) -> bytes:
        """The payload of a value as JSON text."""
        return dump_payload(self.of(value, **known))
