"""A river's folder, read again: what ``aerodft river`` wrote, for maps and pages."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import orjson

from aerodft.adapters.files import read_whole
from aerodft.adapters.wire.payload import load_bounded_json
from aerodft.errors import InputError, Reason
from replay.export import MapFeature

_RESULT: Final = "result.json"
_MAP, _LOCAL_MAP = "river.geojson", "river_local.json"
_LAYERS: Final = {"bank-left": "banks", "bank-right": "banks", "transect": "transects"}
_DEPTHS: Final = {"Point": 0, "LineString": 1, "Polygon": 2, "MultiLineString": 2}


@dataclass(frozen=True, slots=True)
class RiverFolder:
    """Contents of a surveyed river's folder.

    Attributes:
        path: The folder.
        document: Of schema ``aerodft.river/1``.
        features: Centreline, banks, transects and water.
        is_local: Whether these are in metres east and north; else longitude and latitude.
    """

    path: Path
    document: dict[str, Any]
    features: tuple[MapFeature, ...]
    is_local: bool


def is_river_folder(path: Path) -> bool:
    """Whether a folder holds a surveyed river, and no recording."""
    return (path / _RESULT).is_file() and not any(path.glob("*.mcap"))


def read_river_folder(path: Path) -> RiverFolder:
    """The river in a folder.

    Raises:
        InputError: A file is missing or damaged.
    """
    document = _read(path / _RESULT)
    is_local = not (path / _MAP).is_file()
    on_map = path / (_LOCAL_MAP if is_local else _MAP)
    drawn = _read(on_map)
    try:
        features = tuple(_features(drawn))
        for key in ("status", "reasons", "transects", "width_m"):
            document[key]
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError("no river's map", where=on_map, got=Reason(f"{type(error).__name__}: {error}")) from error
    return RiverFolder(path, document, features, is_local)


def _read(path: Path) -> dict[str, Any]:
    try:
        found = load_bounded_json(read_whole(path))
    except OSError as error:
        hint = "folders of rivers are those that `aerodft river` writes"
        raise InputError("the file cannot be read", where=path, got=error, hint=hint) from error
    except orjson.JSONDecodeError as error:
        raise InputError("the file is no JSON", where=path, got=error) from error
    if not isinstance(found, dict):
        raise InputError("the file is no JSON object", where=path)
    return found


def _features(drawn: dict[str, Any]) -> Iterator[MapFeature]:
    for each in drawn["features"]:
        properties, geometry = dict(each["properties"]), each["geometry"]
        name = str(properties.pop("name"))
        side = {"side": name.removeprefix("bank-")} if _LAYERS.get(name) == "banks" else {}
        _check_numbers(geometry["coordinates"], _DEPTHS[geometry["type"]])
        scalars = {key: value for key, value in properties.items() if not isinstance(value, list | dict)}
        yield MapFeature(_LAYERS.get(name, name), geometry, side | scalars)


def _check_numbers(coordinates: list[Any], depth: int) -> None:
    """Refuse what is no list of places, ``depth`` lists deep."""
    if depth:
        for each in coordinates:
            _check_numbers(each, depth - 1)
    elif not (math.isfinite(coordinates[0]) and math.isfinite(coordinates[1])):
        raise ValueError("no place")
