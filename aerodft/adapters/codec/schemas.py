"""The JSON Schemas (draft 2020-12) of all payloads; ``docs/schema`` holds them as files, MCAP channels carry them."""

from typing import Any, Final

import orjson

from aerodft.adapters.codec import estimate, events, height, measurement, pose, status, steadiness
from aerodft.model.image import StampClock
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import GimbalSource, HeightSource
from aerodft.model.probe import ProbeKind
from aerodft.model.status import Status
from aerodft.model.steadiness import Steadiness
from aerodft.model.zoom import ZoomSource

Schema = dict[str, Any]

_NUMBER: Final[Schema] = {"type": ["number", "null"]}
_INTEGER: Final[Schema] = {"type": ["integer", "null"]}
_TEXT: Final[Schema] = {"type": "string"}
_TEXT_OR_NULL: Final[Schema] = {"type": ["string", "null"]}
_STAMP: Final[Schema] = {
    "type": "string",
    "pattern": "^-?[0-9]+$",
    "description": "Nanoseconds UTC as a decimal string, because 64 bits do not survive other languages' numbers",
}
_STAMP_OR_NULL: Final[Schema] = {**_STAMP, "type": ["string", "null"]}


def _said(schema: Schema, description: str) -> Schema:
    return {**schema, "description": description}


def _one_of(
    values: type[
        ProbeKind | Status | ProjectionModel | HeightSource | GimbalSource | StampClock | Steadiness | ZoomSource
    ],
) -> Schema:
    return {"enum": [member.value for member in values]}


def _or_null(schema: Schema) -> Schema:
    if "enum" in schema:
        return {**schema, "enum": [*schema["enum"], None]}
    return {**schema, "type": [schema["type"], "null"]}


def _list(items: Schema, *, length: int | None = None) -> Schema:
    size = {} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": items, **size}


def _object(properties: Schema) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def _document(name: str, title: str, properties: Schema) -> Schema:
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:{name.replace('/', ':')}",
        "title": title,
        **_object({"schema": {"const": name}, **properties, "software": _TEXT}),
    }


_PIXELS = _said(_list(_list(_NUMBER, length=2)), "Pixels (u, v); (0, 0) is the centre of the top-left pixel")
_POINTS = _or_null(_list(_list(_NUMBER, length=3)))
_GEO = {"lat": _NUMBER, "lon": _NUMBER, "alt_msl_m": _NUMBER}
_SUMMARY_STD = dict.fromkeys(("height_agl_m", "tilt_deg", "pan_deg", "roll_deg", "heading_deg"), _NUMBER)
_SUMMARY = {
    "height_agl_m": _said(
        _NUMBER, "Above what height_datum says: the measured plane, or the ground right below the camera"
    ),
    "height_source": _or_null(_one_of(HeightSource)),
    "height_datum": _TEXT_OR_NULL,
    "height_age_s": _said(_NUMBER, "From the stamp to the nearest sample of that source"),
    "tilt_deg": _said(_NUMBER, "Optical axis against straight down: 0 nadir, 90 horizon"),
    "roll_deg": _said(_NUMBER, "About the optical axis; above 0 with the camera's right side down"),
    "heading_deg": _said(_NUMBER, "Clockwise from true north"),
    "lat": _NUMBER,
    "lon": _NUMBER,
    "telemetry_age_s": _NUMBER,
}

MEASUREMENT: Final = _document(
    measurement.SCHEMA,
    "One measurement, or why there is none",
    {
        "name": _said(_TEXT, "The probe"),
        "kind": _one_of(ProbeKind),
        "value": _said(_NUMBER, "Null unless the status is ok"),
        "unit": _TEXT,
        "std": _NUMBER,
        "ci95": _or_null(_list(_NUMBER, length=2)),
        "ellipse95": _or_null(_object({"semi_major_m": _NUMBER, "semi_minor_m": _NUMBER, "azimuth_deg": _NUMBER})),
        "status": _one_of(Status),
        "reasons": _list(_TEXT),
        "pixels": _PIXELS,
        "std_px": _NUMBER,
        "ground_m": _said(_POINTS, "X right, Y ahead, Z up of the point below the camera"),
        "enu_m": _said(_POINTS, "East, north, up of the station's origin"),
        "cov_enu_m2": _said(_or_null(_list(_list(_NUMBER, length=3), length=3)), "Of the first point"),
        "geo": _or_null(_list(_object(_GEO))),
        "range_m": _or_null(_list(_NUMBER)),
        "stamp_ns": _STAMP,
        "image": _INTEGER,
        "model": _one_of(ProjectionModel),
        "camera": _TEXT,
        "calibration": _TEXT_OR_NULL,
        "config": _TEXT_OR_NULL,
        "pose": _object({**_SUMMARY, "std": _object(_SUMMARY_STD)}),
    },
)

