"""The tables of a file of evidence, with their checks: observations, each of which makes its own, and the camera."""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Generic, Self, TypeVar

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.evidence.local_frame import LocalFrame
from aerodft.adapters.config.keys import Quantity, impossible
from aerodft.adapters.config.tables import LOCAL, SiAttribute, Table, ValueOrTable, si_value
from aerodft.errors import Reason, counted
from aerodft.model import (
    Evidence,
    GroundLines,
    GroundPoint,
    Horizon,
    KnownHeight,
    KnownLength,
    Landmark,
    Prior,
    Px,
    SlantRange,
    Vertical,
)

Place = tuple[float | None, ...]

UNKNOWN = "?"
"""What stands for a component of a place that nobody knows."""

GEO_KEYS = ("lat_deg", "lon_deg", "alt_m")

PLANE, SPACE = 2, 3
_PLACE_NAMES = ("east", "north", "height")
_MOST_LAT_DEG, _MOST_LON_DEG = 90.0, 360.0


def _component(value: object) -> object:
    if not isinstance(value, str):
        return value
    if value.strip() != UNKNOWN:
        raise impossible("", got=f'"{value}"', expected=f'a number, or "{UNKNOWN}" where it is not known')
    return None


def _in_rows(value: object) -> object:
    if isinstance(value, dict):
        raise impossible("", got="one table in single brackets", expected="its name in double brackets, like [[range]]")
    return value


def _line(line: tuple[Px, Px]) -> tuple[Px, Px]:
    if line[0] == line[1]:
        raise impossible("", got=f"{list(line[0])} twice", expected="two pixels that differ")
    return line


def _distinct(pixels: tuple[Px, ...]) -> tuple[Px, ...]:
    if len(set(pixels)) < len(pixels):
        twice = next(pixel for pixel in pixels if pixels.count(pixel) > 1)
        raise impossible("", got=f"{list(twice)} twice", expected="pixels that differ")
    return pixels


Row = TypeVar("Row", bound=Table)
Std = Annotated[float, Field(ge=0, le=1e6)]
StdPx = Annotated[float, Field(ge=1e-6, le=1e6)]
Component = Annotated[keys.Real | None, BeforeValidator(_component)]
Position = Annotated[tuple[Component, Component, Component], Field(strict=False)]
StdM = Annotated[tuple[Std, Std, Std], Field(strict=False), keys.broadcast_to(SPACE)]
Line = Annotated[tuple[keys.Pixel, keys.Pixel], Field(strict=False), AfterValidator(_line)]


PriorStd = Annotated[float, Field(gt=0, le=1e9)]
PlaceStd = Annotated[tuple[PriorStd, ...], Field(strict=False), keys.broadcast_to(1)]
Rows = Annotated[tuple[Row, ...], Field(strict=False), BeforeValidator(_in_rows)]


class InDegrees(Table):
    """A table whose place may be given in degrees."""

    lat_deg: Component = None
    lon_deg: Component = None
    alt_m: Component = None


def check_geo(table: InDegrees, *, needs_alt: bool) -> None:
    """Refuse half of a place in degrees, and one off the earth (for validators)."""
    for key in GEO_KEYS if needs_alt else GEO_KEYS[:-1]:
        if key not in table.model_fields_set:
            hint = f'write "{UNKNOWN}" for the one component that nobody knows' if needs_alt else ""
            raise impossible(key, got="nothing", expected="a number", hint=hint)
    lat_deg, lon_deg = table.lat_deg, table.lon_deg
    if lat_deg is not None and abs(lat_deg) > _MOST_LAT_DEG:
        is_swapped = abs(lat_deg) <= _MOST_LON_DEG and lon_deg is not None and abs(lon_deg) <= _MOST_LAT_DEG
        hint = "swap lat_deg and lon_deg" if is_swapped else ""
        raise impossible("lat_deg", got=f"{lat_deg:.10g}", expected="-90 to 90", hint=hint)
    if lon_deg is not None and not -_MOST_LON_DEG / 2 <= lon_deg <= _MOST_LON_DEG:
        raise impossible("lon_deg", got=f"{lon_deg:.10g}", expected="-180 to 360")


class ObservationTable(Table):
    """One observation in an image: the keys that all kinds have.

    Attributes:
        makes: The observation that the table describes.
        may_be_outside: Its pixels need not be in the image.
    """

    makes: ClassVar[type[Evidence]]
    may_be_outside: ClassVar = False
    name: keys.Text | None = None
    image: keys.Text | None = None
    std_px: StdPx = 1.0

    @property
    def place(self) -> Place | None:
        """Place of what is observed in the file's coordinates; None where it has none."""
        return None

    @property
    def is_geo(self) -> bool:
        """Whether the place is in degrees."""
        return False

    @property
    def all_pixels(self) -> tuple[Px, ...]:
        """All pixels of the observation."""
        stated = (getattr(self, key, ()) for key in ("pixel", "pixels", "base", "top", "lines"))
        return tuple((float(u), float(v)) for each in stated for u, v in np.reshape(each, (-1, 2)))

    def observation(self, name: str, frame: LocalFrame) -> Evidence:  # noqa: ARG002 - for places
        """The observation, under a name, in metres of a frame."""
        return si_value(self.makes, self, name=name)


