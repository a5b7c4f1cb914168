"""``aerodft.status/1``: what a station is doing, and what it has counted since it started."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from aerodft.adapters.codec import wire
from aerodft.model.health import Health

SCHEMA = "aerodft.status/1"
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
    return wire.dump(
        {
            "schema": SCHEMA,
            "station": status.station,
            "stamp_ns": str(status.stamp_ns),
            "state": status.state,
            "text": status.text,
            "counts": dict(status.counts),
            "health": None if status.health is None else _health_payload(status.health),
            "rejected": dict(status.rejected),
            "software": wire.SOFTWARE,
        }
    )


def decode_status(data: bytes) -> StationStatus:
    """``aerodft.status/1`` to a station's state.

    Raises:
        InputError: The payload is not of that schema.
    """
    return wire.load(data, SCHEMA, _status)


def _status(payload: wire.Json) -> StationStatus:
    return StationStatus(
        station=payload["station"],
        stamp_ns=int(payload["stamp_ns"]),
        state=payload["state"],
        text=payload["text"],
        counts=payload["counts"],
        health=None if payload.get("health") is None else _health(payload["health"]),
        rejected=payload.get("rejected", {}),
    )


def _health_payload(health: Health) -> wire.Json:
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


def _health(payload: wire.Json) -> Health:
    gps, estimator, link = payload["gps"], payload["estimator"], payload["link"]
    return Health(
        heartbeat_age_s=payload["heartbeat_age_s"],
        gps_fix=gps["fix"],
        gps_age_s=gps["age_s"],
        satellites=gps["satellites"],
        horizontal_std_m=gps["horizontal_std_m"],
        vertical_std_m=gps["vertical_std_m"],
        ratios=estimator["test_ratios"],
        has_attitude=estimator["has_attitude"],
        received=link["received"],
        lost=link["lost"],
        ages_s=payload["ages_s"],
    )
