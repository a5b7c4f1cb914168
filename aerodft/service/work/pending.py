"""Work that waits for telemetry, the order of its answers, and the stamps of recent images."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final, Self

import numpy as np

from aerodft.dft import NO_IMAGE
from aerodft.jit import njit
from aerodft.model import Batch, BoolArray, IntArray, Observation, PoseSample, Selection

_MAX_IMAGES: Final = 512  # an observation arrives at most this many images after its own


class Task(IntEnum):
    """Task of an image or observation; arrays hold these as ``int64``."""

    IMAGE = 0  # compute the image's pose and measure all fixed probes
    MEASURE = 1  # measure a probe with observed pixels
    LEARN = 2  # update the calibration by an observed landmark
    TRACK = 3  # track an observed object


@dataclass(frozen=True, slots=True, eq=False)
class WorkList(Batch):
    """Images and observations ``n`` that wait for their poses, in order of arrival.

    Attributes:
        task: ``(n,)`` as ``Task``.
        stamp_ns: ``(n,)`` UTC by the current clock map.
        by_utc: ``(n,)`` whether the stamp arrived as UTC, not on this machine's clock.
        deadline_ns: ``(n,)`` tick at which each is answered with the telemetry at hand.
        tick: ``(n,)`` tick of arrival in the step; -1 for an earlier step.
        image: ``(n,)`` running numbers of images, and of the observations' images; ``NO_IMAGE`` for none.
        observations: ``n`` observations with their stamps in UTC; None for images.
        samples: ``n`` poses of work that is ready but waits for earlier stamps; None for other work.
    """

    task: IntArray
    stamp_ns: IntArray
    by_utc: BoolArray
    deadline_ns: IntArray
    tick: IntArray
    image: IntArray
    observations: list[Observation | None]
    samples: list[PoseSample | None]

    @staticmethod
    def empty() -> "WorkList":
        """An empty list."""
        empty = np.empty(0, dtype=np.int64)
        return WorkList(empty, empty, empty.astype(np.bool_), empty, empty, empty, [], [])

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """Concatenate lists."""
        observations = [each for part in parts for each in part.observations]
        samples = [each for part in parts for each in part.samples]
        return replace(super(WorkList, cls).concatenate(parts), observations=observations, samples=samples)

    def in_order_of_ticks(self) -> "WorkList":
        """The list stably sorted by tick."""
        return self.rows(np.argsort(self.tick, kind="stable"))

    def __len__(self) -> int:
        return len(self.task)

    def rows(self, rows: Selection) -> Self:
        """The work of a mask ``(n,)``, of indices ``(m,)`` or of a slice."""
        indices = np.arange(len(self))[rows].tolist()
        observations, samples = ([each[row] for row in indices] for each in (self.observations, self.samples))
        return replace(Batch.rows(self, rows), observations=observations, samples=samples)

    def waiting(self, samples: Sequence[PoseSample | None]) -> "WorkList":
        """The list for the next step, with the poses of ready work."""
        return replace(self, tick=np.full_like(self.tick, -1), samples=list(samples))

    def shifted(self, by_ns: int) -> "WorkList":
        """The list after a change ``by_ns`` of UTC for stamps on this machine's clock."""
        if not by_ns or np.all(self.by_utc):
            return self
        stamp_ns = np.where(self.by_utc, self.stamp_ns, self.stamp_ns + by_ns)
        pairs = zip(self.observations, stamp_ns.tolist(), strict=True)
        observations = [None if each is None else replace(each, stamp_ns=utc_ns) for each, utc_ns in pairs]
        valid = [each if by_utc else None for each, by_utc in zip(self.samples, self.by_utc.tolist(), strict=True)]
        return replace(self, stamp_ns=stamp_ns, observations=observations, samples=valid)


@dataclass(frozen=True, slots=True, eq=False)
class AnswerTimes:
    """Times ``n`` at which work may be answered: every tick, and deadlines at which no tick is.

    Attributes:
        time_ns: ``(n,)`` ascending.
        ticks: ``(n,)`` number of ticks of the step up to each.
        is_tick: ``(n,)`` whether it is a tick.
    """

    time_ns: IntArray
    ticks: IntArray
    is_tick: BoolArray

    @staticmethod
    def from_ticks(now_ns: IntArray, deadlines_ns: IntArray) -> "AnswerTimes":
        """Answer times of the ticks ``now_ns (ticks,)`` and of deadlines before the last of them."""
        time_ns = np.unique(np.concatenate([now_ns, deadlines_ns[deadlines_ns < now_ns[-1]]]))
        ticks = np.searchsorted(now_ns, time_ns, side="right")
        return AnswerTimes(time_ns, ticks, now_ns[np.maximum(ticks - 1, 0)] == time_ns)


