"""Observations: pixels of a probe, or the outline of an object, at one image stamp."""

from dataclasses import dataclass
from typing import Final, TypeAlias

from aerodft.model.image import Image, ImageRows, StampClock
from aerodft.model.telemetry import RawBlock

VISION: Final = "vision"
"""Source of observations by aerodft's own detectors."""

Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """Pixels of a probe, or the outline of its object, at one stamp.

    Attributes:
        name: The probe's name.
        stamp_ns: The image's stamp, by ``clock``.
        pixels: ``((u, v), ...)``; empty with an outline.
        std_px: Standard deviation of each coordinate; None for the probe's own.
        image: Index of the image, where known.
        source: Observer: a file's name, a topic, ``vision``.
        arrival_ns: When it reached this machine (for files: the stamp).
        box: Left, top, right and bottom limits of an object: its edges, not the centres of its outermost pixels.
        contour: Corners of its closed outline, exact as ``box``. At most one of box, contour and pixels is given.
        unseen: Why a detector found nothing; empty where unknown.
    """

    name: str
    stamp_ns: int
    arrival_ns: int
    pixels: tuple[tuple[float, float], ...]
    std_px: float | None = None
    clock: StampClock = StampClock.UTC
    image: int | None = None
    source: str = ""
    box: Box | None = None
    contour: tuple[tuple[float, float], ...] = ()
    unseen: str = ""

    @classmethod
    def in_image(
        cls,
        image: Image,
        name: str,
        pixels: tuple[tuple[float, float], ...] = (),
        *,
        std_px: float | None = None,
        contour: tuple[tuple[float, float], ...] = (),
        unseen: str = "",
    ) -> "Observation":
        """An observation by one of aerodft's own detectors in an image."""
        return cls(
            name=name,
            stamp_ns=image.stamp_ns,
            arrival_ns=image.arrival_ns,
            pixels=pixels,
            clock=image.clock,
            image=image.index,
            source=VISION,
            std_px=std_px,
            contour=contour,
            unseen=unseen,
        )

    @property
    def has_outline(self) -> bool:
        """Whether the outline of an object was observed, not pixels."""
        return self.box is not None or bool(self.contour)

    @property
    def is_empty(self) -> bool:
        """Whether the observer found nothing."""
        return not self.pixels and not self.has_outline


Event: TypeAlias = RawBlock | Image | Observation
Arrival: TypeAlias = Event | ImageRows
"""An event, or the columns of many images."""
