"""``aerodft.status/1``: what a station is doing, and what it has counted since it started."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from aerodft.adapters.codec import wire

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
    """

    station: str
    stamp_ns: int
    state: str
    text: str = ""
    counts: Mapping[str, int] = field(default_factory=dict)


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
    )