@njit
def answer_in_order(
    work: tuple[IntArray, IntArray, IntArray, IntArray, IntArray],
    answer_times: tuple[IntArray, IntArray],
    last_image_ns: IntArray,
) -> IntArray:
    """Indices ``(n,)`` of the answer times of work; -1 where it keeps waiting.

    Work waits for earlier arrivals with earlier stamps, but not for observations that wait for their image.

    Args:
        work: ``(n,)`` each, in order of arrival: stamps, numbers of ticks to arrival and to complete telemetry,
            deadlines, and the stamps that the last image must have reached.
        answer_times: Times ``(k,)``, and numbers of ticks up to them ``(k,)``.
        last_image_ns: ``(k,)`` stamps of the last images at these times.
    """
    stamp_ns, arrival_tick, ready_tick, deadline_ns, required_image_ns = work
    time_ns, ticks = answer_times
    answer = np.full(len(stamp_ns), -1)
    first = 0
    for answer_time in range(len(time_ns)):
        while first < len(answer) and answer[first] >= 0:
            first += 1
        blocked_ns, is_blocked = 0, False
        for k in range(first, len(answer)):
            if arrival_tick[k] > ticks[answer_time]:
                break
            is_final = deadline_ns[k] <= time_ns[answer_time]
            if answer[k] >= 0 or (not is_final and last_image_ns[answer_time] < required_image_ns[k]):
                continue
            if is_final or (ready_tick[k] <= ticks[answer_time] and not (is_blocked and stamp_ns[k] >= blocked_ns)):
                answer[k] = answer_time
            else:
                blocked_ns = min(blocked_ns, stamp_ns[k]) if is_blocked else stamp_ns[k]
                is_blocked = True
    return answer


class RecentImages:
    """Stamps (UTC) of the newest images, as known at each tick of the newest step."""

    def __init__(self) -> None:
        self._image = self._stamp_ns = np.empty(0, dtype=np.int64)
        self._by_utc = np.empty(0, dtype=np.bool_)
        self._end = np.zeros(1, dtype=np.int64)  # rows known at each tick

    def add(self, image: IntArray, stamp_ns: IntArray, by_utc: BoolArray, tick: IntArray, count: int) -> None:
        """Add the images ``(n,)`` of a step of ``count`` ticks, each known from its ``tick (n,)`` on."""
        recent = slice(max(len(self._image) - _MAX_IMAGES, 0), None)
        before = len(self._image[recent])
        self._image = np.concatenate([self._image[recent], image])
        self._stamp_ns = np.concatenate([self._stamp_ns[recent], stamp_ns])
        self._by_utc = np.concatenate([self._by_utc[recent], by_utc])
        self._end = before + np.searchsorted(tick, np.arange(count), side="right")

    def shift(self, by_ns: int) -> None:
        """Apply a change ``by_ns`` of UTC to stamps on this machine's clock."""
        if by_ns:
            self._stamp_ns = np.where(self._by_utc, self._stamp_ns, self._stamp_ns + by_ns)

    def last_ns(self) -> IntArray:
        """Stamps ``(ticks,)`` of the last images; the end of time before the first image."""
        stamps_ns = np.append(self._stamp_ns, np.iinfo(np.int64).max)
        return stamps_ns[self._end - 1]

    def ticks_with(self, stamps_ns: IntArray, ticks: IntArray) -> IntArray:
        """First ticks ``(n,)`` from ``ticks (n,)`` on at which the last image has reached ``stamps_ns (n,)``.

        The number of ticks where there is none.
        """
        last_ns = self.last_ns()
        is_reached = (last_ns >= stamps_ns[:, None]) & (np.arange(len(last_ns)) >= ticks[:, None])
        return np.where(np.any(is_reached, axis=1), np.argmax(is_reached, axis=1), len(last_ns))

    def stamp_ns(self, image: int, tick: int) -> int | None:
        """Stamp of the image with a running number as of a tick; None where it is not kept."""
        window = self._window(tick)
        rows = np.flatnonzero(self._image[window] == image)
        return int(self._stamp_ns[window][rows[-1]]) if len(rows) else None

    def nearest(self, stamp_ns: int, tolerance_ns: int, tick: int) -> int:
        """Running number of the image closest to a stamp as of a tick; ``NO_IMAGE`` beyond the tolerance."""
        window = self._window(tick)
        distance_ns = np.abs(self._stamp_ns[window] - stamp_ns)
        if not len(distance_ns) or distance_ns.min() > tolerance_ns:
            return NO_IMAGE
        return int(self._image[window][distance_ns.argmin()])

    def _window(self, tick: int) -> slice:
        end = int(self._end[tick])
        return slice(max(end - _MAX_IMAGES, 0), end)
