"""Files of surveyed markers: which ArUco or AprilTag ids hang where. ``configs/calibration/`` has one explained.

Such a file may also hold everything that a file of evidence may: what is known of the camera, other landmarks, lengths.
"""

import difflib
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Self

import cv2
import numpy as np
from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.evidence.cross_checks import (
    StatedObservation,
    check_datums,
    check_degrees,
    check_together,
    frame_around,
)
from aerodft.adapters.config.evidence.evidence_file import EvidenceFile, evidence_from
from aerodft.adapters.config.evidence.evidence_tables import (
    GEO_KEYS,
    EvidenceTable,
    InDegrees,
    Place,
    Rows,
    StdM,
    check_geo,
)
from aerodft.adapters.config.evidence.local_frame import LocalFrame, checked_crs, takes_degrees
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.reading import parse_toml, read_bytes, toml_excerpt, validated
from aerodft.errors import ConfigError, Reason, located
from aerodft.model import MarkerSighting, MarkerSurvey, SurveyedMarker, marker_name

_PREFIX = "DICT_"
_TAPE_M = 0.005  # what a survey leaves where nobody says; an exact one would put true markers beyond belief
_SQUARE = 0.1  # by which sides of a surveyed square may differ
_STDS = 6.0  # and what errors of the survey may add

Point = Annotated[tuple[keys.Real, keys.Real, keys.Real], Field(strict=False)]


class MarkerTable(InDegrees):
    """A marker: its centre in metres or degrees, or its four corners."""

    id: Annotated[int, Field(ge=0)]
    position_m: Point | None = None
    corners_m: Annotated[tuple[Point, ...], Field(strict=False, min_length=4, max_length=4)] | None = None
    side_m: keys.Positive | None = None
    std_m: StdM = (_TAPE_M, _TAPE_M, _TAPE_M)

    @property
    def places(self) -> tuple[Place, ...]:
        """The marker's centre or corners, in the file's coordinates."""
        if self.corners_m is not None:
            return self.corners_m
        return (self.position_m if self.position_m is not None else (self.lat_deg, self.lon_deg, self.alt_m),)

    @property
    def is_geo(self) -> bool:
        """Whether the marker's place is in degrees."""
        return self.position_m is None and self.corners_m is None

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        ways = [key for key in ("position_m", "corners_m") if getattr(self, key) is not None]
        ways += [key for key in GEO_KEYS if key in self.model_fields_set][:1]
        if not ways:
            expected = f"position_m of its centre, or {', '.join(GEO_KEYS)}, or corners_m"
            raise impossible("position_m", got="nothing", expected=expected)
        if len(ways) > 1:
            raise impossible(ways[1], got=Reason(f"it stands beside {ways[0]}"), expected="one of the two")
        if self.is_geo:
            check_geo(self, needs_alt=True)
        if self.corners_m is None and None in self.places[0]:
            raise impossible("", got='"?"', expected="the whole place of a marker")
        return self


class MarkersTable(EvidenceTable):
    """The file."""

    dictionary: keys.Text
    side_m: keys.Positive | None = None
    marker: Rows[MarkerTable]
    ignore: keys.Order[int] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MarkersFile:
    """Contents of a file of surveyed markers.

    Attributes:
        survey: The markers, in metres of ``frame``.
        ignore: Ids of the dictionary that hang there too, and that nobody has surveyed.
        frame: Where these metres are, around all markers.
        dictionary: As the file calls it.
        path: The file.
    """

    survey: MarkerSurvey
    ignore: frozenset[int]
    frame: LocalFrame
    dictionary: str
    path: Path
    _table: MarkersTable
    _document: dict[str, Any]
    _sha256: str

    def evidence(
        self, sightings: Sequence[MarkerSighting], size_px: tuple[int, int], image: str | None
    ) -> EvidenceFile:
        """All that the file says, with landmarks where its markers are seen.

        Landmarks are named ``marker-3``, or ``marker-3 corner 1`` to 4 where corners are surveyed.

        Args:
            sightings: Of surveyed markers, each once.
            size_px: Width and height of the image.
            image: Its file, from the folder of ``path``; None where there is none.

        Raises:
            ConfigError: What is not about markers contradicts itself or the image.
        """
        tables = {table.id: table for table in self._table.marker}
        found = [row for sighting in sightings for row in _landmarks(tables[sighting.id], sighting)]
        stated = dict(self._document.get("image", {}))
        document = {key: value for key, value in self._document.items() if key not in _OWN_KEYS}
        document["landmark"] = [*document.get("landmark", []), *found]
        document["image"] = {"width_px": size_px[0], "height_px": size_px[1], **stated}
        if image is not None:
            document["image"]["file"] = image
        return evidence_from(document, self.path, self._sha256)


_OWN_KEYS = {"dictionary", "side_m", "marker", "ignore"}


def _landmarks(table: MarkerTable, sighting: MarkerSighting) -> list[dict[str, Any]]:
    std_m, name = list(table.std_m), marker_name(table.id)
    if table.corners_m is not None:
        return [
            {
                "name": f"{name} corner {index + 1}",
                "pixel": list(pixel),
                "position_m": list(place),
                "std_px": sighting.corner_std_px,
                "std_m": std_m,
            }
            for index, (pixel, place) in enumerate(zip(sighting.corners, table.corners_m, strict=True))
        ]
    (place,) = table.places
    at = dict(zip(GEO_KEYS, place, strict=True)) if table.is_geo else {"position_m": list(place)}
    return [{"name": name, "pixel": list(sighting.pixel), **at, "std_px": sighting.std_px, "std_m": std_m}]


