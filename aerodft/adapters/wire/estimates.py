"""What a live calibration says after one image's landmarks, and whether a fixed camera still looks where it did."""

import math
from typing import Final

from aerodft.adapters.wire.json_schema import (
    COUNT,
    NUMBER,
    STAMP,
    STAMP_OR_NULL,
    TEXT,
    TEXT_OR_NULL,
    Payload,
    doc,
    list_of,
    object_of,
    one_of,
    or_null,
    payload_of,
)
from aerodft.adapters.wire.pose import HEIGHTS
from aerodft.model import CalibrationEstimate, CameraMotionEstimate, MotionState

CALIBRATION_SCHEMA = "aerodft.calibration_estimate/1"
CAMERA_MOTION_SCHEMA = "aerodft.camera_motion/1"

_BIAS = object_of({"value": NUMBER, "std": NUMBER})
_PAIR = or_null(list_of(NUMBER, length=2))
_BIASES = object_of(
    {
        "height_m": doc(_BIAS, "Of the height source in use"),
        "east_m": _BIAS,
        "north_m": _BIAS,
        "tilt_deg": doc(_BIAS, "About the camera's x axis; raises the tilt"),
        "pan_deg": doc(_BIAS, "About its y axis"),
        "roll_deg": doc(_BIAS, "About its z axis"),
        "heading_deg": doc(_BIAS, "About the vertical, clockwise"),
        "time_s": doc(_BIAS, "Of the images' stamps"),
    }
)
_NUMBERS: Final = object_of(dict.fromkeys(_BIASES["properties"], NUMBER))

CALIBRATION_ESTIMATE: Final = Payload(
    CALIBRATION_SCHEMA,
    "What is to be added to the telemetry, after the landmarks of one image",
    {
        "stamp_ns": doc(STAMP, "Of the image that they were seen in"),
        "calibration": doc(TEXT_OR_NULL, "What the next images' measurements name as their calibration"),
        "height_source": or_null(one_of(HEIGHTS)),
        "bias": _BIASES,
        "innovations": list_of(
            object_of(
                {
                    "name": doc(TEXT, "The landmark"),
                    "px": doc(_PAIR, "Observed minus expected pixel"),
                    "sigma_px": doc(_PAIR, "Standard deviations of the two"),
                    "chi2": doc(NUMBER, "Squared distance in standard deviations, of two degrees of freedom"),
                    "accepted": {"type": "boolean"},
                    "reason": doc(TEXT_OR_NULL, "Why it was refused"),
                }
            )
        ),
        "updates": doc(COUNT, "Landmarks used since the start"),
        "refused": doc(COUNT, "Landmarks refused since the start"),
        "restarts": doc(COUNT, "How often nearly all were refused, and the estimate began anew"),
    },
)

_TURN = {
    "tilt_deg": "About the camera's x axis now; raises the view",
    "pan_deg": "About its y axis; to the right",
    "roll_deg": "About its z axis; clockwise, seen from behind",
}

CAMERA_MOTION: Final = Payload(
    CAMERA_MOTION_SCHEMA,
    "Whether a fixed camera still looks where it looked, after one look at its steady points",
    {
        "stamp_ns": doc(STAMP, "Of the image that was looked at"),
        "state": one_of(MotionState),
        "since_ns": doc(STAMP, "The first look in this state"),
        "moved_ns": doc(STAMP_OR_NULL, "The first look that saw the camera where it rests by now, beyond the limit"),
        "angle_deg": doc(NUMBER, "By how much it has turned, about whichever axis"),
        "turn": object_of({name: doc(_BIAS, what) for name, what in _TURN.items()}),
        "look": doc(or_null(object_of(dict.fromkeys(_TURN, NUMBER))), "This look alone; null where it did not tell"),
        "points": doc(COUNT, "Found again"),
        "agreeing": doc(COUNT, "Those that the turn explains"),
        "std_px": doc(NUMBER, "Of one coordinate of these"),
        "calibration": doc(TEXT_OR_NULL, "What the next images' measurements name as their calibration"),
    },
)


def encode_estimate(estimate: CalibrationEstimate) -> bytes:
    """An estimate as ``aerodft.calibration_estimate/1``."""
    values, stds = (payload_of(_NUMBERS, each) for each in (estimate.bias, estimate.std))
    return CALIBRATION_ESTIMATE.dump(
        estimate, bias={key: {"value": value, "std": stds[key]} for key, value in values.items()}
    )


def encode_camera_motion(estimate: CameraMotionEstimate) -> bytes:
    """An estimate as ``aerodft.camera_motion/1``."""
    turn, look = estimate.turn_rad, estimate.look_turn_rad
    return CAMERA_MOTION.dump(
        estimate,
        angle_deg=math.degrees(math.hypot(*turn)),
        turn={
            name: {"value": math.degrees(value), "std": math.degrees(std)}
            for name, value, std in zip(_TURN, turn, estimate.std_rad, strict=True)
        },
        look=None if look is None else {key: math.degrees(n) for key, n in zip(_TURN, look, strict=True)},
    )
