"""``aerodft.status/1``: what a station is doing, and what it has counted since it started."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from aerodft.adapters.wire.payload import Json, dump_payload
from aerodft.model import Health
from aerodft.version import SOFTWARE

STATUS_SCHEMA = "aerodft.status/1"
STATES = ("starting", "running", "ending")


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
    return dump_payload(
        {
            "schema": STATUS_SCHEMA,
            "station": status.station,
            "stamp_ns": str(status.stamp_ns),
            "state": status.state,
            "text": status.text,
            "counts": dict(status.counts),
            "health": None if status.health is None else _health_payload(status.health),
            "rejected": dict(status.rejected),
            "software": SOFTWARE,
        }
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