class LandmarkTable(ObservationTable, InDegrees):
    """A pixel and its place, by ``position_m`` or by latitude, longitude and altitude."""

    INSTEAD_OF: ClassVar = {"position_m": GEO_KEYS}

    makes = Landmark
    pixel: keys.Pixel
    position_m: Position | None = None
    std_m: StdM = (0.0, 0.0, 0.0)

    @property
    def is_geo(self) -> bool:
        """Whether the landmark's place is in degrees."""
        return self.position_m is None

    @property
    def place(self) -> Place:
        """Place of the landmark in the file's coordinates; None in it for an unknown component."""
        return self.position_m if self.position_m is not None else (self.lat_deg, self.lon_deg, self.alt_m)

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        in_degrees = [key for key in GEO_KEYS if key in self.model_fields_set]
        if self.position_m is None and not in_degrees:
            raise impossible("position_m", got="nothing", expected=f"position_m, or {', '.join(GEO_KEYS)}")
        if in_degrees:
            self._check_not_a_pixel()
            check_geo(self, needs_alt=True)
        if self.place.count(None) > 1:
            hint = "it says nothing otherwise: leave it out"
            key = "" if self.is_geo else "position_m"
            raise impossible(key, got=f"{self.place.count(None)} unknown", expected="one at most", hint=hint)
        return self

    def _check_not_a_pixel(self) -> None:
        lat_deg, (u, v) = self.lat_deg, self.pixel
        if lat_deg is not None and lat_deg > _MOST_LON_DEG and abs(u) <= _MOST_LON_DEG and abs(v) <= _MOST_LON_DEG:
            got = f"{lat_deg:.10g}, and a pixel {list(self.pixel)} that would be a place"
            hint = "swap pixels and places: they look interchanged"
            raise impossible("lat_deg", got=got, expected="-90 to 90", hint=hint)

    def observation(self, name: str, frame: LocalFrame) -> Landmark:
        """The landmark; on its way into the frame, the frame's zero stands in for what is not known."""
        place = self.place
        whole = [zero if value is None else value for value, zero in zip(place, frame.origin, strict=True)]
        axes = (1, 0, 2) if self.is_geo else (0, 1, 2)
        local_m = zip(axes, frame.local_m(whole).tolist(), strict=True)
        east_m, north_m, up_m = (None if place[axis] is None else each_m for axis, each_m in local_m)
        return si_value(Landmark, self, name=name, position_m=(east_m, north_m, up_m))


class _MeasuredTable(ObservationTable):
    std_m: Std = 0.0


class RangeTable(_MeasuredTable):
    """A pixel on the ground and its distance from the camera."""

    makes = SlantRange
    pixel: keys.Pixel
    range_m: keys.Positive


class GroundPointTable(_MeasuredTable):
    """A pixel on the ground and its place to the right and ahead of the camera's foot."""

    makes = GroundPoint
    pixel: keys.Pixel
    xy_m: Annotated[tuple[keys.Real, keys.Real], Field(strict=False)]


class LengthTable(_MeasuredTable):
    """Two pixels and their distance on the map."""

    makes = KnownLength
    pixels: Line
    length_m: keys.Positive
    elevation_m: keys.Real = 0.0


class KnownHeightTable(_MeasuredTable):
    """Base and top of an upright object on the ground."""

    makes = KnownHeight
    base: keys.Pixel
    top: keys.Pixel
    height_m: keys.Positive

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if self.base == self.top:
            raise impossible("top", got=f"{list(self.top)}, the pixel of base", expected="another pixel")
        return self


class VerticalTable(ObservationTable):
    """Two pixels of one vertical line."""

    makes = Vertical
    pixels: Line


class ParallelTable(ObservationTable):
    """Two level lines, two pixels each, that are parallel."""

    makes = GroundLines
    at_right_angle: ClassVar = False
    lines: Annotated[tuple[Line, Line], Field(strict=False)]

    @model_validator(mode="after")
    def _two_lines(self) -> Self:
        if set(self.lines[0]) == set(self.lines[1]):
            raise impossible("lines", got="one line twice", expected="two lines")
        return self

    def observation(self, name: str, frame: LocalFrame) -> GroundLines:  # noqa: ARG002 - for places
        """The observation, under a name."""
        first, second = self.lines
        return si_value(GroundLines, self, name=name, first=first, second=second, at_right_angle=self.at_right_angle)


class RightAngleTable(ParallelTable):
    """Two level lines at a right angle to each other."""

    at_right_angle = True


class HorizonTable(ObservationTable):
    """Pixels on the horizon."""

    makes = Horizon
    may_be_outside = True
    pixels: Annotated[tuple[keys.Pixel, ...], Field(strict=False, min_length=PLANE), AfterValidator(_distinct)]
    sea: Annotated[bool, SiAttribute("is_sea")] = False