POSE: Final = _document(
    pose.SCHEMA,
    "The camera's pose at one stamp, or why there is none",
    {
        "stamp_ns": _STAMP,
        "status": _one_of(Status),
        "reasons": _list(_TEXT),
        **_SUMMARY,
        "std": _object({**_SUMMARY_STD, "horizontal_m": _NUMBER, "time_s": _NUMBER}),
        "alt_msl_m": _NUMBER,
        "attitude_source": _or_null(_one_of(GimbalSource)),
        "calibration": _TEXT_OR_NULL,
        "zoom": _said(
            _or_null(_object({"magnification": _NUMBER, "std": _NUMBER, "source": _one_of(ZoomSource)})),
            "Focal length over that of the camera file, where the vehicle's reports are followed",
        ),
        "position_enu_m": _or_null(_list(_NUMBER, length=3)),
        "wxyz": _said(_or_null(_list(_NUMBER, length=4)), "enu_SO3_cam: camera axes x right, y down, z forward"),
        "cov": _said(
            _or_null(_list(_list(_NUMBER, length=6), length=6)),
            "Position (ENU, m^2), then a small rotation in camera axes (rad^2)",
        ),
        "velocity_enu_mps": _or_null(_list(_NUMBER, length=3)),
        "rate_cam_radps": _or_null(_list(_NUMBER, length=3)),
        "time_std_s": _NUMBER,
        "origin": _or_null(_object(_GEO)),
    },
)

IMAGE: Final = _document(
    events.IMAGE_SCHEMA,
    "An image's stamps and size",
    {
        "index": {"type": "integer"},
        "stamp_ns": _STAMP,
        "arrival_ns": _STAMP,
        "clock": _said(_one_of(StampClock), "Whose clock the stamp is from"),
        "width_px": _INTEGER,
        "height_px": _INTEGER,
    },
)

OBSERVATION: Final = _document(
    events.OBSERVATION_SCHEMA,
    "One probe's pixels at one stamp",
    {
        "name": _said(_TEXT, "The probe"),
        "stamp_ns": _STAMP,
        "arrival_ns": _STAMP,
        "clock": _one_of(StampClock),
        "pixels": _PIXELS,
        "std_px": _NUMBER,
        "image": _INTEGER,
        "source": _TEXT,
    },
)

_BIAS = _object({"value": _NUMBER, "std": _NUMBER})
_PAIR = _or_null(_list(_NUMBER, length=2))

CALIBRATION_ESTIMATE: Final = _document(
    estimate.SCHEMA,
    "What is to be added to the telemetry, after the landmarks of one image",
    {
        "stamp_ns": _said(_STAMP, "Of the image that they were seen in"),
        "calibration": _said(_TEXT_OR_NULL, "What the next images' measurements name as their calibration"),
        "height_source": _or_null(_one_of(HeightSource)),
        "bias": _object(
            {
                "height_m": _said(_BIAS, "Of the height source in use"),
                "east_m": _BIAS,
                "north_m": _BIAS,
                "tilt_deg": _said(_BIAS, "About the camera's x axis; raises the tilt"),
                "pan_deg": _said(_BIAS, "About its y axis"),
                "roll_deg": _said(_BIAS, "About its z axis"),
                "heading_deg": _said(_BIAS, "About the vertical, clockwise"),
                "time_s": _said(_BIAS, "Of the images' stamps"),
            }
        ),
        "innovations": _list(
            _object(
                {
                    "name": _said(_TEXT, "The landmark"),
                    "px": _said(_PAIR, "Observed minus expected pixel"),
                    "sigma_px": _said(_PAIR, "Standard deviations of the two"),
                    "chi2": _said(_NUMBER, "Squared distance in standard deviations, of two degrees of freedom"),
                    "accepted": {"type": "boolean"},
                    "reason": _said(_TEXT_OR_NULL, "Why it was refused"),
                }
            )
        ),
        "updates": _said({"type": "integer"}, "Landmarks used since the start"),
        "refused": _said({"type": "integer"}, "Landmarks refused since the start"),
        "restarts": _said({"type": "integer"}, "How often nearly all were refused, and the estimate began anew"),
    },
)

