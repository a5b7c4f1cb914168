"""The JSON Schemas of all payloads; ``docs/schema`` holds them as files, MCAP channels carry them."""

from typing import Final

import orjson

from aerodft.adapters.wire.events import IMAGE, OBSERVATION
from aerodft.adapters.wire.measurement import MEASUREMENT, MEASUREMENTS
from aerodft.adapters.wire.payload import Schema
from aerodft.adapters.wire.pose import HEIGHT_SWITCH, POSE
from aerodft.adapters.wire.requests import ERROR
from aerodft.adapters.wire.status import CALIBRATION_ESTIMATE, CAMERA_MOTION, STATUS

_OBSERVED = (IMAGE, OBSERVATION)
_ESTIMATED = (HEIGHT_SWITCH, CALIBRATION_ESTIMATE, CAMERA_MOTION)
SCHEMAS: Final[dict[str, Schema]] = {
    each.name: each.schema for each in (MEASUREMENT, MEASUREMENTS, POSE, *_OBSERVED, *_ESTIMATED, STATUS, ERROR)
}


def schema_text(name: str) -> bytes:
    """A schema as its file holds it."""
    return orjson.dumps(SCHEMAS[name], option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)
