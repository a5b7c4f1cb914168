"""What is wrong with a station that measures, in sentences: while it lasts, and since when."""

import math
import threading
import time
from collections.abc import Iterator
from typing import Any, Final

from aerodft.adapters.wire.status import StationStatus
from aerodft.model import CameraMotionEstimate, MotionState
from aerodft.service import Batches, StepOutputs

_LONGEST_S: Final = 3.0
"""Without an image; and how long without telemetry."""
_MOST_LOSS: Final = 0.1
_LEAST_FREE_BYTES: Final = 2_000_000_000

Sentences = Iterator[tuple[str, str]]


class Alerts:
    """What is wrong now; used by the station's thread and by others."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._since_ns: dict[str, int] = {}
        self._sentences: dict[str, str] = {}
        self._motion: CameraMotionEstimate | None = None
        self._status: StationStatus | None = None
        self._image_s = time.monotonic()

    def take(self, batches: Batches, outputs: StepOutputs) -> None:
        """Take what came and what was made of it."""
        if len(batches.images):
            self._image_s = time.monotonic()
        for single in outputs.singles:
            if isinstance(single.content, CameraMotionEstimate):
                self._motion = single.content

    def status(self, value: StationStatus) -> None:
        """Take the station's state."""
        with self._lock:
            self._status = value

    def now(self, free_bytes: int) -> list[dict[str, Any]]:
        """What is wrong: a ``key``, ``since_ns`` (UTC, as text) and a ``text`` each.

        Args:
            free_bytes: On the disk of the recording.
        """
        with self._lock:
            found = dict(self._found(free_bytes))
            stamp_ns = 0 if self._status is None else self._status.stamp_ns
            self._since_ns = {key: self._since_ns.get(key, stamp_ns) for key in found}
            return [{"key": key, "since_ns": str(self._since_ns[key]), "text": text} for key, text in found.items()]

    def _found(self, free_bytes: int) -> Sentences:
        silent_s = time.monotonic() - self._image_s
        if silent_s > _LONGEST_S:
            yield "images", f"no image has come for {silent_s:.0f} s: is the stream still there?"
        if self._motion is not None and self._motion.state not in {MotionState.STEADY, MotionState.UNCHECKED}:
            turned_deg = math.degrees(math.hypot(*self._motion.turn_rad))
            yield "camera", f"the camera has moved ({self._motion.state}), by {turned_deg:.2f} deg: calibrate it anew"
        if free_bytes < _LEAST_FREE_BYTES:
            yield "room", f"only {free_bytes / 1e9:.1f} GB are left on the disk of the recording: make room"
        if self._status is not None:
            yield from _of_status(self._status)


def _of_status(status: StationStatus) -> Sentences:
    counts, health = status.counts, status.health
    gone = counts.get("shed_messages", 0) + counts.get("lost_messages", 0)
    images = counts.get("shed_images", 0) + counts.get("lost_images", 0)
    if gone or images:
        yield "disk", f"{gone} messages and {images} images are not recorded: the disk is too slow, full or failing"
    if dropped := counts.get("unmeasured_dropped", 0):
        yield "load", f"{dropped} images were not measured: they come faster than this machine measures"
    if health is None:
        return
    if health.heartbeat_age_s is None or health.heartbeat_age_s > _LONGEST_S:
        since = "yet" if health.heartbeat_age_s is None else f"for {health.heartbeat_age_s:.0f} s"
        yield "telemetry", f"the autopilot has not been heard {since}: check the link"
    elif health.loss_share > _MOST_LOSS:
        yield "link", f"{100 * health.loss_share:.0f} % of the telemetry is lost on its way"
    stale = [name for name, age_s in health.ages_s.items() if math.isfinite(age_s) and age_s > _LONGEST_S]
    if stale and health.heartbeat_age_s is not None and health.heartbeat_age_s <= _LONGEST_S:
        named = ", ".join(f"{name} for {health.ages_s[name]:.0f} s" for name in sorted(stale))
        yield "stale", f"telemetry has stopped: {named}"
