"""Pixels of one probe at one image stamp, whoever found them."""

from dataclasses import dataclass
from typing import Final, TypeAlias

from aerodft.model.image import Image, ImageRows, StampClock
from aerodft.model.telemetry import RawBlock

VISION: Final = "vision"
"""The source of observations that aerodft itself made in an image."""

Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """One probe's pixels, or the outline of what it measures, at one stamp.

    Attributes:
        name: The probe's name.
        stamp_ns: The stamp of the image that was looked at, by ``clock``.
        pixels: ``((u, v), ...)``; empty beside an outline.
        std_px: Standard deviation of each coordinate; None where the probe's own applies.
        image: Index of the image, where known.
        source: Who observed: a file's name, a topic, ``vision``.
        arrival_ns: When it reached this machine (for files: the stamp).
        box: Left, top, right and bottom limit of an object; where its limits are, not its last pixels' centres.
        contour: Corners of its closed outline, as exact as the box; of box, contour and pixels there is one, or none.
        unseen: Why there is none: it was looked for, and not seen; empty where nobody says.
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
        """What aerodft itself sees in an image."""
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
        """Whether it is an object's outline that was observed, and no pixels."""
        return self.box is not None or bool(self.contour)

    @property
    def is_empty(self) -> bool:
        """Whether somebody looked, and saw nothing."""
        return not self.pixels and not self.has_outline


Event: TypeAlias = RawBlock | Image | Observation
Arrival: TypeAlias = Event | ImageRows
"""An event, or many images that are read together."""
