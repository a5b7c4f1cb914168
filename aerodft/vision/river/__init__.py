"""Rivers in images: water, banks, centreline and transects."""

from aerodft.vision.river.banks import ONE_SIDED, Islands, hidden_per_metre
from aerodft.vision.river.centreline import Centreline
from aerodft.vision.river.find import River, RiverQuestion, find_river
from aerodft.vision.river.observer import RiverObserver
from aerodft.vision.river.reach import Reach, RiverView, measure_reach
from aerodft.vision.river.status import WHY, NoRiver, RiverStatus
from aerodft.vision.river.water import (
    LATEST_S,
    SOONEST_S,
    LaterLook,
    RiverHints,
    WaterMask,
    WaterNetwork,
    WaterPlane,
    motion_copy,
)
