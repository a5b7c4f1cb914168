"""What the schemas of all payloads are made of: JSON Schema (draft 2020-12) as plain dictionaries."""

from enum import StrEnum
from typing import Any, Final

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
STAMP_OR_NULL: Final[Schema] = {**STAMP, "type": ["string", "null"]}


def said(schema: Schema, description: str) -> Schema:
    """The same with a description."""
    return {**schema, "description": description}


def one_of(values: type[StrEnum]) -> Schema:
    """One of the values of an enumeration."""
    return {"enum": [member.value for member in values]}


def or_null(schema: Schema) -> Schema:
    """The same, or null."""
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


def document(name: str, title: str, properties: Schema) -> Schema:
    """The schema of a payload, which names itself and the software that made it."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:{name.replace('/', ':')}",
        "title": title,
        **object_of({"schema": {"const": name}, **properties, "software": TEXT}),
    }
