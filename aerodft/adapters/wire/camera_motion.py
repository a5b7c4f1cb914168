"""``aerodft.steadiness/1``: whether a fixed camera still looks where it looked, after one look at its steady points."""

import math
from typing import Final

from aerodft.adapters.wire import payload as wire
from aerodft.model import CameraMotionEstimate
from aerodft.version import SOFTWARE

SCHEMA = "aerodft.steadiness/1"

_AXES: Final = ("tilt_deg", "pan_deg", "roll_deg")


def encode_steadiness(estimate: CameraMotionEstimate) -> bytes:
    """An estimate as ``aerodft.steadiness/1``."""
    turn, look = estimate.turn_rad, estimate.look_turn_rad
    return wire.dump(
        {
            "schema": SCHEMA,
            "stamp_ns": str(estimate.stamp_ns),
            "state": estimate.state,
            "since_ns": str(estimate.since_ns),
            "moved_ns": None if estimate.moved_ns is None else str(estimate.moved_ns),
            "angle_deg": math.degrees(math.hypot(*turn)),
            "turn": {
                name: {"value": math.degrees(value), "std": math.degrees(std)}
                for name, value, std in zip(_AXES, turn, estimate.std_rad, strict=True)
            },
            "look": None if look is None else {key: math.degrees(n) for key, n in zip(_AXES, look, strict=True)},
            "points": estimate.points,
            "agreeing": estimate.agreeing,
            "std_px": estimate.std_px,
            "calibration": estimate.calibration,
            "software": SOFTWARE,
        }
    )
