"""``aerodft.calibration_estimate/1``: what a live calibration says after the landmarks of one image."""

import math
from typing import Final

from aerodft.adapters.wire.payload import dump_payload
from aerodft.model import BiasValues, CalibrationEstimate, CameraMotionEstimate
from aerodft.version import SOFTWARE

CALIBRATION_SCHEMA = "aerodft.calibration_estimate/1"

_SI: Final = ("height_m", "east_m", "north_m", "time_s")
_ANGLES: Final = ("tilt", "pan", "roll", "heading")


def encode_estimate(estimate: CalibrationEstimate) -> bytes:
    """An estimate as ``aerodft.calibration_estimate/1``."""
    values, stds = _wire(estimate.bias), _wire(estimate.std)
    return dump_payload(
        {
            "schema": CALIBRATION_SCHEMA,
            "stamp_ns": str(estimate.stamp_ns),
            "calibration": estimate.calibration,
            "height_source": estimate.height_source,
            "bias": {key: {"value": value, "std": stds[key]} for key, value in values.items()},
            "innovations": [
                {
                    "name": each.name,
                    "px": each.px,
                    "sigma_px": each.sigma_px,
                    "chi2": each.chi2,
                    "accepted": each.accepted,
                    "reason": each.reason,
                }
                for each in estimate.innovations
            ],
            "updates": estimate.updates,
            "refused": estimate.refused,
            "restarts": estimate.restarts,
            "software": SOFTWARE,
        }
    )


def _wire(values: BiasValues) -> dict[str, float]:
    """Keys with their units on the wire, in the schema's order."""
    lengths = {key: getattr(values, key) for key in _SI}
    return {**lengths, **{f"{name}_deg": math.degrees(getattr(values, f"{name}_rad")) for name in _ANGLES}}


CAMERA_MOTION_SCHEMA = "aerodft.camera_motion/1"

_AXES: Final = ("tilt_deg", "pan_deg", "roll_deg")


def encode_camera_motion(estimate: CameraMotionEstimate) -> bytes:
    """An estimate as ``aerodft.camera_motion/1``."""
    turn, look = estimate.turn_rad, estimate.look_turn_rad
    return dump_payload(
        {
            "schema": CAMERA_MOTION_SCHEMA,
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
