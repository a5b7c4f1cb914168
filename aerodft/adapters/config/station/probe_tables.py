"""The tables ``[[probe]]``: what a station measures."""

from collections.abc import Mapping
from typing import Annotated, ClassVar, Self

from pydantic import AfterValidator, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.tables import ROWS, SiAttribute, Table, si_value
from aerodft.dft import PROBE_KINDS, at_own_heights, probe_end
from aerodft.errors import ConfigError, Reason, UsageError, counted
from aerodft.model import (
    Camera,
    KnownPoint,
    PixelSource,
    Probe,
    ProbeKind,
)


def river_probes(probes: tuple[Probe, ...]) -> tuple[Probe, ...]:
    """The probes whose banks may be looked for."""
    return tuple(each for each in probes if each.kind == ProbeKind.RIVER and each.source is PixelSource.OBSERVED)


_EDGE_PX = -0.5  # pixel (0, 0) is the centre of the top-left pixel


def _kind(name: str) -> ProbeKind:
    kind = ProbeKind(name)
    if kind not in PROBE_KINDS:
        hint = "what moves is followed with [objects]" if kind == ProbeKind.TRACK else ""
        raise impossible("", got=f'"{kind}"', expected=f"one of {', '.join(PROBE_KINDS)}", hint=hint)
    return kind


class ProbeTable(Table):
    """One thing to measure."""

    INSTEAD_OF: ClassVar = {"on_top_of": ("elevation_m", "elevation_std_m")}

    name: keys.Slug
    kind: Annotated[str, AfterValidator(_kind)]
    pixels: Annotated[keys.Many[keys.End] | None, ROWS] = None
    observed: Annotated[bool, SiAttribute("source", out=lambda source: source is PixelSource.OBSERVED or None)] = False
    tracked: Annotated[bool, SiAttribute("source", out=lambda source: source is PixelSource.TRACKED or None)] = False
    at: Annotated[keys.Instant | None, SiAttribute("at_ns")] = None
    std_px: keys.NonNegative = 1.0
    elevation_m: keys.Elevations = 0.0
    elevation_std_m: keys.ElevationStds = 0.0
    on_top_of: keys.Slug | None = None

    @model_validator(mode="after")
    def _fixed_or_observed(self) -> Self:
        if self.observed and self.pixels is not None:
            raise impossible("pixels", got=Reason("it stands beside observed = true"), expected="one of the two")
        if self.observed and self.tracked:
            raise impossible("tracked", got=Reason("it stands beside observed = true"), expected="one of the two")
        if self.at is not None and not self.tracked:
            raise impossible(
                "at", got=Reason("it stands without tracked = true"), expected="the time of the image of tracked pixels"
            )
        if not self.observed and self.pixels is None:
            raise impossible("pixels", got="nothing", expected="[[u, v], ...], or observed = true")
        kind = PROBE_KINDS[ProbeKind(self.kind)]
        if self.pixels is not None and not kind.takes_pixels(len(self.pixels)):
            expected = f"{kind.pixels_wanted} for {self.kind}"
            raise impossible("pixels", got=counted(len(self.pixels), "pixel"), expected=expected)
        count = self.elevation_count if self.pixels is None else len(self.pixels)
        if any(isinstance(end, str) for end in self.pixels or ()):
            if self.on_top_of is not None:
                expected = "[u, v]: the object has the height"
                raise impossible("pixels", got=Reason("a surveyed point stands beside on_top_of"), expected=expected)
        elif wrong := kind.wrong_elevations(self.elevation_m, self.elevation_std_m, count):
            raise impossible("elevation_m", got=wrong, expected=f"{kind.elevations_wanted(count)} of {self.kind}")
        return self

    @property
    def elevation_count(self) -> int:
        """Number of elevations: of points that are observed, of which nobody knows yet how many there are."""
        stated = (self.elevation_m, self.elevation_std_m)
        return max(len(each) if isinstance(each, tuple) else 1 for each in stated)


def probes_from(tables: tuple[ProbeTable, ...], camera: Camera, points: Mapping[str, KnownPoint]) -> tuple[Probe, ...]:
    """The configured probes.

    Args:
        tables: Of the probes.
        camera: In whose image fixed pixels must lie.
        points: Surveyed points by name, whose heights count from the measured plane.

    Raises:
        ConfigError: A name twice, a fixed pixel outside the camera's image, an unknown surveyed point, or a probe on
            top of what is no height.
    """
    names = [table.name for table in tables]
    for index, table in enumerate(tables):
        if table.name in names[:index]:
            raise ConfigError(f"probe[{index}].name", got=f'"{table.name}" again', expected="a name of its own")
        if table.on_top_of is not None:
            _check_object(table.on_top_of, tables, f"probe[{index}].on_top_of")
    probes = tuple(_probe(table, points) for table in tables)
    for probe in probes:
        _check_in_image(probe, camera)
    return probes


def _probe(table: ProbeTable, points: Mapping[str, KnownPoint]) -> Probe:
    """A probe of its table, with pixels and heights of the surveyed points that it names."""
    if table.pixels is None:
        return si_value(Probe, table, source=_source(table))
    stated = table.elevation_m, table.elevation_std_m
    try:
        ends = [probe_end(end, points) for end in table.pixels]
        pixels, elevation_m, std_m = at_own_heights(ProbeKind(table.kind), ends, *stated)
    except UsageError as error:
        got, expected = error.got, error.expected
        raise ConfigError(f'probe "{table.name}": {error.what}', got=got, expected=expected) from None
    return si_value(Probe, table, source=_source(table), pixels=pixels, elevation_m=elevation_m, elevation_std_m=std_m)


def _check_in_image(probe: Probe, camera: Camera) -> None:
    right_px, bottom_px = camera.width_px + _EDGE_PX, camera.height_px + _EDGE_PX
    for u, v in probe.pixels:
        if not (_EDGE_PX <= u <= right_px and _EDGE_PX <= v <= bottom_px):
            raise ConfigError(
                f'probe "{probe.name}" lies outside the image',
                got=f"pixel ({u:g}, {v:g})",
                expected=f"within (-0.5, -0.5) to ({right_px:g}, {bottom_px:g}) of {camera.name}",
            )


def _source(table: ProbeTable) -> PixelSource:
    if table.tracked:
        return PixelSource.TRACKED
    return PixelSource.OBSERVED if table.observed else PixelSource.FIXED


def _check_object(name: str, tables: tuple[ProbeTable, ...], key: str) -> None:
    """Refuse to lie on top of anything but an object that stands on the ground, seen in fixed pixels."""
    found = next((table for table in tables if table.name == name), None)
    if found is None:
        got = f'"{name}", which is not there'
    elif found.kind != ProbeKind.HEIGHT:
        got = f'"{name}", which measures a {found.kind}'
    elif found.observed or found.tracked:
        got = f'"{name}", of which the pixels are {_source(found)}'
    elif found.on_top_of is not None:
        got = f'"{name}", which lies on top of "{found.on_top_of}"'
    else:
        return
    expected = "a height on the ground with pixels of its own"
    raise ConfigError(f"{key}: lies on no object", got=got, expected=expected)
