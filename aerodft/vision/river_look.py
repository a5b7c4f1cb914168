"""How banks are looked for: settings alone, for those who read configurations and look at no image."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RiverLook:
    """How banks are looked for.

    Attributes:
        every_s: Least time between two looks; 0 for every image.
        spacing_m: Of the transects; up to 32 of them, evenly chosen, become one observation.
        seed_px: A pixel in the water of every image; None for the lower middle.
        max_range_m: Water farther than this is left out; None for 6 camera heights.
    """

    every_s: float = 1.0
    spacing_m: float = 1.0
    seed_px: tuple[float, float] | None = None
    max_range_m: float | None = None
