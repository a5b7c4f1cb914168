"""The JSON Schemas (draft 2020-12) of all payloads; ``docs/schema`` holds them as files, MCAP channels carry them."""

from collections.abc import Iterable
from typing import Any, Final

import orjson

from aerodft.adapters.wire.estimates import CALIBRATION_SCHEMA, CAMERA_MOTION_SCHEMA
from aerodft.adapters.wire.events import IMAGE_SCHEMA, OBSERVATION_SCHEMA
from aerodft.adapters.wire.measurement import MEASUREMENT_SCHEMA, MEASUREMENTS_SCHEMA
from aerodft.adapters.wire.pose import HEIGHT_SWITCH_SCHEMA, POSE_SCHEMA
from aerodft.adapters.wire.requests import ERROR_SCHEMA
from aerodft.adapters.wire.status import STATES, STATUS_SCHEMA
from aerodft.dft import PROBE_KINDS
from aerodft.model import (
    GimbalSource,
    HeightSource,
    ProbeKind,
    ProjectionModel,
    StampClock,
    Status,
    Steadiness,
    ZoomSource,
)
from aerodft.service import HEIGHT_SOURCES

Schema = dict[str, Any]

_KINDS: Final = (*PROBE_KINDS, ProbeKind.TRACK)
_HEIGHTS: Final = (*HEIGHT_SOURCES, HeightSource.CALIBRATION)

NUMBER: Final[Schema] = {"type": ["number", "null"]}
INTEGER: Final[Schema] = {"type": ["integer", "null"]}
TEXT: Final[Schema] = {"type": "string"}
TEXT_OR_NULL: Final[Schema] = {"type": ["string", "null"]}
STAMP: Final[Schema] = {
    "type": "string",
    "pattern": "^-?[0-9]+$",
    "description": "Nanoseconds UTC as a decimal string, because 64 bits do not survive other languages' numbers",
}
STAMP_OR_NULL: Final[Schema] = {**STAMP, "type": ["string", "null"]}


def doc(schema: Schema, description: str) -> Schema:
    """A schema with a description."""
    return {**schema, "description": description}


def one_of(values: Iterable[str]) -> Schema:
    """One of some names, or of the values of an enumeration."""
    return {"enum": [str(value) for value in values]}


def or_null(schema: Schema) -> Schema:
    """A schema that takes null too."""
    if "enum" in schema:
        return {**schema, "enum": [*schema["enum"], None]}
    return {**schema, "type": [schema["type"], "null"]}


def list_of(items: Schema, *, length: int | None = None) -> Schema:
    """An array, of any length or of one."""
    size = {} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": items, **size}