_TURN = {
    "tilt_deg": "About the camera's x axis now; raises the view",
    "pan_deg": "About its y axis; to the right",
    "roll_deg": "About its z axis; clockwise, seen from behind",
}

STEADINESS: Final = _document(
    steadiness.SCHEMA,
    "Whether a fixed camera still looks where it looked, after one look at its steady points",
    {
        "stamp_ns": _said(_STAMP, "Of the image that was looked at"),
        "state": _one_of(Steadiness),
        "since_ns": _said(_STAMP, "The first look in this state"),
        "moved_ns": _said(_STAMP_OR_NULL, "The first look that saw the camera where it rests by now, beyond the limit"),
        "angle_deg": _said(_NUMBER, "By how much it has turned, about whichever axis"),
        "turn": _object({name: _said(_BIAS, what) for name, what in _TURN.items()}),
        "look": _said(_or_null(_object(dict.fromkeys(_TURN, _NUMBER))), "This look alone; null where it did not tell"),
        "points": _said({"type": "integer"}, "Found again"),
        "agreeing": _said({"type": "integer"}, "Those that the turn explains"),
        "std_px": _said(_NUMBER, "Of one coordinate of these"),
        "calibration": _said(_TEXT_OR_NULL, "What the next images' measurements name as their calibration"),
    },
)

_NUMBERS: Final[Schema] = {"type": "object", "additionalProperties": _NUMBER}
_HEALTH = _object(
    {
        "heartbeat_age_s": _NUMBER,
        "gps": _object(
            {
                "fix": _said(_INTEGER, "GPS_FIX_TYPE: 3 and more are three-dimensional"),
                "age_s": _NUMBER,
                "satellites": _INTEGER,
                "horizontal_std_m": _NUMBER,
                "vertical_std_m": _NUMBER,
            }
        ),
        "estimator": _object(
            {
                "has_attitude": {"type": ["boolean", "null"]},
                "test_ratios": _said(_NUMBERS, "Innovations over their gates: from 1 on the estimator refuses them"),
            }
        ),
        "link": _said(
            _object({"received": {"type": "integer"}, "lost": {"type": "integer"}}),
            "The autopilot's frames over the last 10 s",
        ),
        "ages_s": _said(_NUMBERS, "Since the newest telemetry of each kind"),
    }
)

HEIGHT_SWITCH: Final = _document(
    height.SCHEMA,
    "From this stamp on heights are of another source",
    {
        "stamp_ns": _said(_STAMP, "Of the first pose with the new source"),
        "before": _one_of(HeightSource),
        "after": _one_of(HeightSource),
        "step_m": _said(_NUMBER, "The new source minus the old one; null where they never spoke at one time"),
        "std_m": _said(_NUMBER, "Of the step, by what is stated of the two"),
        "before_m": _said(_NUMBER, "What the old source said then"),
        "after_m": _said(_NUMBER, "What the new source said then"),
        "compared_ns": _said(_STAMP_OR_NULL, "When the two were compared: the last time that the old one spoke"),
    },
)

STATUS: Final = _document(
    status.SCHEMA,
    "What a station is doing",
    {
        "station": _TEXT,
        "stamp_ns": _STAMP,
        "state": {"enum": list(status.STATES)},
        "text": _TEXT,
        "counts": {"type": "object", "additionalProperties": {"type": "integer"}},
        "health": _said(_or_null(_HEALTH), "What the vehicle says of itself now; null of a fixed camera"),
    },
)

SCHEMAS: Final[dict[str, Schema]] = {
    measurement.SCHEMA: MEASUREMENT,
    pose.SCHEMA: POSE,
    events.IMAGE_SCHEMA: IMAGE,
    events.OBSERVATION_SCHEMA: OBSERVATION,
    height.SCHEMA: HEIGHT_SWITCH,
    estimate.SCHEMA: CALIBRATION_ESTIMATE,
    steadiness.SCHEMA: STEADINESS,
    status.SCHEMA: STATUS,
}


def schema_file_name(name: str) -> str:
    """The file in ``docs/schema`` for a schema's name: ``aerodft.pose/1`` is ``pose-1.json``."""
    return name.removeprefix("aerodft.").replace("/", "-") + ".json"


def schema_text(name: str) -> bytes:
    """A schema as its file holds it."""
    return orjson.dumps(SCHEMAS[name], option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)
