"""What can become of a river in an image, and why."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from aerodft.model import FloatArray


class RiverStatus(StrEnum):
    """What became of a river, or of one transect."""

    OK = "ok"
    ABOVE_HORIZON = "ABOVE_HORIZON"  # the image shows no water plane near enough
    SEED_OFF_GROUND = "SEED_OFF_GROUND"  # what is pointed at is outside the image, above the horizon or too far away
    TOO_DARK = "TOO_DARK"  # night, or a covered lens
    TOO_BRIGHT = "TOO_BRIGHT"  # the banks are burnt out: glare
    NO_CONTRAST = "NO_CONTRAST"  # water and bank cannot be told apart
    ALL_WATER = "ALL_WATER"  # no bank anywhere
    NO_WATER = "NO_WATER"  # the seed is on a bank, or there is no water
    OUT_OF_IMAGE = "OUT_OF_IMAGE"  # the image ends before the bank
    ONE_BANK = "ONE_BANK"  # of a river, a lake or the sea: no width
    TOO_COARSE = "TOO_COARSE"  # the river is too narrow in the image
    UNLIKE_NEIGHBOURS = "UNLIKE_NEIGHBOURS"  # a bank stands out: something is in front of it, or the mask leaked
    AMBIGUOUS = "AMBIGUOUS"  # another outline, nearly as clear, has a bank elsewhere
    ILL_CONDITIONED = "ILL_CONDITIONED"  # too uncertain for a number
    CONTRADICTORY = "CONTRADICTORY"  # images give other widths of one place than their stated errors explain


WHY: Final = {
    RiverStatus.OUT_OF_IMAGE: "the image does not show both banks: the river leaves it, or only one bank is in view",
    RiverStatus.ONE_BANK: "only one bank is in view, of a river, a lake or the sea: there is no width",
    RiverStatus.TOO_COARSE: "the river is too narrow in the image for its banks to be told",
    RiverStatus.UNLIKE_NEIGHBOURS: "a bank stands out from its neighbours: is something in front of it?",
    RiverStatus.AMBIGUOUS: "another outline, nearly as clear, has a bank elsewhere: look at the plate",
    RiverStatus.ILL_CONDITIONED: "too far away for how well the pose is known",
}
"""Of transects, and of images, without a width."""


@dataclass(frozen=True, slots=True, eq=False)
class NoRiver:
    """Why there is no width.

    Attributes:
        status: In a word.
        reason: In a sentence.
        banks_px: What is seen of the left and the right bank all the same, lines ``(k, 2)`` of the image; empty where
            nothing is.
    """

    status: RiverStatus
    reason: str
    banks_px: tuple[FloatArray, FloatArray] = (np.empty((0, 2)), np.empty((0, 2)))
