"""The tables of a file of evidence, with their checks; each makes the observation that it describes."""

from abc import ABC, abstractmethod
from typing import Annotated, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from aerodft.adapters.config.tables import (
    Pixel,
    Positive,
    Real,
    Table,
    Text,
    impossible,
)
from aerodft.model.evidence import (
    Evidence,
    GroundLines,
    GroundPoint,
    Horizon,
    KnownHeight,
    KnownLength,
    Px,
    SlantRange,
    Vertical,
)

UNKNOWN = "?"
"""What stands for a component of a place that nobody knows."""

GEO_KEYS = ("lat_deg", "lon_deg", "alt_m")

PLANE, SPACE = 2, 3
_MOST_LAT_DEG, _MOST_LON_DEG = 90.0, 360.0


def _component(value: object) -> object:
    if not isinstance(value, str):
        return value
    if value.strip() != UNKNOWN:
        raise impossible("", got=f'"{value}"', expected=f'a number, or "{UNKNOWN}" where it is not known')
    return None


def _thrice(value: object) -> object:
    return (value,) * SPACE if isinstance(value, int | float) and not isinstance(value, bool) else value


def _line(line: tuple[Px, Px]) -> tuple[Px, Px]:
    if line[0] == line[1]:
        raise impossible("", got=f"{list(line[0])} twice", expected="two pixels that differ")
    return line


def _distinct(pixels: tuple[Px, ...]) -> tuple[Px, ...]:
    if len(set(pixels)) < len(pixels):
        twice = next(pixel for pixel in pixels if pixels.count(pixel) > 1)
        raise impossible("", got=f"{list(twice)} twice", expected="pixels that differ")
    return pixels


Std = Annotated[float, Field(ge=0, le=1e6)]
StdPx = Annotated[float, Field(ge=1e-6, le=1e6)]
Component = Annotated[Real | None, BeforeValidator(_component)]
Position = Annotated[tuple[Component, Component, Component], Field(strict=False)]
StdM = Annotated[tuple[Std, Std, Std], Field(strict=False), BeforeValidator(_thrice)]
Line = Annotated[tuple[Pixel, Pixel], Field(strict=False), AfterValidator(_line)]


class InDegrees(Table):
    """What may have a place in degrees."""

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


class LandmarkTable(InDegrees):
    """A pixel and its place, by ``position_m`` or by latitude, longitude and altitude."""

    name: Text | None = None
    image: Text | None = None
    pixel: Pixel
    position_m: Position | None = None
    std_px: StdPx = 1.0
    std_m: StdM = (0.0, 0.0, 0.0)

    @property
    def is_geo(self) -> bool:
        """Its place is in degrees."""
        return self.position_m is None

    @property
    def place(self) -> tuple[float | None, float | None, float | None]:
        """Its place in the file's coordinates."""
        return self.position_m if self.position_m is not None else (self.lat_deg, self.lon_deg, self.alt_m)

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        in_degrees = [key for key in GEO_KEYS if key in self.model_fields_set]
        if self.position_m is not None and in_degrees:
            raise impossible(in_degrees[0], got="it beside position_m", expected="one of the two")
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


class ObservationTable(Table, ABC):
    """What is known without a place in the world."""

    name: Text | None = None
    image: Text | None = None
    std_px: StdPx = 1.0

    @abstractmethod
    def made(self, name: str) -> Evidence:
        """What the table describes, under a name."""


class _MeasuredTable(ObservationTable):
    std_m: Std = 0.0


class RangeTable(_MeasuredTable):
    """A pixel on the ground and its distance from the camera."""

    pixel: Pixel
    range_m: Positive

    def made(self, name: str) -> SlantRange:
        """As :class:`SlantRange`."""
        return SlantRange(name=name, pixel=self.pixel, range_m=self.range_m, std_px=self.std_px, std_m=self.std_m)


class GroundPointTable(_MeasuredTable):
    """A pixel on the ground and its place to the right and ahead of the camera's foot."""

    pixel: Pixel
    xy_m: Annotated[tuple[Real, Real], Field(strict=False)]

    def made(self, name: str) -> GroundPoint:
        """As :class:`GroundPoint`."""
        return GroundPoint(name=name, pixel=self.pixel, xy_m=self.xy_m, std_px=self.std_px, std_m=self.std_m)


class LengthTable(_MeasuredTable):
    """Two pixels and their distance on the map."""

    pixels: Line
    length_m: Positive
    elevation_m: Real = 0.0

    def made(self, name: str) -> KnownLength:
        """As :class:`KnownLength`."""
        return KnownLength(
            name=name,
            pixels=self.pixels,
            length_m=self.length_m,
            elevation_m=self.elevation_m,
            std_px=self.std_px,
            std_m=self.std_m,
        )


class HeightTable(_MeasuredTable):
    """Base and top of an upright object on the ground."""

    base: Pixel
    top: Pixel
    height_m: Positive

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if self.base == self.top:
            raise impossible("top", got=f"{list(self.top)}, the pixel of base", expected="another pixel")
        return self

    def made(self, name: str) -> KnownHeight:
        """As :class:`KnownHeight`."""
        return KnownHeight(
            name=name,
            base=self.base,
            top=self.top,
            height_m=self.height_m,
            std_px=self.std_px,
            std_m=self.std_m,
        )


class VerticalTable(ObservationTable):
    """Two pixels of one vertical line."""

    pixels: Line

    def made(self, name: str) -> Vertical:
        """As :class:`Vertical`."""
        return Vertical(name=name, pixels=self.pixels, std_px=self.std_px)


class ParallelTable(ObservationTable):
    """Two level lines, two pixels each, that are parallel."""

    lines: Annotated[tuple[Line, Line], Field(strict=False)]

    @model_validator(mode="after")
    def _two_lines(self) -> Self:
        if set(self.lines[0]) == set(self.lines[1]):
            raise impossible("lines", got="one line twice", expected="two lines")
        return self

    def made(self, name: str) -> GroundLines:
        """As :class:`GroundLines`."""
        return self._lines(name, at_right_angle=False)

    def _lines(self, name: str, *, at_right_angle: bool) -> GroundLines:
        first, second = self.lines
        return GroundLines(name=name, first=first, second=second, at_right_angle=at_right_angle, std_px=self.std_px)


class RightAngleTable(ParallelTable):
    """Two level lines at a right angle to each other."""

    def made(self, name: str) -> GroundLines:
        """As :class:`GroundLines`."""
        return self._lines(name, at_right_angle=True)


class HorizonTable(ObservationTable):
    """Pixels on the horizon."""

    pixels: Annotated[tuple[Pixel, ...], Field(strict=False, min_length=PLANE), AfterValidator(_distinct)]
    sea: bool = False

    def made(self, name: str) -> Horizon:
        """As :class:`Horizon`."""
        return Horizon(name=name, pixels=self.pixels, is_sea=self.sea, std_px=self.std_px)
