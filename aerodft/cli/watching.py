"""A fixed camera's steady points: who looks for them in the station's images, and what a run says of them."""

import math
from datetime import UTC, datetime

from aerodft.adapters.config.station import StationConfig, Watch
from aerodft.adapters.images.camera_image import read_camera_image
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model.steadiness import SteadinessEstimate
from aerodft.service.looking import Lookout
from aerodft.vision.reference import LEAST_CORNERS
from aerodft.vision.steady import SteadyPoints


def steady_lookout(watch: Watch, station: StationConfig) -> Lookout:
    """Who looks for steady points.

    Raises:
        InputError: The reference image cannot be read, is of another size, or shows too little.
    """
    camera, settings, pixels = station.pipeline.camera, watch.settings, None
    if watch.reference is not None:
        hint = "watch.reference is an image that the camera took in the mode that it is in now"
        pixels = read_camera_image(watch.reference, camera, hint)
    points = SteadyPoints(camera, settings.ignore, pixels)
    if points.corners is not None and points.corners < LEAST_CORNERS:
        raise InputError(
            "the reference image shows too little that can be found again",
            where=watch.reference,
            got=f"{points.corners} corners outside watch.ignore",
            expected=f"at least {LEAST_CORNERS}",
        )
    return Lookout(points, settings.every_s)


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
