"""Files of evidence: what people know about a scene, for a calibration.

A TOML file (``configs/calibration/`` has one with every key explained), of one image or of many whose telemetry says
where each was taken; a CSV file with a row for each landmark; or OpenDroneMap's list of ground control points.
"""

import codecs
import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.camera import StdTable, stds_from
from aerodft.adapters.config.evidence.cross_checks import (
    SAY_LOCAL,
    StatedObservation,
    check_datums,
    check_degrees,
    check_duplicates,
    check_is_map,
    check_names,
    check_pixels,
    check_tilt,
    check_together,
    frame_around,
)
from aerodft.adapters.config.evidence.evidence_tables import (
    CameraPriorTable,
    EvidenceTable,
    ImageTable,
    KnownValue,
    LandmarkTable,
    ObservationTable,
    camera_priors,
    priors_from,
)
from aerodft.adapters.config.evidence.landmark_list import is_gcp_list, read_landmarks
from aerodft.adapters.config.evidence.local_frame import LocalFrame, checked_crs, takes_degrees
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.origin import OriginTable
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.tables import LOCAL, si_value
from aerodft.adapters.config.telemetry_tables import TelemetryTable, telemetry_from
from aerodft.adapters.files import content_looks_like
from aerodft.adapters.timestamps import iso_to_unix_ns
from aerodft.errors import ConfigError, Reason, located
from aerodft.model import Camera, Evidence, EvidenceSet, GeoOrigin, KnownPoint, Landmark, Prior
from aerodft.service import ErrorStd, TelemetrySettings

_POSE = ("height_agl_m", "tilt_deg", "roll_deg", "heading_deg", "position_m", "lat_deg", "velocity_mps", "rates_dps")
_LIVE = ("connection", "baud", "wait_s", "calibration", "bias")
_OWN = ("log", "origin", "time_offset_s", "noise_share", "noise")
Vector = Annotated[tuple[keys.Real, keys.Real, keys.Real], Field(strict=False)]


class ImageEntry(ImageTable, CameraPriorTable):
    """One image: its pose by telemetry as it is written here, or a stamp at which to look the pose up."""

    name: keys.Text
    velocity_mps: Vector | None = None
    rates_dps: Vector | None = None
    utc: keys.Text | None = None
    index: Annotated[int, Field(ge=0)] | None = None

    @property
    def is_stamped(self) -> bool:
        """Whether the image is named by a stamp or index, so that its pose is looked up."""
        return self.utc is not None or self.index is not None

    @property
    def stamp_ns(self) -> int | None:
        """UTC; None for an index."""
        return None if self.utc is None else iso_to_unix_ns(self.utc)

    @model_validator(mode="after")
    def _one_pose(self) -> Self:
        if self.focal_px is not None:
            raise impossible(
                "focal_px", got=Reason("it stands in an image"), expected="it in [camera]: all images share the lens"
            )
        if self.utc is not None:
            try:
                iso_to_unix_ns(self.utc)
            except ValueError as error:
                raise impossible("utc", got=Reason(error), expected="UTC") from None
        stated = [key for key in _POSE if key in self.model_fields_set]
        stamps = [key for key in ("utc", "index") if getattr(self, key) is not None]
        if len(stamps) > 1 or (stamps and stated):
            other = stamps[1] if len(stamps) > 1 else stated[0]
            raise impossible(
                other, got=Reason(f"it stands beside {stamps[0]}"), expected="a pose, or one stamp to look it up at"
            )
        if not stamps:
            has_height = self.height_agl_m is not None or len(self.place or ()) > 2  # noqa: PLR2004 - a height
            missing = "height_agl_m" if not has_height else "tilt_deg"
            if not has_height or self.tilt_deg is None:
                expected = "height_agl_m and tilt_deg by telemetry, or utc or index to look them up"
                raise impossible(missing, got="nothing", expected=expected)
        return self


