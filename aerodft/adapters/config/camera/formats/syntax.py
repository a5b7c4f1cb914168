"""YAML, JSON and XML text to plain values, of bounded cost whatever a file holds."""

import json
import re
from collections.abc import Mapping
from typing import Any, Final
from xml.etree import ElementTree as ET

from aerodft.errors import ConfigError, counted

_MAX_YAML_LETTERS: Final = 200_000  # 5 s of the parser; files of calibrations have 500 to 20,000
_OPENCV_HEADER: Final = re.compile(r"\A\s*%YAML:\S*[^\n]*\n")


def yaml_table(text: str) -> Mapping[str, Any]:
    """The first document of YAML text; scalars are text, tags are left aside.

    Raises:
        ConfigError: Too long, a syntax error, or no table.
    """
    import yaml  # noqa: PLC0415 - for these files alone

    if len(text) > _MAX_YAML_LETTERS:
        raise ConfigError("too large for a camera's YAML", got=counted(len(text), "letter"), expected="200 kB at most")
    try:
        # BaseLoader makes nothing but text, lists and tables, so that no tag and no number costs or runs anything.
        document = next(yaml.load_all(_OPENCV_HEADER.sub("", text), Loader=yaml.BaseLoader), None)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = "" if mark is None else f" (at line {mark.line + 1})"
        raise ConfigError(f"YAML syntax{where}", hint="correct that line") from None
    except (RecursionError, TypeError, ValueError):
        raise ConfigError("YAML syntax: lists or tables that no camera file has") from None
    return _table(document, "YAML")


def json_value(text: str) -> Any:  # noqa: ANN401 - of any kind
    """The value of JSON text.

    Raises:
        ConfigError: A syntax error.
    """
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise ConfigError(f"JSON syntax: {error.msg} (at line {error.lineno})", hint="correct that line") from None
    except (RecursionError, ValueError):
        raise ConfigError("JSON syntax: numbers, lists or tables that no camera file has") from None


def json_table(text: str) -> Mapping[str, Any]:
    """The table of JSON text.

    Raises:
        ConfigError: A syntax error, or no table.
    """
    return _table(json_value(text), "JSON")


def xml_root(text: str) -> ET.Element:
    """The root element of XML text; text with a DOCTYPE is refused, whose entities may grow without end.

    Raises:
        ConfigError: A DOCTYPE, or a syntax error.
    """
    if "<!doctype" in text.casefold():
        raise ConfigError("XML: a DOCTYPE", expected="none in a camera's file", hint="take it out")
    try:
        return ET.fromstring(text)  # noqa: S314 - without a DOCTYPE there are no entities to expand
    except (ET.ParseError, ValueError) as error:
        raise ConfigError(f"XML syntax: {error}", hint="correct that line") from None


def _table(value: object, syntax: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError("holds no keys", got=f"{syntax} without a table", expected="keys of a camera")
    return value
