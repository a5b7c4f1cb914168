"""How banks are looked for, and what can become of a river in an image: no image is looked at here."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final


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


class RiverStatus(StrEnum):
    """What became of a river, or of one transect."""

    OK = "ok"
    ABOVE_HORIZON = "ABOVE_HORIZON"  # the image shows no water plane near enough
    SEED_OFF_GROUND = "SEED_OFF_GROUND"  # the seed is outside the image, above the horizon or too far away
    TOO_DARK = "TOO_DARK"  # night, or a covered lens
    TOO_BRIGHT = "TOO_BRIGHT"  # the banks are burnt out: glare
    NO_CONTRAST = "NO_CONTRAST"  # water and bank cannot be told apart
    ALL_WATER = "ALL_WATER"  # no bank anywhere
    NO_WATER = "NO_WATER"  # the seed is on a bank, or there is no water
    OUT_OF_IMAGE = "OUT_OF_IMAGE"  # the image ends before the bank
    TOO_COARSE = "TOO_COARSE"  # the river is too narrow in the image
    UNLIKE_NEIGHBOURS = "UNLIKE_NEIGHBOURS"  # a bank stands out: something is in front of it, or the mask leaked
    AMBIGUOUS = "AMBIGUOUS"  # another outline, nearly as clear, has a bank elsewhere
    ILL_CONDITIONED = "ILL_CONDITIONED"  # too uncertain for a number


WHY: Final = {
    RiverStatus.OUT_OF_IMAGE: "the image does not show both banks: the river leaves it, or only one bank is in view",
    RiverStatus.TOO_COARSE: "the river is too narrow in the image for its banks to be told",
    RiverStatus.UNLIKE_NEIGHBOURS: "a bank stands out from its neighbours: is something in front of it?",
    RiverStatus.AMBIGUOUS: "another outline, nearly as clear, has a bank elsewhere: look at the plate",
    RiverStatus.ILL_CONDITIONED: "too far away for how well the pose is known",
}
"""Of transects without a width."""


@dataclass(frozen=True, slots=True)
class NoRiver:
    """Why there is no answer."""

    status: RiverStatus
    reason: str