class FlightTable(TelemetryTable):
    """The images' telemetry: where it is, how it becomes a pose as in a station's file, and how well it is known."""

    log: keys.Text | None = None
    origin: OriginTable | None = None
    time_offset_s: KnownValue[keys.TimeOffset] | None = None
    noise_share: Annotated[float, Field(ge=0, lt=1)] = 0.1
    noise: StdTable = StdTable()

    @model_validator(mode="before")
    @classmethod
    def _lift(cls, document: object) -> object:
        return {"log": document} if isinstance(document, str) else document

    @model_validator(mode="after")
    def _is_recorded(self) -> Self:
        for key in _LIVE:
            if key in self.model_fields_set:
                raise impossible(key, got=Reason("it stands beside [[image]]"), expected="telemetry as it was recorded")
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedPose:
    """A pose as it stands in the file, in its local frame: value and std, None where no std is stated.

    Attributes:
        known: By the names of unknowns; metres, radians.
        velocity_mps: East, north, up.
        rate_cam_radps: About the camera's x, y and z axes.
    """

    known: dict[str, tuple[float, float | None]]
    velocity_mps: tuple[float, float, float]
    rate_cam_radps: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageEvidence:
    """One image of a file of evidence.

    Attributes:
        name: Of the image.
        file: Its file, as stated.
        evidence: What is known in it.
        pose: As stated; None where it is to be looked up.
        stamp_ns: UTC to look it up at, or None.
        index: Of the image in a recording, or None.
    """

    name: str
    file: str | None
    evidence: tuple[Evidence, ...]
    pose: StatedPose | None
    stamp_ns: int | None
    index: int | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flight:
    """Many images and their telemetry.

    Attributes:
        images: In the order of the file.
        log: Log or recording that stamps are looked up in; None where the file names none.
        settings: How telemetry becomes a pose, and its standard deviations.
        says_settings: The file states some of them, else they are defaults.
        noise_share: Share of each standard deviation that is new in every image.
        noise: Of single errors in place of that share, in their own units.
        time: What is known of the time offset beforehand.
        origin: Where the zero of local coordinates is.
    """

    images: tuple[ImageEvidence, ...]
    log: Path | None
    settings: TelemetrySettings
    says_settings: bool
    noise_share: float
    noise: ErrorStd
    time: Prior | None
    origin: GeoOrigin | None


class ImagesEvidenceTable(EvidenceTable):
    """The file, where there are many images."""

    image: keys.Many[ImageEntry]  # type: ignore[assignment]  # in double brackets
    telemetry: FlightTable = FlightTable()

    @property
    def images(self) -> Sequence[ImageEntry]:
        """Tables of the images that the evidence is from."""
        return self.image

    @property
    def cameras(self) -> Sequence[ImageEntry]:
        """Tables that state where a camera is."""
        return self.image

    @property
    def image_file(self) -> None:
        """None: there are many."""
        return

    @model_validator(mode="after")
    def _of_one_camera(self) -> Self:
        first: dict[str, int] = {}
        for index, entry in enumerate(self.image):
            if first.setdefault(entry.name, index) != index:
                got = f'"{entry.name}", which image[{first[entry.name]}] has'
                raise impossible(f"image[{index}].name", got=got, expected="a name of its own")
        if len(sizes := list(dict.fromkeys(each.size_px for each in self.image if each.size_px))) > 1:
            got = " and ".join(f"{width} x {height}" for width, height in sizes[:2])
            raise impossible("image", got=f"{got} pixels", expected="images of one size: one camera in one mode")
        for key in self.camera.model_fields_set - {"focal_px"}:
            raise impossible(f"camera.{key}", got=Reason("it stands beside [[image]]"), expected="it in the images")
        return self


def read_tables(document: dict[str, Any]) -> EvidenceTable:
    """The tables of a file of evidence, of one image or of many.

    Raises:
        ConfigError: A table is wrong.
    """
    if isinstance(document.get("image"), list):
        return validated(ImagesEvidenceTable, document)
    if "telemetry" in document:
        expected = "[[image]] tables, each with a name and utc or index"
        raise ConfigError("telemetry", got=Reason("it stands without [[image]]"), expected=expected)
    return validated(EvidenceTable, document)


