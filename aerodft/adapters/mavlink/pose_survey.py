"""Which poses a flight's telemetry gives, moment by moment, as an import would make them."""

import re
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.pose import PoseSample
from aerodft.model.status import Status
from aerodft.service.poses import PoseSource
from aerodft.service.streams import LAST

_FINE_FOR_NS: Final = 10 * SECOND_NS  # a link is listened to for that long
_MOST_MOMENTS, _FEWEST_MOMENTS = 2000, 50  # asked for at once: the fewer, the more often the clock has jumped
_FINE_NS: Final = SECOND_NS // 10
_MOST_TOLD: Final = 3
_RARE: Final = 0.02  # share of a flight
_NUMBER: Final = re.compile(r"[-+]?\d+(\.\d+)?")


@dataclass(slots=True)
class Reason:
    """Why there was no pose at moments of one status.

    Attributes:
        words: As it was said first.
        first_s: When that was, since the first frame.
        seconds: How long it was said, whatever its numbers were.
    """

    words: str
    first_s: float
    seconds: float = 0.0


@dataclass(slots=True)
class Span:
    """All moments of one status.

    Attributes:
        seconds: How long, together.
        reasons: Why, by what was said without its numbers.
    """

    seconds: float = 0.0
    reasons: dict[str, Reason] = field(default_factory=dict)

    def add(self, words: str, at_s: float, seconds: float) -> None:
        """Count one moment."""
        self.seconds += seconds
        self.reasons.setdefault(_NUMBER.sub("", words), Reason(words, at_s)).seconds += seconds

    @property
    def example(self) -> str:
        """What was said for the longest time, and when it began."""
        reason = max(self.reasons.values(), key=lambda each: each.seconds)
        return f"first {reason.first_s:.0f} s after the start: {reason.words}"


@dataclass(slots=True)
class Poses:
    """What became of the moments of a flight, by status."""

    spans: dict[Status, Span] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """How long the flight was."""
        return sum(span.seconds for span in self.spans.values())

    @property
    def ok_s(self) -> float:
        """For how long images could be measured."""
        return self.spans[Status.OK].seconds if Status.OK in self.spans else 0.0

    def add(self, sample: PoseSample, at_s: float, seconds: float) -> None:
        """Count one moment."""
        words = "" if sample.status is Status.OK else next(iter(sample.reasons), "")
        self.spans.setdefault(sample.status, Span()).add(words, at_s, seconds)

    def document(self) -> dict[str, Any]:
        """Plain JSON values."""
        worst = {str(status): round(span.seconds, 1) for status, span in self.faults()}
        return {"seconds": round(self.seconds, 1), "ok_s": round(self.ok_s, 1), "no_answer_s": worst}

    def faults(self) -> list[tuple[Status, Span]]:
        """What is no pose, the longest first."""
        faults = ((status, span) for status, span in self.spans.items() if status is not Status.OK)
        return sorted(faults, key=lambda item: -item[1].seconds)

    def note(self) -> str:
        """For how long there is a pose, and why there is none for the rest."""
        said = ", ".join(f"{status} in {span.seconds:.0f} s" for status, span in self.faults() if span.seconds >= 1)
        return f"images could be measured in {self.ok_s:.0f} of {self.seconds:.0f} s" + (f"; {said}" if said else "")

    def problem(self) -> str:
        """Why most images would have no answer; empty where most have one."""
        if self.ok_s * 2 > self.seconds:
            return ""
        told = "; ".join(
            f"{status} in {span.seconds:.0f} s ({span.example})"
            for status, span in self.faults()[:_MOST_TOLD]
            if span.seconds > _RARE * self.seconds
        )
        if self.ok_s == 0:
            return f"no image could be measured: {told}"
        return f"images could be measured only in {self.ok_s:.0f} of {self.seconds:.0f} s: {told}"


class PoseSurvey:
    """Asks for a pose at every tenth of a second of a link, at every second of a long log.

    Args:
        source: Takes in the telemetry; is asked.
    """

    def __init__(self, source: PoseSource) -> None:
        self._source = source
        self._poses = Poses()
        self._waiting: deque[tuple[int, int]] = deque()
        self._first_ns: int | None = None
        self._next_ns = 0
        self._most = _MOST_MOMENTS

    def add(self, first_ns: int, now_ns: int) -> None:
        """Ask for what may be known now that telemetry was taken in that arrived between these (host UTC)."""
        if self._first_ns is None:
            self._first_ns = self._next_ns = first_ns
        least_ns = (now_ns - self._next_ns) // self._most  # a clock may jump by decades, again and again
        if least_ns > SECOND_NS:
            self._most = max(self._most // 2, _FEWEST_MOMENTS)
        while self._next_ns <= now_ns:
            usual_ns = _FINE_NS if self._next_ns - self._first_ns < _FINE_FOR_NS else SECOND_NS
            step_ns = max(usual_ns, min(least_ns, now_ns - self._next_ns))
            self._waiting.append((self._next_ns, step_ns))
            self._next_ns += step_ns
        self._ask(final=False)

    def poses(self) -> Poses:
        """What became of all moments; nothing is waited for any more."""
        self._ask(final=True)
        return self._poses

    def _ask(self, *, final: bool) -> None:
        """Ask for the poses at the moments that wait, up to the first whose telemetry may still come."""
        if not self._waiting:
            return
        arrivals_ns = np.array([arrival_ns for arrival_ns, _ in self._waiting])
        ticks, no = np.broadcast_to(LAST, arrivals_ns.shape), np.full(len(arrivals_ns), fill_value=False)
        stamps_ns = self._source.clock.host_to_utc(arrivals_ns, ticks)
        poses, is_pending = self._source.at(stamps_ns, ticks, final=no | final, by_utc=no)
        count = int(np.argmax(is_pending)) if np.any(is_pending) else len(is_pending)
        for sample in poses[:count]:
            arrival_ns, step_ns = self._waiting.popleft()
            # A pose speaks for no more than a second, the silence of a clock that jumped for all of it.
            spoken_ns = min(step_ns, SECOND_NS) if sample.status is Status.OK else step_ns
            self._poses.add(sample, (arrival_ns - (self._first_ns or 0)) / SECOND_NS, spoken_ns / SECOND_NS)
