"""The tables of many images in one file of evidence: where telemetry says that each was taken, and how well."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.camera import StdTable, stds_from
from aerodft.adapters.config.evidence.cross_checks import StatedObservation
from aerodft.adapters.config.evidence.evidence_tables import (
    CameraPriorTable,
    EvidenceTable,
    ImageTable,
    KnownValue,
    camera_priors,
)
from aerodft.adapters.config.evidence.local_frame import LocalFrame
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.reading import validated
from aerodft.adapters.config.station import OriginTable, TelemetryTable, telemetry_from
from aerodft.adapters.config.tables import si_value
from aerodft.adapters.timestamps import iso_to_unix_ns
from aerodft.errors import ConfigError
from aerodft.model import Evidence, GeoOrigin, Prior
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
            raise impossible("focal_px", got="it in an image", expected="it in [camera]: all images share the lens")
        if self.utc is not None:
            try:
                iso_to_unix_ns(self.utc)
            except ValueError as error:
                raise impossible("utc", got=str(error), expected="UTC like 2026-11-21T01:57:26.5Z") from None
        stated = [key for key in _POSE if key in self.model_fields_set]
        stamps = [key for key in ("utc", "index") if getattr(self, key) is not None]
        if len(stamps) > 1 or (stamps and stated):
            other = stamps[1] if len(stamps) > 1 else stated[0]
            raise impossible(other, got=f"it beside {stamps[0]}", expected="a pose, or one stamp to look it up at")
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
                raise impossible(key, got="it beside [[image]]", expected="telemetry as it was recorded")
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
            raise impossible(f"camera.{key}", got="it beside [[image]]", expected="it in the images")
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
        raise ConfigError("telemetry", got="it without [[image]]", expected=expected)
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