def flight_from(
    tables: ImagesEvidenceTable,
    stated: Sequence[StatedObservation],
    evidence: Sequence[Evidence],
    frame: LocalFrame,
    path: Path,
) -> Flight:
    """The images with their evidence.

    Args:
        tables: What the file says.
        stated: The observations as they stand in the file.
        evidence: What each of them is in the frame.
        frame: The frame that the evidence is in.
        path: The file; the log's path is relative to it.

    Raises:
        ConfigError: Nothing is known in an image.
    """
    telemetry = tables.telemetry
    by_image: dict[str | None, list[Evidence]] = {}
    for each, known in zip(stated, evidence, strict=True):
        by_image.setdefault(each.image, []).append(known)
    for index, entry in enumerate(tables.image):
        if entry.name not in by_image:
            expected, hint = f'an observation with image = "{entry.name}"', "or remove it"
            raise ConfigError(f"image[{index}]", got="no observation in it", expected=expected, hint=hint)
    offset = telemetry.time_offset_s
    return Flight(
        images=tuple(_image(entry, tuple(by_image[entry.name]), frame) for entry in tables.image),
        log=None if telemetry.log is None else path.parent / telemetry.log,
        settings=telemetry_from(telemetry),
        says_settings=bool(telemetry.model_fields_set - set(_OWN)),
        noise_share=telemetry.noise_share,
        noise=stds_from(telemetry.noise, ErrorStd()),
        time=None if offset is None else Prior(value=offset.value, std=offset.std or 0.0),
        origin=None if telemetry.origin is None else si_value(GeoOrigin, telemetry.origin),
    )


def _image(entry: ImageEntry, evidence: tuple[Evidence, ...], frame: LocalFrame) -> ImageEvidence:
    pose = None
    if not entry.is_stamped:
        x, y, z = entry.rates_dps or (0.0, 0.0, 0.0)
        rates = (math.radians(x), math.radians(y), math.radians(z))
        velocity = entry.velocity_mps or (0.0, 0.0, 0.0)
        pose = StatedPose(known=camera_priors(entry, frame), velocity_mps=velocity, rate_cam_radps=rates)
    return ImageEvidence(
        name=entry.name, file=entry.file, evidence=evidence, pose=pose, stamp_ns=entry.stamp_ns, index=entry.index
    )


_LIST_SUFFIXES = {".csv", ".tsv", ".txt"}
_FIRST_PRINTED = 0x20
_FIELDS = {"range": "ranges"}
_MOST_NAMES = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceFile:
    """Contents of an evidence file, in SI units.

    Attributes:
        known: Observations and priors, in metres of ``frame`` and radians.
        frame: Where these metres are. Its zero is the stated elevation of the ground; where none is stated, the file's
            own zero for local coordinates (up to 100 km), and otherwise the middle one of the landmarks' heights.
        fixed: Names of the priors that are stated without a std: taken as exact (their std is 0).
        stated: The observations as they stand in the file, for messages; in the order of ``known.evidence``.
        image: File name of the image, as stated.
        image_size_px: Its width and height, as stated.
        sha256: Of the file's bytes, hexadecimal.
        path: The file.
        flight: Many images, with what is known in each; None for a file of one image.
        notes: What a person should know of how the observations were made, sentence by sentence.
        image_paths: Files of the images that the observations were made in, as far as they are there.
    """

    known: EvidenceSet
    frame: LocalFrame
    fixed: frozenset[str]
    stated: tuple[StatedObservation, ...]
    image: str | None
    image_size_px: tuple[int, int] | None
    sha256: str
    path: Path
    flight: Flight | None = None
    notes: tuple[str, ...] = ()
    image_paths: tuple[Path, ...] = ()

    @property
    def points(self) -> dict[str, KnownPoint]:
        """Landmarks of known height by name, with their heights above the zero of ``frame``."""
        return {
            each.name: KnownPoint(pixel=each.pixel, elevation_m=each.position_m[2], elevation_std_m=each.std_m[2])
            for each in self.known.evidence
            if isinstance(each, Landmark) and each.position_m[2] is not None
        }

    def with_notes(self, *notes: str) -> "EvidenceFile":
        """The file with further notes."""
        return replace(self, notes=(*self.notes, *notes))


@dataclass(frozen=True, slots=True)
class _Row:
    """An observation of a file: the name of its table, what it is called in messages, and the table."""

    kind: str
    label: str
    table: ObservationTable


@dataclass(frozen=True, slots=True)
class _File:
    table: EvidenceTable
    rows: list[_Row]
    is_list: bool = False