def object_of(properties: Schema) -> Schema:
    """An object with exactly these properties."""
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def document(name: str, title: str, properties: Schema) -> Schema:
    """The schema of a payload, which names itself and the software that made it."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:{name.replace('/', ':')}",
        "title": title,
        **object_of({"schema": {"const": name}, **properties, "software": TEXT}),
    }


_PIXELS = doc(list_of(list_of(NUMBER, length=2)), "Pixels (u, v); (0, 0) is the centre of the top-left pixel")
_POINTS = or_null(list_of(list_of(NUMBER, length=3)))
_GEO = {"lat_deg": NUMBER, "lon_deg": NUMBER, "alt_msl_m": NUMBER}
_SUMMARY_STD = dict.fromkeys(("height_agl_m", "tilt_deg", "pan_deg", "roll_deg", "heading_deg"), NUMBER)
_SUMMARY = {
    "height_agl_m": doc(
        NUMBER, "Above what height_datum says: the measured plane, or the ground right below the camera"
    ),
    "height_source": or_null(one_of(_HEIGHTS)),
    "height_datum": TEXT_OR_NULL,
    "height_age_s": doc(NUMBER, "From the stamp to the nearest sample of that source"),
    "tilt_deg": doc(NUMBER, "Optical axis against straight down: 0 nadir, 90 horizon"),
    "roll_deg": doc(NUMBER, "About the optical axis; above 0 with the camera's right side down"),
    "heading_deg": doc(NUMBER, "Clockwise from true north"),
    "lat_deg": NUMBER,
    "lon_deg": NUMBER,
    "telemetry_age_s": NUMBER,
}

_OWN: Final[dict[str, Schema]] = {
    "name": doc(TEXT, "The probe"),
    "kind": one_of(_KINDS),
    "value": doc(NUMBER, "Null unless the status is ok"),
    "unit": TEXT,
    "std": NUMBER,
    "ci95": or_null(list_of(NUMBER, length=2)),
    "ellipse95": or_null(object_of({"semi_major_m": NUMBER, "semi_minor_m": NUMBER, "azimuth_deg": NUMBER})),
    "status": one_of(Status),
    "reasons": list_of(TEXT),
    "pixels": _PIXELS,
    "std_px": NUMBER,
    "ground_m": doc(_POINTS, "X right, Y ahead, Z up of the point below the camera"),
    "enu_m": doc(_POINTS, "East, north, up of the station's origin"),
    "cov_enu_m2": doc(or_null(list_of(list_of(NUMBER, length=3), length=3)), "Of the first point"),
    "geo": or_null(list_of(object_of(_GEO))),
    "range_m": or_null(list_of(NUMBER)),
}
_OF_IMAGE: Final[dict[str, Schema]] = {
    "stamp_ns": STAMP,
    "image": INTEGER,
    "model": one_of(ProjectionModel),
    "camera": TEXT,
    "calibration": TEXT_OR_NULL,
    "config": TEXT_OR_NULL,
    "pose": object_of({**_SUMMARY, "std": object_of(_SUMMARY_STD)}),
}

MEASUREMENT: Final = document(MEASUREMENT_SCHEMA, "One measurement, or why there is none", {**_OWN, **_OF_IMAGE})

MEASUREMENTS: Final = document(
    MEASUREMENTS_SCHEMA,
    "All measurements of one image, as a recording has them: what they share, and a list",
    {**_OF_IMAGE, "measurements": list_of(object_of(_OWN))},
)

POSE: Final = document(
    POSE_SCHEMA,
    "The camera's pose at one stamp, or why there is none",
    {
        "stamp_ns": STAMP,
        "status": one_of(Status),
        "reasons": list_of(TEXT),
        **_SUMMARY,
        "std": object_of({**_SUMMARY_STD, "horizontal_m": NUMBER, "time_s": NUMBER}),
        "alt_msl_m": NUMBER,
        "attitude_source": or_null(one_of(GimbalSource)),
        "calibration": TEXT_OR_NULL,
        "zoom": doc(
            or_null(object_of({"magnification": NUMBER, "std": NUMBER, "source": one_of(ZoomSource)})),
            "Focal length over that of the camera file, where the vehicle's reports are followed",
        ),
        "position_enu_m": or_null(list_of(NUMBER, length=3)),
        "wxyz": doc(or_null(list_of(NUMBER, length=4)), "enu_SO3_cam: camera axes x right, y down, z forward"),
        "cov": doc(
            or_null(list_of(list_of(NUMBER, length=6), length=6)),
            "Position (ENU, m^2), then a small rotation in camera axes (rad^2)",
        ),
        "velocity_enu_mps": or_null(list_of(NUMBER, length=3)),
        "rate_cam_radps": or_null(list_of(NUMBER, length=3)),
        "time_std_s": NUMBER,
        "lens_cov": doc(
            or_null(list_of(list_of(NUMBER), length=6)),
            "Of the errors of `cov` with those of the intrinsics, where one calibration found both",
        ),
        "origin": or_null(object_of(_GEO)),
    },
)

IMAGE: Final = document(
    IMAGE_SCHEMA,
    "An image's stamps and size",
    {
        "index": {"type": "integer"},
        "stamp_ns": STAMP,
        "arrival_ns": STAMP,
        "clock": doc(one_of(StampClock), "Whose clock the stamp is from"),
        "width_px": INTEGER,
        "height_px": INTEGER,
    },
)

OBSERVATION: Final = document(
    OBSERVATION_SCHEMA,
    "One probe's pixels, or the outline of what it measures, at one stamp",
    {
        "name": doc(TEXT, "The probe"),
        "stamp_ns": STAMP,
        "arrival_ns": STAMP,
        "clock": one_of(StampClock),
        "pixels": _PIXELS,
        "box": doc(or_null(list_of(NUMBER, length=4)), "Left, top, right, bottom limit of an object, in pixels"),
        "contour": doc(or_null(list_of(list_of(NUMBER, length=2))), "Corners of an object's outline, in pixels"),
        "unseen": doc(or_null(TEXT), "Why there are no pixels: it was looked for, and not seen"),
        "std_px": NUMBER,
        "image": INTEGER,
        "source": TEXT,
    },
)

_BIAS = object_of({"value": NUMBER, "std": NUMBER})
_PAIR = or_null(list_of(NUMBER, length=2))

CALIBRATION_ESTIMATE: Final = document(
    CALIBRATION_SCHEMA,
    "What is to be added to the telemetry, after the landmarks of one image",
    {
        "stamp_ns": doc(STAMP, "Of the image that they were seen in"),
        "calibration": doc(TEXT_OR_NULL, "What the next images' measurements name as their calibration"),
        "height_source": or_null(one_of(_HEIGHTS)),
        "bias": object_of(
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
        ),
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
        "updates": doc({"type": "integer"}, "Landmarks used since the start"),
        "refused": doc({"type": "integer"}, "Landmarks refused since the start"),
        "restarts": doc({"type": "integer"}, "How often nearly all were refused, and the estimate began anew"),
    },
)

_TURN = {
    "tilt_deg": "About the camera's x axis now; raises the view",
    "pan_deg": "About its y axis; to the right",
    "roll_deg": "About its z axis; clockwise, seen from behind",
}

CAMERA_MOTION: Final = document(
    CAMERA_MOTION_SCHEMA,
    "Whether a fixed camera still looks where it looked, after one look at its steady points",
    {
        "stamp_ns": doc(STAMP, "Of the image that was looked at"),
        "state": one_of(Steadiness),
        "since_ns": doc(STAMP, "The first look in this state"),
        "moved_ns": doc(STAMP_OR_NULL, "The first look that saw the camera where it rests by now, beyond the limit"),
        "angle_deg": doc(NUMBER, "By how much it has turned, about whichever axis"),
        "turn": object_of({name: doc(_BIAS, what) for name, what in _TURN.items()}),
        "look": doc(or_null(object_of(dict.fromkeys(_TURN, NUMBER))), "This look alone; null where it did not tell"),
        "points": doc({"type": "integer"}, "Found again"),
        "agreeing": doc({"type": "integer"}, "Those that the turn explains"),
        "std_px": doc(NUMBER, "Of one coordinate of these"),
        "calibration": doc(TEXT_OR_NULL, "What the next images' measurements name as their calibration"),
    },
)

_NUMBERS: Final[Schema] = {"type": "object", "additionalProperties": NUMBER}
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
                "test_ratios": doc(_NUMBERS, "Innovations over their gates: from 1 on the estimator refuses them"),
            }
        ),
        "link": doc(
            object_of({"received": {"type": "integer"}, "lost": {"type": "integer"}}),
            "The autopilot's frames over the last 10 s",
        ),
        "ages_s": doc(_NUMBERS, "Since the newest telemetry of each kind"),
    }
)

HEIGHT_SWITCH: Final = document(
    HEIGHT_SWITCH_SCHEMA,
    "From this stamp on heights are of another source",
    {
        "stamp_ns": doc(STAMP, "Of the first pose with the new source"),
        "before": one_of(_HEIGHTS),
        "after": one_of(_HEIGHTS),
        "step_m": doc(NUMBER, "The new source minus the old one; null where they never spoke at one time"),
        "std_m": doc(NUMBER, "Of the step, by what is stated of the two"),
        "before_m": doc(NUMBER, "What the old source said then"),
        "after_m": doc(NUMBER, "What the new source said then"),
        "compared_ns": doc(STAMP_OR_NULL, "When the two were compared: the last time that the old one spoke"),
    },
)

STATUS: Final = document(
    STATUS_SCHEMA,
    "What a station is doing",
    {
        "station": TEXT,
        "stamp_ns": STAMP,
        "state": {"enum": list(STATES)},
        "text": TEXT,
        "counts": {"type": "object", "additionalProperties": {"type": "integer"}},
        "health": doc(or_null(_HEALTH), "What the vehicle says of itself now; null of a fixed camera"),
        "rejected": doc(
            {"type": "object", "additionalProperties": {"type": "integer"}},
            "Telemetry that held no value since the start (NaN, impossible, of somebody else), by MESSAGE: reason",
        ),
    },
)

ERROR: Final = document(
    ERROR_SCHEMA,
    "The error reply to a query that has no answer",
    {
        "code": doc({"type": "integer"}, "As commands exit: 3 the question or an input is wrong, 4 no answer, 1 a bug"),
        "sentence": doc(TEXT, "What is wrong: where, got, expected, what to do"),
    },
)

SCHEMAS: Final[dict[str, Schema]] = {
    MEASUREMENT_SCHEMA: MEASUREMENT,
    MEASUREMENTS_SCHEMA: MEASUREMENTS,
    POSE_SCHEMA: POSE,
    IMAGE_SCHEMA: IMAGE,
    OBSERVATION_SCHEMA: OBSERVATION,
    HEIGHT_SWITCH_SCHEMA: HEIGHT_SWITCH,
    CALIBRATION_SCHEMA: CALIBRATION_ESTIMATE,
    CAMERA_MOTION_SCHEMA: CAMERA_MOTION,
    STATUS_SCHEMA: STATUS,
    ERROR_SCHEMA: ERROR,
}


def schema_text(name: str) -> bytes:
    """A schema as its file holds it."""
    return orjson.dumps(SCHEMAS[name], option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)
