"""What a run says of a fixed camera's steadiness."""

import math
from datetime import UTC, datetime

from aerodft.conventions import SECOND_NS
from aerodft.model.calibration import SteadinessEstimate


def steadiness_document(estimate: SteadinessEstimate) -> dict[str, object]:
    """What a run's summary says of the camera at the end."""
    return {
        "state": estimate.state,
        "since": _utc(estimate.since_ns),
        "turned_deg": _turned_deg(estimate),
        "moved_since": None if estimate.moved_ns is None else _utc(estimate.moved_ns),
        "points": estimate.points,
    }


def steadiness_sentence(estimate: SteadinessEstimate) -> str:
    """The same for people."""
    said = f"{estimate.state} since {_utc(estimate.since_ns)}"
    if estimate.moved_ns is not None:
        return f"{said}; turned by {_turned_deg(estimate):.2f} deg at {_utc(estimate.moved_ns)}"
    return f"{said}; turned by {_turned_deg(estimate):.3f} deg, within the limit"


def _turned_deg(estimate: SteadinessEstimate) -> float:
    return math.degrees(math.hypot(*estimate.turn_rad))


def _utc(stamp_ns: int) -> str:
    return f"{datetime.fromtimestamp(stamp_ns // SECOND_NS, UTC):%Y-%m-%dT%H:%M:%SZ}"