def load_evidence(
    path: Path, crs: str | None = None, plane_elevation_m: float | None = None, image: str | None = None
) -> EvidenceFile:
    """Read a file of evidence.

    Args:
        path: A TOML file; or, by its ending ``.csv``, ``.tsv`` or ``.txt``, a CSV file with a header, or a list of
            ground control points as OpenDroneMap takes it.
        crs: What the places of a CSV file are in: ``local`` metres, ``geo`` or an EPSG code. Other files say it.
        plane_elevation_m: Of the measured plane, in the heights of the landmarks. TOML files say it.
        image: Of a list of ground control points: the image whose points are meant, where it has several.

    Raises:
        ConfigError: Missing or unreadable, a syntax error, an unknown key or column, an impossible value, or
            observations that cannot all be true.
    """
    data = read_bytes(path)
    with located(path):
        if path.suffix.lower() in _LIST_SUFFIXES:
            file = _from_list(_text(data), crs, plane_elevation_m, image, path)
        else:
            _refuse_in_file("crs", crs, f'write crs = "{crs}" in it')
            hint = f"write elevation_m = {plane_elevation_m} in it"
            _refuse_in_file("plane_elevation_m", plane_elevation_m, hint)
            _refuse_an_image(image)
            file = _from_document(parse_toml(data))
        return _check_and_resolve(file, path, hashlib.sha256(data).hexdigest())


def _refuse_in_file(key: str, value: object, hint: str) -> None:
    """Refuse what the file itself says."""
    if value is not None:
        raise ConfigError(f"`{key}`", got=f"{value} beside this file", expected="it in the file", hint=hint)


def _refuse_an_image(image: str | None) -> None:
    if image is not None:
        expected = "a list of ground control points of several images"
        raise ConfigError("image", got=f'"{image}"', expected=expected)


def evidence_from(document: dict[str, Any], path: Path, sha256: str) -> EvidenceFile:
    """Evidence from what a TOML file has, perhaps with more that was found otherwise.

    Args:
        document: Plain values from TOML.
        path: The file, for messages.
        sha256: Of its bytes, hexadecimal.

    Raises:
        ConfigError: An unknown key, an impossible value, or observations that cannot all be true.
    """
    with located(path):
        return _check_and_resolve(_from_document(document), path, sha256)


def _check_and_resolve(file: _File, path: Path, sha256: str) -> EvidenceFile:
    table, rows = file.table, file.rows
    size_px = next((each.size_px for each in table.images if each.size_px), None)  # one camera's mode has one size
    stated = tuple(StatedObservation.from_table(row.label, row.table) for row in rows)
    crs = checked_crs(table.crs)
    for camera in table.cameras:
        check_datums(stated, camera, crs)
    names = _names(rows)
    check_names(names, stated)
    check_pixels(stated, size_px)
    check_duplicates(stated)
    if takes_degrees(crs):
        check_degrees(stated)
    say_local = "take them as a CSV file with `crs` local" if file.is_list else SAY_LOCAL
    frame = frame_around(stated, table.model_copy(update={"camera": table.cameras[0]}), crs, say_local)
    check_together(stated, frame)
    priors, fixed = priors_from(table, frame)
    evidence = tuple(row.table.observation(name, frame) for row, name in zip(rows, names, strict=True))
    images = (path.parent / each.file for each in table.images if each.file is not None)
    return EvidenceFile(
        known=EvidenceSet(evidence=evidence, priors=priors),
        frame=frame,
        fixed=fixed,
        stated=stated,
        image=table.image_file,
        image_size_px=size_px,
        sha256=sha256,
        path=path,
        flight=flight_from(table, stated, evidence, frame, path) if isinstance(table, ImagesEvidenceTable) else None,
        notes=(*check_is_map(stated, crs, say_local), *_plane_note(file, frame)),
        image_paths=tuple(each for each in images if each.is_file()),
    )


def _plane_note(file: _File, frame: LocalFrame) -> Iterator[str]:
    """Sentence on the zero of elevations, where the file does not state it."""
    is_middle = frame.crs != LOCAL or frame.origin != (0.0, 0.0, 0.0)
    key = "`plane_elevation_m`" if file.is_list else "elevation_m in the file"
    if file.table.elevation_m is not None:
        if file.is_list:
            yield f"heights count from the measured plane at {frame.origin[2]:.10g} m, as stated"
    elif is_middle and any(row.table.place for row in file.rows):
        zero = f"{frame.origin[2]:.10g} m, the middle one of the landmarks' heights"
        yield f"heights count from the measured plane, taken to be at {zero}; {key} states another"
    elif file.is_list:
        yield f"heights count from the measured plane, taken to be where landmarks have height 0; {key} states another"