def load_markers(path: Path) -> MarkersFile:
    """Read a file of surveyed markers.

    Raises:
        ConfigError: Missing or unreadable, a syntax error, an unknown key or dictionary, an id twice or beyond the
            dictionary, or places that cannot all be true.
    """
    data = read_bytes(path)
    with located(path):
        return markers_from(parse_toml(data), path, hashlib.sha256(data).hexdigest())


def markers_from(document: dict[str, Any], path: Path, sha256: str = "") -> MarkersFile:
    """The surveyed markers of what a file of them holds.

    Args:
        document: Plain values from TOML.
        path: What the file is called in messages.
        sha256: Of its bytes, where evidence is to name it.

    Raises:
        ConfigError: An unknown key or dictionary, an id twice or beyond the dictionary, or places that
            cannot all be true.
    """
    with located(path):
        return _markers(validated(MarkersTable, document), document, path, sha256)


def _markers(table: MarkersTable, document: dict[str, Any], path: Path, sha256: str) -> MarkersFile:
    if not table.marker:
        raise ConfigError("marker", got="none", expected="[[marker]] tables with id and position_m")
    dictionary, size = _dictionary(table.dictionary)
    _check_ids(table, size)
    crs = checked_crs(table.crs)
    frame = _frame(table, crs)
    survey = MarkerSurvey(dictionary=dictionary, markers=tuple(_surveyed(each, table, frame) for each in table.marker))
    _check_apart(survey)
    for index, each in enumerate(survey.markers):
        _check_square(each, f"marker[{index}].corners_m")
    return MarkersFile(
        survey=survey,
        ignore=frozenset(table.ignore),
        frame=frame,
        dictionary=table.dictionary,
        path=path,
        _table=table,
        _document=document,
        _sha256=sha256,
    )


def _surveyed(table: MarkerTable, file: MarkersTable, frame: LocalFrame) -> SurveyedMarker:
    points_m = frame.local_m(np.array(table.places, dtype=np.float64)).tolist()
    return SurveyedMarker(
        id=table.id,
        points_m=tuple((float(east_m), float(north_m), float(up_m)) for east_m, north_m, up_m in points_m),
        std_m=table.std_m,
        side_m=table.side_m or file.side_m,
    )


def _dictionary(text: str) -> tuple[str, int]:
    """OpenCV's name of a dictionary, and how many markers it has."""
    names = {name.removeprefix(_PREFIX).lower(): name for name in dir(cv2.aruco) if name.startswith(_PREFIX)}
    wanted = re.sub(r"^(april)?tag_?(?=\d)", "apriltag_", text.lower().removeprefix(_PREFIX.lower()))
    if wanted not in names:
        close = next(iter(difflib.get_close_matches(wanted, names, n=1, cutoff=0.6)), "")
        hint = f"did you mean {close}?" if close else ""
        raise ConfigError("dictionary", got=toml_excerpt(text), expected=f"one of {', '.join(names)}", hint=hint)
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, names[wanted]))
    return names[wanted].removeprefix(_PREFIX), len(known.bytesList)


def _check_ids(table: MarkersTable, size: int) -> None:
    seen: dict[int, int] = {}
    for index, each in enumerate(table.marker):
        key = f"marker[{index}].id"
        if each.id >= size:
            expected = f"0 to {size - 1}, as {table.dictionary} has"
            raise ConfigError(key, got=each.id, expected=expected)
        if each.id in seen:
            hint = "an id can hang in one place only"
            got = f"{each.id}, which marker[{seen[each.id]}] has"
            raise ConfigError(key, got=got, expected="an id of its own", hint=hint)
        seen[each.id] = index
    for index, marker in enumerate(table.ignore):
        if marker in seen:
            got = f"{marker}, which marker[{seen[marker]}] surveys"
            raise ConfigError(f"ignore[{index}]", got=got, expected="an id that is not surveyed")


def _frame(table: MarkersTable, crs: str) -> LocalFrame:
    stated = [
        StatedObservation(f"marker[{index}]", (), place, is_geo=each.is_geo)
        for index, each in enumerate(table.marker)
        for place in each.places
    ]
    check_datums(stated, table.camera, crs)
    if takes_degrees(crs):
        check_degrees(stated)
    frame = frame_around(stated, table, crs)
    check_together(stated, frame)
    return frame


def _check_apart(survey: MarkerSurvey) -> None:
    centres_m = [np.mean(each.points_m, axis=0) for each in survey.markers]
    for (first, one_m), (second, other_m) in combinations(enumerate(centres_m), 2):
        if np.array_equal(one_m, other_m):
            got = f"that of marker[{first}]"
            raise ConfigError(f"marker[{second}]: place", got=got, expected="a place of its own")


def _check_square(marker: SurveyedMarker, label: str) -> None:
    """Refuse corners that no square has, and another side than the one that is stated."""
    if len(marker.points_m) == 1:
        return
    corners_m = np.array(marker.points_m)
    sides_m = np.linalg.norm(np.roll(corners_m, -1, axis=0) - corners_m, axis=1)
    diagonals_m = np.linalg.norm(corners_m[2:] - corners_m[:2], axis=1)
    lengths_m = np.concatenate([sides_m, diagonals_m / np.sqrt(2)])
    typical_m = float(np.median(lengths_m))
    doubt_m = _SQUARE * typical_m + _STDS * max(marker.std_m)
    got = f"sides of {', '.join(f'{side_m:.4g}' for side_m in sides_m)} m"
    if np.max(np.abs(lengths_m - typical_m)) > doubt_m:
        hint = "give them around the square: top left, top right, bottom right, bottom left, as it is printed"
        raise ConfigError(label, got=got, expected="a square", hint=hint)
    if marker.side_m is not None and abs(typical_m - marker.side_m) > doubt_m:
        expected = f"side_m, {marker.side_m:g} m, of the black square without the white around it"
        raise ConfigError(label, got=got, expected=expected)
