"""``aerodft.status/1``: what a station is doing, and what it has counted since it started."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from aerodft.adapters.wire.json_schema import (
    COUNT,
    INTEGER,
    NUMBER,
    STAMP,
    TEXT,
    Payload,
    Schema,
    doc,
    object_of,
    or_null,
)
from aerodft.adapters.wire.payload import Json
from aerodft.model import Health

STATUS_SCHEMA = "aerodft.status/1"
STATES = ("starting", "running", "ending")


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
            object_of({"received": COUNT, "lost": COUNT}),
            "The autopilot's frames over the last 10 s",
        ),
        "ages_s": doc(_NUMBERS, "Since the newest telemetry of each kind"),
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
