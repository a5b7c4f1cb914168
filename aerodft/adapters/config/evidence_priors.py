"""A file of evidence as a whole, and what it says of the camera beforehand."""

import math
from typing import Annotated, Generic, Self, TypeVar

from pydantic import BeforeValidator, Field, model_validator

from aerodft.adapters.config.crs import LOCAL
from aerodft.adapters.config.evidence_frame import LocalFrame
from aerodft.adapters.config.evidence_tables import (
    GEO_KEYS,
    PLANE,
    SPACE,
    GroundPointTable,
    HeightTable,
    HorizonTable,
    InDegrees,
    LandmarkTable,
    LengthTable,
    ParallelTable,
    RangeTable,
    RightAngleTable,
    VerticalTable,
    check_geo,
)
from aerodft.adapters.config.tables import (
    Count,
    Focal,
    HeadingDeg,
    Positive,
    Quantity,
    Real,
    RollDeg,
    Table,
    Text,
    TiltDeg,
    impossible,
)
from aerodft.model.evidence import Prior

Row = TypeVar("Row", bound=Table)

_PLACE_NAMES = ("east", "north", "height")


def _once(value: object) -> object:
    return (value,) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _in_rows(value: object) -> object:
    if isinstance(value, dict):
        raise impossible("", got="one table in single brackets", expected="its name in double brackets, like [[range]]")
    return value


PriorStd = Annotated[float, Field(gt=0, le=1e9)]
PlaceStd = Annotated[tuple[PriorStd, ...], Field(strict=False), BeforeValidator(_once)]
Rows = Annotated[tuple[Row, ...], Field(strict=False), BeforeValidator(_in_rows)]


class _Lifted(Table):
    @model_validator(mode="before")
    @classmethod
    def _lift(cls, given: object) -> object:
        return given if isinstance(given, dict) else {"value": given}


class Known(_Lifted, Generic[Quantity]):
    """A quantity and how well it is known; a bare one is taken as exact."""

    value: Quantity
    std: PriorStd | None = None


class PlaceTable(_Lifted):
    """East and north or easting and northing, and perhaps a height; one std for all, or one for each of them."""

    value: Annotated[tuple[Real, ...], Field(strict=False, min_length=PLANE, max_length=SPACE)]
    std: PlaceStd | None = None

    @model_validator(mode="after")
    def _a_std_each(self) -> Self:
        _check_stds("std", self.std, len(self.value))
        return self


def _check_stds(key: str, std: tuple[float, ...] | None, size: int) -> None:
    if std is not None and len(std) not in {1, size}:
        raise impossible(key, got=f"{len(std)} of them", expected=f"one, or {size} as the position has")


class CameraPriorTable(InDegrees):
    """What is known of the camera beforehand, all optional; numbers, or ``{value, std}``."""

    height_agl_m: Known[Positive] | None = None
    tilt_deg: Known[TiltDeg] | None = None
    roll_deg: Known[RollDeg] | None = None
    heading_deg: Known[HeadingDeg] | None = None
    focal_px: Known[Focal] | None = None
    position_m: PlaceTable | None = None
    position_std_m: PlaceStd | None = None

    @property
    def is_geo(self) -> bool:
        """Its place, which it has, is in degrees."""
        return self.position_m is None

    @property
    def place(self) -> tuple[float, ...] | None:
        """Two or three numbers in the file's coordinates, where it has a place."""
        if self.position_m is not None:
            return self.position_m.value
        stated = (self.lat_deg, self.lon_deg, self.alt_m)
        return tuple(each for each in stated if each is not None) or None

    @property
    def place_std_m(self) -> tuple[float, ...] | None:
        """One std for each number of the place; None where it is exact."""
        std = self.position_std_m if self.position_m is None else self.position_m.std
        place = self.place or ()
        return std if std is None or len(std) == len(place) else std * len(place)

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        in_degrees = [key for key in GEO_KEYS if key in self.model_fields_set]
        if self.position_m is not None and in_degrees:
            raise impossible(in_degrees[0], got="it beside position_m", expected="one of the two")
        for key in in_degrees:
            if getattr(self, key) is None:
                raise impossible(key, got='"?"', expected="a number", hint="leave out what nobody knows")
        if in_degrees:
            check_geo(self, needs_alt=False)
        if self.position_std_m is not None:
            if not in_degrees:
                hint = "write position_m = { value = [...], std = ... }"
                raise impossible("position_std_m", got="it without lat_deg", expected="lat_deg and lon_deg", hint=hint)
            _check_stds("position_std_m", self.position_std_m, len(in_degrees))
        if self.place is not None and len(self.place) == SPACE and self.height_agl_m is not None:
            key = "alt_m" if self.is_geo else "position_m"
            raise impossible("height_agl_m", got=f"it beside a height in {key}", expected="one of the two")
        return self


class ImageTable(Table):
    """The image that the pixels were read in."""

    file: Text | None = None
    width_px: Count | None = None
    height_px: Count | None = None

    @model_validator(mode="after")
    def _size_is_whole(self) -> Self:
        if (self.width_px is None) != (self.height_px is None):
            missing = "width_px" if self.width_px is None else "height_px"
            raise impossible(missing, got="nothing", expected="both width_px and height_px, or none of them")
        return self


class EvidenceTable(Table):
    """The file."""

    crs: Text = LOCAL
    elevation_m: Known[Real] | None = None
    image: ImageTable = ImageTable()
    camera: CameraPriorTable = CameraPriorTable()
    landmark: Rows[LandmarkTable] = ()
    ranges: Rows[RangeTable] = Field(default=(), alias="range")
    ground: Rows[GroundPointTable] = ()
    length: Rows[LengthTable] = ()
    height: Rows[HeightTable] = ()
    vertical: Rows[VerticalTable] = ()
    parallel: Rows[ParallelTable] = ()
    right_angle: Rows[RightAngleTable] = ()
    horizon: Rows[HorizonTable] = ()


def camera_priors(camera: CameraPriorTable, frame: LocalFrame) -> dict[str, tuple[float, float | None]]:
    """What a table says of a camera, by the unknowns' names: values and stds (metres, radians); None for no std."""
    stated: dict[str, tuple[float, float | None]] = {}
    if camera.height_agl_m is not None:
        stated["height"] = (camera.height_agl_m.value, camera.height_agl_m.std)
    for name in ("tilt", "roll", "heading"):
        angle: Known[float] | None = getattr(camera, f"{name}_deg")
        if angle is not None:
            stated[name] = (math.radians(angle.value), None if angle.std is None else math.radians(angle.std))
    if camera.focal_px is not None:
        stated["focal"] = (camera.focal_px.value, camera.focal_px.std)
    if camera.place is not None:
        local_m = frame.local_m((*camera.place, frame.origin[2])[:SPACE]).tolist()
        stds = camera.place_std_m or (None,) * len(camera.place)
        stated |= {name: (local_m[axis], std) for axis, (name, std) in enumerate(zip(_PLACE_NAMES, stds, strict=False))}
    return stated


def priors_from(table: EvidenceTable, frame: LocalFrame) -> tuple[dict[str, Prior], frozenset[str]]:
    """What is known beforehand by the unknowns' names, and which of it is exact (and has a std of 0)."""
    stated = camera_priors(table.camera, frame)
    if table.elevation_m is not None:
        stated["elevation"] = (0.0, table.elevation_m.std)
    priors = {name: Prior(value=value, std=std or 0.0) for name, (value, std) in stated.items()}
    return priors, frozenset(name for name, (_, std) in stated.items() if std is None)
