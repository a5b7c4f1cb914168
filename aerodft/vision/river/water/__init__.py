"""Which part of an image is water: by a network, by what moves, and by what a person says."""

from aerodft.vision.river.water.hints import RiverHints, hinted
from aerodft.vision.river.water.mask import WaterMask, find_water, opened, piece_with, with_islands
from aerodft.vision.river.water.motion import (
    LATEST_S,
    SOONEST_S,
    STAYS,
    LaterLook,
    motion_copy,
    what_stays,
    without_still,
)
from aerodft.vision.river.water.network import WaterNetwork
from aerodft.vision.river.water.plane import SmallCopy, WaterPlane, ground_of