class KnownValue(ValueOrTable, Generic[Quantity]):
    """A quantity and how well it is known; a bare one is taken as exact."""

    value: Quantity
    std: PriorStd | None = None


class PlaceTable(ValueOrTable):
    """East and north or easting and northing, and perhaps a height; one std for all, or one for each of them."""

    value: Annotated[tuple[keys.Real, ...], Field(strict=False, min_length=PLANE, max_length=SPACE)]
    std: PlaceStd | None = None

    @model_validator(mode="after")
    def _a_std_each(self) -> Self:
        _check_stds("std", self.std, len(self.value))
        return self


def _check_stds(key: str, std: tuple[float, ...] | None, size: int) -> None:
    if std is not None and len(std) not in {1, size}:
        raise impossible(key, got=counted(len(std), "std"), expected=f"one, or {size} as the position has")


class CameraPriorTable(InDegrees):
    """Priors of the camera, all optional; numbers, or ``{value, std}``."""

    INSTEAD_OF: ClassVar = {"position_m": GEO_KEYS}

    height_agl_m: KnownValue[keys.Positive] | None = None
    tilt_deg: KnownValue[keys.TiltDeg] | None = None
    roll_deg: KnownValue[keys.RollDeg] | None = None
    heading_deg: KnownValue[keys.HeadingDeg] | None = None
    focal_px: KnownValue[keys.Focal] | None = None
    position_m: PlaceTable | None = None
    position_std_m: PlaceStd | None = None

    @property
    def is_geo(self) -> bool:
        """Whether the camera's stated place is in degrees."""
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
        for key in in_degrees:
            if getattr(self, key) is None:
                raise impossible(key, got='"?"', expected="a number", hint="leave out what nobody knows")
        if in_degrees:
            check_geo(self, needs_alt=False)
        if self.position_std_m is not None:
            if not in_degrees:
                hint = "write position_m = { value = [...], std = ... }"
                raise impossible(
                    "position_std_m", got=Reason("it stands without lat_deg"), expected="lat_deg and lon_deg", hint=hint
                )
            _check_stds("position_std_m", self.position_std_m, len(in_degrees))
        if self.place is not None and len(self.place) == SPACE and self.height_agl_m is not None:
            key = "alt_m" if self.is_geo else "position_m"
            raise impossible(
                "height_agl_m", got=Reason(f"it stands beside a height in {key}"), expected="one of the two"
            )
        return self


class ImageTable(Table):
    """The image that the pixels were read in."""

    file: keys.Text | None = None
    width_px: keys.Count | None = None
    height_px: keys.Count | None = None

    @property
    def size_px(self) -> tuple[int, int] | None:
        """Width and height of the image; None where they are not stated."""
        return None if self.width_px is None or self.height_px is None else (self.width_px, self.height_px)

    @model_validator(mode="after")
    def _size_is_whole(self) -> Self:
        if (self.width_px is None) != (self.height_px is None):
            missing = "width_px" if self.width_px is None else "height_px"
            raise impossible(missing, got="nothing", expected="both width_px and height_px, or none of them")
        return self


class EvidenceTable(Table):
    """The file."""

    crs: keys.Text = LOCAL
    elevation_m: KnownValue[keys.Real] | None = None
    image: ImageTable = ImageTable()
    camera: CameraPriorTable = CameraPriorTable()
    landmark: Rows[LandmarkTable] = ()
    ranges: Rows[RangeTable] = Field(default=(), alias="range")
    ground: Rows[GroundPointTable] = ()
    length: Rows[LengthTable] = ()
    height: Rows[KnownHeightTable] = ()
    vertical: Rows[VerticalTable] = ()
    parallel: Rows[ParallelTable] = ()
    right_angle: Rows[RightAngleTable] = ()
    horizon: Rows[HorizonTable] = ()

    @property
    def images(self) -> Sequence[ImageTable]:
        """Tables of the images that the evidence is from."""
        return (self.image,)

    @property
    def cameras(self) -> Sequence[CameraPriorTable]:
        """Tables that state where a camera is."""
        return (self.camera,)

    @property
    def image_file(self) -> str | None:
        """File name of the one image, as stated."""
        return self.image.file


def camera_priors(camera: CameraPriorTable, frame: LocalFrame) -> dict[str, tuple[float, float | None]]:
    """Priors of a table by the unknowns' names: values and stds (metres, radians); None for no std."""
    stated: dict[str, tuple[float, float | None]] = {}
    if camera.height_agl_m is not None:
        stated["height"] = (camera.height_agl_m.value, camera.height_agl_m.std)
    for name in ("tilt", "roll", "heading"):
        angle: KnownValue[float] | None = getattr(camera, f"{name}_deg")
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
    """Priors by the unknowns' names, and which of them are exact (and have a std of 0)."""
    stated = camera_priors(table.camera, frame)
    if table.elevation_m is not None:
        stated["elevation"] = (0.0, table.elevation_m.std)
    priors = {name: Prior(value=value, std=std or 0.0) for name, (value, std) in stated.items()}
    return priors, frozenset(name for name, (_, std) in stated.items() if std is None)
