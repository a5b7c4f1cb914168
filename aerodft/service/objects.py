"""How moving objects are looked for and followed, in SI units; ``adapters.config`` makes it from TOML."""

from dataclasses import dataclass
from typing import Final

OBJECTS: Final = "objects"
"""Observations of that name are of whatever moves: an outline each, and one without anything where nothing does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSettings:
    """What is looked for in a fixed camera's images, and how it is followed over the ground.

    Attributes:
        detect: Whether aerodft looks itself; else all outlines come from outside.
        every_s: Least time between two looks; 0 for every image.
        shadows: Whether cast shadows are told from what casts them.
        least_px: What covers fewer pixels is noise.
        ignore: Polygons of pixels that move by themselves: water, trees, a road that is of no interest.
        std_px: Of where an outline has its edge.
        speed_mps: How fast objects are in each direction, a standard deviation, before the second look.
        acceleration_mps2: How much an object's velocity changes in a second, a standard deviation.
        confirm: Looks that have to see an object before it is one.
        forget_s: An object that is not seen for so long is given up.
        distances_within_m: Distances are measured between objects that are this close; 0 for none.
    """

    detect: bool = True
    every_s: float = 0.0
    shadows: bool = True
    least_px: int = 60
    ignore: tuple[tuple[tuple[float, float], ...], ...] = ()
    std_px: float = 2.0
    speed_mps: float = 3.0
    acceleration_mps2: float = 0.5
    confirm: int = 3
    forget_s: float = 5.0
    distances_within_m: float = 0.0