def check_against(found: EvidenceFile, camera: Camera) -> None:
    """Refuse evidence that cannot be this camera's.

    Args:
        found: The evidence.
        camera: The camera that is said to have taken the image.

    Raises:
        ConfigError: The image has another size, a pixel is outside of it (a horizon's may be), pixels and places or
            u and v are interchanged, or the tilt was given in radians.
    """
    size_px = (camera.width_px, camera.height_px)
    if found.image_size_px not in (None, size_px):
        got = "{} x {} pixels".format(*found.image_size_px or ())
        expected = f'{size_px[0]} x {size_px[1]}, the size of camera "{camera.name}"'
        hint = "take the camera file of the mode that the image was taken in"
        raise ConfigError("image", where=found.path, got=got, expected=expected, hint=hint)
    with located(found.path):
        check_pixels(found.stated, size_px)
    check_tilt(found.known, camera, found.path)


def _from_document(document: dict[str, Any]) -> _File:
    table = read_tables(document)
    kinds = [key for key, value in document.items() if isinstance(value, list) and key != "image"]
    rows = [
        _Row(kind, f"{kind}[{index}]", each)
        for kind in kinds
        for index, each in enumerate(getattr(table, _FIELDS.get(kind, kind)))
    ]
    if not rows:
        expected = "[[landmark]], [[range]], [[length]] or another observation"
        raise ConfigError("no observations", expected=expected)
    for row in rows:
        _check_image(row, [each.name for each in table.image] if isinstance(table, ImagesEvidenceTable) else None)
    return _File(table, rows)


def _check_image(row: _Row, names: list[str] | None) -> None:
    """Refuse an observation of which nobody knows what image it is in; no names are one image alone."""
    image = row.table.image
    if image is not None and names is None:
        raise ConfigError(f"{row.label}.image", got=Reason("it stands without [[image]]"), expected="one image alone")
    if names is not None and image not in names:
        got = "nothing" if image is None else f'"{image}"'
        expected = f"one of {', '.join(names[:_MOST_NAMES])}{', ...' if len(names) > _MOST_NAMES else ''}"
        raise ConfigError(f"{row.label}.image", got=got, expected=expected)


def landmark_tables(text: str) -> tuple[str, list[dict[str, Any]]]:
    """The coordinate reference system of a list of landmarks, and of each its table as a TOML file has it.

    Raises:
        ConfigError: As ``load_evidence``.
    """
    found = read_landmarks(text)
    return found.crs, [row for _, row in found.rows]


def _from_list(text: str, crs: str | None, plane_elevation_m: float | None, image: str | None, path: Path) -> _File:
    if is_gcp_list(text):
        _refuse_in_file("crs", crs, "its first line says it")
    else:
        _refuse_an_image(image)
    found = read_landmarks(text, image)
    keys: dict[str, Any] = {"crs": crs or found.crs}
    if found.image is not None:
        folders = (Path(), Path("images"))
        files = (folder / found.image for folder in folders if (path.parent / folder / found.image).is_file())
        keys["image"] = {"file": str(next(files, Path(found.image)))}
    if plane_elevation_m is not None:
        keys["elevation_m"] = plane_elevation_m
    rows = [_Row("landmark", label, validated(LandmarkTable, row, f"{label}, ")) for label, row in found.rows]
    return _File(validated(EvidenceTable, keys), rows, is_list=True)


def _names(rows: Sequence[_Row]) -> list[str]:
    """Each one's own name, or its kind and number in the file; after its image's, where there are several."""
    count: dict[str, int] = {}
    names = []
    for row in rows:
        count[row.kind] = count.get(row.kind, 0) + 1
        image = "" if row.table.image is None else f"{row.table.image}/"
        names.append(f"{image}{row.table.name or f'{row.kind}-{count[row.kind]}'}")
    return names


def _text(data: bytes) -> str:
    encoding = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        is_text = not any(byte < _FIRST_PRINTED and byte not in b"\t\r\n" for byte in data)
        line = data.count(b"\n", 0, error.start) + 1
        what, got = "not a text file", content_looks_like(data)
        if is_text:
            what, got = f"line {line}", "letters in another encoding than UTF-8"
        raise ConfigError(what, got=got, expected="CSV", hint="save it as UTF-8") from None
