"""What to measure, and where its pixels come from."""

from dataclasses import dataclass
from enum import StrEnum


class ProbeKind(StrEnum):
    """What a probe measures."""

    POSITION = "position"
    RANGE = "range"
    DISTANCE = "distance"
    WIDTH = "width"
    LENGTH = "length"
    AREA = "area"
    HEIGHT = "height"
    BEARING = "bearing"
    RIVER = "river"  # the median of its widths: pairs of bank pixels, left then right
    TRACK = "track"  # of what moves: its speed, and where it is; nobody asks for it with pixels


class PixelSource(StrEnum):
    """Where a probe's pixels come from."""

    FIXED = "fixed"
    OBSERVED = "observed"
    TRACKED = "tracked"  # those of one image, found again in the others


_MOST = 64
_PIXELS = {
    ProbeKind.POSITION: (1, 1),
    ProbeKind.RANGE: (1, 1),
    ProbeKind.DISTANCE: (2, 2),
    ProbeKind.WIDTH: (2, 2),
    ProbeKind.HEIGHT: (2, 2),  # base, then top
    ProbeKind.BEARING: (1, 2),  # of a ray, or from the first point to the second
    ProbeKind.LENGTH: (2, _MOST),
    ProbeKind.AREA: (3, _MOST),
    ProbeKind.RIVER: (2, _MOST),
}


ASKED_KINDS = tuple(kind for kind in ProbeKind if kind in _PIXELS)
"""What a probe can be of."""


def takes_pixels(kind: ProbeKind, count: int) -> bool:
    """Whether a probe of this kind can have so many pixels."""
    least, most = _PIXELS[kind]
    return least <= count <= most and (kind is not ProbeKind.RIVER or count % 2 == 0)


def pixels_wanted(kind: ProbeKind) -> str:
    """How many pixels a probe of this kind has, for people."""
    least, most = _PIXELS[kind]
    if kind is ProbeKind.RIVER:
        return f"{least} to {most}, an even number"
    return str(least) if least == most else f"{least} to {most}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Probe:
    """One thing to measure in every image.

    Attributes:
        name: Unique; the last part of its key expression.
        kind: What is measured.
        source: Fixed pixels, or pixels that somebody observes.
        pixels: ``((u, v), ...)`` for a fixed probe, of one image for a tracked one, else empty.
        std_px: Standard deviation of each pixel coordinate, unless the observation brings its own.
        elevation_m: Height of the measured surface above the ground; level ground is the height's datum plane.
        elevation_std_m: Its standard deviation, shared by all points of the probe.
        on_top_of: Name of a ``height`` in the same image: the probe lies in the level plane through that object's top,
            ``elevation_m`` is 0.
        at_ns: UTC of the image that a tracked probe's pixels are of; None for the first.
    """

    name: str
    kind: ProbeKind
    source: PixelSource = PixelSource.FIXED
    pixels: tuple[tuple[float, float], ...] = ()
    std_px: float = 1.0
    elevation_m: float = 0.0
    elevation_std_m: float = 0.0
    on_top_of: str | None = None
    at_ns: int | None = None

    def __post_init__(self) -> None:
        if self.source is not PixelSource.OBSERVED and not takes_pixels(self.kind, len(self.pixels)):
            wanted = pixels_wanted(self.kind)
            raise ValueError(f"probe {self.name}: {len(self.pixels)} pixels for {self.kind}, needs {wanted}")
