"""What a station says of itself: its state and counts, what a live calibration adds, if a fixed camera moved."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from aerodft.adapters.wire.payload import (
    COUNT,
    INTEGER,
    NUMBER,
    STAMP,
    STAMP_OR_NULL,
    TEXT,
    TEXT_OR_NULL,
    Json,
    Payload,
    Schema,
    doc,
    list_of,
    load_payload,
    object_of,
    one_of,
    or_null,
    payload_of,
)
from aerodft.adapters.wire.pose import HEIGHTS
from aerodft.model import CalibrationEstimate, CameraMotionEstimate, Health, MotionState

STATUS_SCHEMA = "aerodft.status/1"
STATES = ("starting", "running", "ending")
UNMEASURED: Final = "unmeasured_"
"""What counts of images that were never measured begin with; the cause follows."""

_NUMBERS_BY_NAME: Final[Schema] = {"type": "object", "additionalProperties": NUMBER}
_HEALTH = object_of(
    {
        "heartbeat_age_s": NUMBER,
        "gps": object_of(
            {
                "fix": doc(INTEGER, "GPS_FIX_TYPE: 3 and more are three-dimensional"),
                "age_s": NUMBER,
                "satellites": INTEGER,
                "horizontal_std_m": NUMBER,
                "vertical_std_m": NUMBER,
            }
        ),
        "estimator": object_of(
            {
                "has_attitude": {"type": ["boolean", "null"]},
                "test_ratios": doc(
                    _NUMBERS_BY_NAME, "Innovations over their gates: from 1 on the estimator refuses them"
                ),
            }
        ),
        "link": doc(
            object_of({"received": COUNT, "lost": COUNT}),
            "The autopilot's frames over the last 10 s",
        ),
        "ages_s": doc(_NUMBERS_BY_NAME, "Since the newest telemetry of each kind"),
    }
)

STATUS: Final = Payload(
    STATUS_SCHEMA,
    "What a station is doing",
    {
        "station": TEXT,
        "stamp_ns": STAMP,
        "state": {"enum": list(STATES)},
        "text": TEXT,
        "counts": {"type": "object", "additionalProperties": COUNT},
        "health": doc(or_null(_HEALTH), "What the vehicle says of itself now; null of a fixed camera"),
        "rejected": doc(
            {"type": "object", "additionalProperties": COUNT},
            "Telemetry that held no value since the start (NaN, impossible, of somebody else), by MESSAGE: reason",
        ),
    },
)

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


@dataclass(frozen=True, slots=True, kw_only=True)
class StationStatus:
    """A station's state at one time.

    Attributes:
        station: Its name.
        stamp_ns: Host UTC.
        state: One of ``STATES``.
        text: One sentence for people.
        counts: Totals since the start, by name: images, measurements, shed, lost.
        health: What the vehicle says of itself now; None of a fixed camera.
        rejected: Telemetry that held no value since the start (NaN, impossible, of somebody else), by
            ``MESSAGE: reason``.
    """

    station: str
    stamp_ns: int
    state: str
    text: str = ""
    counts: Mapping[str, int] = field(default_factory=dict)
    health: Health | None = None
    rejected: Mapping[str, int] = field(default_factory=dict)


def encode_status(status: StationStatus) -> bytes:
    """A station's state as ``aerodft.status/1``."""
    return STATUS.dump(
        status,
        counts=dict(status.counts),
        health=None if status.health is None else _health_payload(status.health),
        rejected=dict(status.rejected),
    )


def unmeasured_of(data: bytes) -> dict[str, int]:
    """Images that were never measured, by cause, as ``aerodft.status/1`` says.

    Raises:
        InputError: The payload is not of that schema.
    """

    def counts(status: Json) -> dict[str, int]:
        found = {name: each for name, each in status["counts"].items() if name.startswith(UNMEASURED)}
        return {name.removeprefix(UNMEASURED): int(each) for name, each in found.items()}

    return load_payload(data, STATUS_SCHEMA, counts)


def _health_payload(health: Health) -> Json:
    return {
        "heartbeat_age_s": health.heartbeat_age_s,
        "gps": {
            "fix": health.gps_fix,
            "age_s": health.gps_age_s,
            "satellites": health.satellites,
            "horizontal_std_m": health.horizontal_std_m,
            "vertical_std_m": health.vertical_std_m,
        },
        "estimator": {"has_attitude": health.has_attitude, "test_ratios": health.ratios},
        "link": {"received": health.received, "lost": health.lost},
        "ages_s": health.ages_s,
    }


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
