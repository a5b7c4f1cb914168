"""What to measure in one image, as small values: a kind each, with its pixels."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, TypeAlias

import numpy as np

from aerodft import model
from aerodft.conventions import LARGEST
from aerodft.dft import PROBE_KINDS, Request, link_requests
from aerodft.errors import UsageError
from aerodft.model import FloatArray, ProbeKind

Pixels: TypeAlias = Sequence[float] | Sequence[tuple[float, float]] | FloatArray
"""One pixel ``(u, v)``, or several; (0, 0) is the middle of the top-left pixel."""


@dataclass(frozen=True, slots=True)
class ImageProbe:
    """What to measure at some pixels of one image.

    Attributes:
        pixels: One ``(u, v)`` or several; (0, 0) is the middle of the top-left pixel, u to the right, v down.
        elevation_m: Height of the measured surface above the ground.
        name: What the measurement is called; None for the kind and its place among the probes, ``width-1``.
        std_px: Standard deviation of each pixel coordinate.
        elevation_std_m: Standard deviation of the elevation.
        on_top_of: Name of a ``Height`` of the same image: the pixels lie in the level plane through that object's top,
            and ``elevation_m`` does not count.

    Raises:
        UsageError: A pixel is no pair of finite numbers, or there are too few or too many of the kind.
    """

    kind: ClassVar[ProbeKind]

    pixels: Pixels
    elevation_m: float = 0.0
    name: str | None = None
    std_px: float = 1.0
    elevation_std_m: float = 0.0
    on_top_of: str | None = None

    def __post_init__(self) -> None:
        pixels = np.asarray(self.pixels, dtype=np.float64)
        if pixels.size % 2 or not np.all(np.abs(pixels) <= LARGEST):
            raise UsageError(f"a {self.kind}", got=repr(self.pixels), expected="pixels (u, v) of finite numbers")
        pairs = tuple((u, v) for u, v in pixels.reshape(-1, 2).tolist())
        kind = PROBE_KINDS[self.kind]
        if not kind.takes_pixels(len(pairs)):
            wanted = f"{kind.pixels_wanted} for {self.kind}"
            raise UsageError(f"a {self.kind}", got=f"{len(pairs)} pixels", expected=wanted)
        object.__setattr__(self, "pixels", pairs)


class Position(ImageProbe):
    """Where a pixel's ground point is; a 95 % ellipse instead of one value.

    Example:
        >>> Position((1944, 1800), name="ford").pixels
        ((1944.0, 1800.0),)
    """

    kind = ProbeKind.POSITION


class Range(ImageProbe):
    """Slant range from the camera to a pixel's ground point, m.

    Example:
        >>> Range((1944, 493)).kind
        'range'
    """

    kind = ProbeKind.RANGE


class Distance(ImageProbe):
    """Horizontal distance of two ground points, m.

    Example:
        >>> Distance([(812, 604.5), (1377, 611)], elevation_m=0.5).elevation_m
        0.5
    """

    kind = ProbeKind.DISTANCE


class Width(ImageProbe):
    """Horizontal distance of two banks, or of two other edges, m.

    Example:
        >>> len(Width([(812, 1604), (1377, 1611)]).pixels)
        2
    """

    kind = ProbeKind.WIDTH


class Length(ImageProbe):
    """Horizontal length of the line through 2 to 256 ground points, m; what noise adds is taken off.

    Example:
        >>> len(Length([(812, 1604), (1100, 1700), (1377, 1611)]).pixels)
        3
    """

    kind = ProbeKind.LENGTH


class Area(ImageProbe):
    """Horizontal area of the polygon of 3 to 256 ground points in their order, m^2.

    Example:
        >>> len(Area([(1000, 1000), (2000, 1000), (1900, 2000)]).pixels)
        3
    """

    kind = ProbeKind.AREA


class Height(ImageProbe):
    """Height of an upright object, m: the pixel of its base, on the ground, then that of its top.

    Example:
        >>> mast = Height([(1500, 1500), (1500, 1000)], name="mast")
        >>> Width([(1480, 1000), (1520, 1000)], on_top_of="mast").on_top_of
        'mast'
    """

    kind = ProbeKind.HEIGHT


class Bearing(ImageProbe):
    """Azimuth of a pixel's ray, or from the first to the second ground point, deg clockwise from true north.

    Example:
        >>> Bearing((1944, 20)).kind
        'bearing'
    """

    kind = ProbeKind.BEARING


class RiverWidth(ImageProbe):
    """Median of the widths between pairs of bank pixels, left then right, m.

    Example:
        >>> len(RiverWidth([(500, 2000), (1000, 2100), (600, 1800), (1100, 1900)]).pixels)
        4
    """

    kind = ProbeKind.RIVER


PROBES: Final = {each.kind: each for each in ImageProbe.__subclasses__()}
"""The class of each kind of probe."""


def requests_of(probes: Iterable[ImageProbe]) -> tuple[Request, ...]:
    """The engine's requests of the probes of one image, in their order.

    Raises:
        UsageError: Two probes have one name, or ``on_top_of`` names no height that stands on the ground.
    """
    named: dict[str, model.Probe] = {}
    for index, probe in enumerate(probes):
        name = probe.name or f"{probe.kind}-{index + 1}"
        if name in named:
            raise UsageError(f"probe {index + 1}", got=f"the name {name} again", expected="its own name")
        named[name] = model.Probe(
            name=name,
            kind=probe.kind,
            pixels=tuple((u, v) for u, v in np.asarray(probe.pixels).tolist()),
            std_px=probe.std_px,
            elevation_m=0.0 if probe.on_top_of else probe.elevation_m,
            elevation_std_m=probe.elevation_std_m,
            on_top_of=probe.on_top_of,
        )
    try:
        return link_requests(Request(probe=probe, pixels=probe.pixels, std_px=probe.std_px) for probe in named.values())
    except ValueError as error:
        raise UsageError("`on_top_of`", got=str(error), expected="the name of a height of the same image") from None
