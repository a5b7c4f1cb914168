"""Rivers in images: water, banks, centreline and transects."""

from aerodft.vision.river.banks import ONE_SIDED, Islands, hidden_per_metre
from aerodft.vision.river.observer import (
    Reach,
    River,
    RiverObserver,
    RiverQuestion,
    RiverView,
    find_river,
    measure_reach,
)
from aerodft.vision.river.status import WHY, NoRiver, RiverStatus
from aerodft.vision.river.water import WaterMask, WaterNetwork
from aerodft.vision.river.water_features import WaterPlane, ground_of, water_likeness
from aerodft.vision.river.water_motion import LATEST_S, SOONEST_S, LaterLook, motion_copy
